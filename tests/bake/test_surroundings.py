"""Surroundings from other files: they occlude as parts of the mesh's own file would, and travel with the result."""

import numpy as np
import pytest
import trimesh

import aoprecalc as ao
from aoprecalc.api.bake_scene import bake_scene
from aoprecalc.errors import InputError, option_name
from aoprecalc.io import load_scene
from aoprecalc.options import BakeOptions, VerifyOptions
from pipeline.helpers import run
from shapes import box, clutter, disc, quad, quad_uvs, scene, scene_of_parts

QUICK = {"directions": 256, "size": 64}


def saved(folder, name, shape):
    """Write a shape as a mesh file without normals."""
    trimesh.Trimesh(*shape, process=False).export(folder / name)
    return folder / name


@pytest.mark.parametrize("backend", ["gl", "ray"])
def test_a_file_occludes_as_a_part_does_seed_3(backend, tmp_path):
    patch, around = quad((-1, -1, 0), (2, 0, 0), (0, 2, 0)), clutter(3, 20)
    saved(tmp_path, "around.ply", around)
    around = load_scene(tmp_path / "around.ply")  # positions of a PLY are 32-bit floats
    uvs = quad_uvs((0, 0), (1, 1))
    alone = scene(*patch, uvs)
    unused = np.zeros((len(around.faces), 3, 2))
    parts = scene_of_parts(patch, (around.positions, around.faces), uvs=np.concatenate([uvs, unused]))
    options = {"backend": backend, "unwrap": "keep", **QUICK}
    expected = bake_scene(parts, BakeOptions(only="part 0", **options)).texture.values
    found = bake_scene(alone, BakeOptions(occluder=tmp_path / "around.ply", **options)).texture.values
    assert expected.min() < 0.5
    assert np.abs(found - expected).max() < 1e-6


def test_a_plate_on_both_sides_of_a_floor_halves_what_it_covers(tmp_path):
    """Half of the hemisphere is covered by a vertical wall that reaches far."""
    floor = scene(*quad((-0.01, -0.01, 0), (0.02, 0, 0), (0, 0.02, 0)), quad_uvs((0, 0), (1, 1)))
    wall = saved(tmp_path, "wall.ply", quad((-0.02, -500, 0), (0, 1000, 0), (0, 0, 1000)))
    for backend in ("gl", "ray"):
        options = BakeOptions(size=8, directions=4000, unwrap="keep", backend=backend, occluder=(wall,))
        baked = bake_scene(floor, options)
        assert baked.texture.values[baked.texture.valid].mean() == pytest.approx(0.5, abs=0.01)


def test_new_uvs_do_not_depend_on_the_surroundings(tmp_path):
    mesh = ao.Mesh(*box())
    roof = saved(tmp_path, "roof.obj", quad((-5, -5, 2), (10, 0, 0), (0, 10, 0)))
    alone, covered = (ao.bake(mesh, BakeOptions(occluder=files, **QUICK)) for files in ((), (roof,)))
    assert (alone.mesh.uvs == covered.mesh.uvs).all()
    assert covered.report.ao.mean < alone.report.ao.mean - 0.1
    assert "roof.obj: occludes with 2 triangles" in covered.report.notes


@pytest.mark.parametrize(("height", "told"), [(30, False), (60, True)])
def test_a_file_that_is_too_far_away_to_occlude_is_told(height, told, tmp_path):
    """A disc of radius r at the height h over a floor takes r^2 / (r^2 + h^2) of its light."""
    lamp = saved(tmp_path, "lamp.ply", disc(1, height))
    floor = ao.Mesh(*quad((-0.01, -0.01, 0), (0.02, 0, 0), (0, 0.02, 0)))
    report = ao.bake(floor, BakeOptions(occluder=lamp, backend="ray", size=16, directions=64)).report
    (note,) = (line for line in report.notes if "occludes with" in line)
    assert note.endswith(f"triangles, but is {height} away and takes less than 0.1% of the light") == told


def test_the_mesh_of_a_bake_stands_alone_again(tmp_path):
    mesh, roof = ao.Mesh(*box()), saved(tmp_path, "roof.obj", quad((-5, -5, 2), (10, 0, 0), (0, 10, 0)))
    covered = ao.bake(mesh, BakeOptions(occluder=roof, sky="overcast", ground=True, **QUICK))
    assert (ao.bake(covered.mesh, BakeOptions(**QUICK)).ao == 1).all()
    with_roof = ao.verify(covered.mesh, options=VerifyOptions(points=500, rays=256)).error
    assert with_roof < 0.06
    assert ao.verify(covered.mesh, options=VerifyOptions(occluder=(), points=500, rays=256)).error > 2 * with_roof


@pytest.mark.parametrize("way", [{"backfaces": "ignore"}, {"self_occlusion": "part"}], ids=str)
def test_new_uvs_do_not_depend_on_what_occludes(way):
    made = scene_of_parts(clutter(2), quad((-2, -2, 1.5), (4, 0, 0), (0, 4, 0)))
    usual, other = (bake_scene(made, BakeOptions(**QUICK, **options)) for options in ({}, way))
    assert (usual.atlas.uvs == other.atlas.uvs).all()
    assert (usual.texture.values != other.texture.values).any()


def test_files_of_one_name_are_told_apart_by_their_paths_alone(tmp_path):
    for name, height in (("a", 2), ("b", -2)):
        (tmp_path / name).mkdir()
        saved(tmp_path / name, "wall.obj", quad((-5, -5, height), (10, 0, 0), (0, 10, 0)))
    files = tmp_path / "a" / "wall.obj", tmp_path / "b" / "wall.obj"
    made = ao.bake(saved(tmp_path, "m.obj", box()), BakeOptions(occluder=files, **QUICK)).save(f"{tmp_path}/out/").mesh
    few = {"points": 200, "rays": 64}
    with pytest.raises(InputError, match=r"was baked with several files named wall.obj; give the paths with occluder"):
        ao.verify(made, options=VerifyOptions(**few))
    assert ao.verify(made, options=VerifyOptions(occluder=files, **few)).error < 0.1


def test_a_file_of_that_name_in_the_present_folder_is_another(tmp_path, monkeypatch):
    for name in ("out", "elsewhere"):
        (tmp_path / name).mkdir()
        saved(tmp_path / name, "roof.obj", quad((-5, -5, 2), (10, 0, 0), (0, 10, 0)))
    mesh = saved(tmp_path, "b.obj", box())
    made = ao.bake(mesh, BakeOptions(occluder=tmp_path / "out/roof.obj", **QUICK)).save(f"{tmp_path}/out/").mesh
    monkeypatch.chdir(tmp_path / "elsewhere")
    few = {"points": 200, "rays": 64}
    ao.verify(made, options=VerifyOptions(**few))
    (tmp_path / "out" / "roof.obj").unlink()
    with pytest.raises(InputError, match=r"was baked with occluder roof.obj, which is not in the folder"):
        ao.verify(made, options=VerifyOptions(**few))


def test_glass_and_collision_hulls_of_a_file_let_light_pass_unless_asked_for(tmp_path):
    glass = trimesh.Trimesh(*quad((-5, -5, 2), (10, 0, 0), (0, 10, 0)), process=False)
    glass.visual = trimesh.visual.TextureVisuals(
        material=trimesh.visual.material.PBRMaterial(alphaMode="BLEND", baseColorFactor=(255, 255, 255, 20))
    )
    glass.export(tmp_path / "glass.glb")
    hull = trimesh.Scene({"UCX_roof": trimesh.Trimesh(*quad((-5, -5, 2), (10, 0, 0), (0, 10, 0)), process=False)})
    hull.add_geometry(trimesh.Trimesh(*quad((-5, -5, -9), (1, 0, 0), (0, 1, 0)), process=False), geom_name="low")
    hull.export(tmp_path / "hull.glb")
    mesh = ao.Mesh(*box())

    def mean(**options):
        return ao.bake(mesh, BakeOptions(unwrap="xatlas", **QUICK, **options)).report.ao.mean

    alone = mean()
    assert mean(occluder=tmp_path / "glass.glb") == alone
    assert mean(occluder=tmp_path / "glass.glb", glass_occludes=True) < alone - 0.1
    assert mean(occluder=tmp_path / "hull.glb") == pytest.approx(alone, abs=0.01)
    assert mean(occluder=tmp_path / "hull.glb", all_parts=True) < alone - 0.1


def test_verify_finds_the_surroundings_beside_the_mesh(tmp_path):
    (tmp_path / "out").mkdir()
    mesh, roof = saved(tmp_path, "b.obj", box()), saved(tmp_path, "roof.obj", quad((-5, -5, 2), (10, 0, 0), (0, 10, 0)))
    made = ao.bake(mesh, BakeOptions(size=128, directions=256, occluder=roof)).save(f"{tmp_path}/out/").mesh
    few = {"points": 500, "rays": 256}
    with pytest.raises(InputError, match=r"was baked with occluder roof.obj, .* give the option with its path"):
        ao.verify(made, options=VerifyOptions(**few))
    given = ao.verify(made, options=VerifyOptions(occluder=roof, **few))
    (tmp_path / "out" / "roof.obj").write_bytes(roof.read_bytes())
    found = ao.verify(made, options=VerifyOptions(**few))
    assert found.error == given.error < 0.04
    assert ao.verify(made, options=VerifyOptions(occluder=(), **few)).error > 0.1


def test_verify_names_all_files_that_are_not_beside_the_mesh(tmp_path):
    (tmp_path / "out").mkdir()
    plate, positions = quad((-1, -1, 0), (2, 0, 0), (0, 2, 0), 4), quad((-1, -1, 0.01), (2, 0, 0), (0, 2, 0), 4)
    low, cage = (saved(tmp_path, f"{name}.obj", shape) for name, shape in (("low", plate), ("cage", positions)))
    high = saved(tmp_path, "high.obj", quad((-1, -1, 0), (2, 0, 0), (0, 2, 0)))
    walls = [saved(tmp_path, f"{name}.obj", quad((x, -1, 0), (0, 2, 0), (0, 0, 2))) for name, x in (("a", 2), ("b", 3))]
    done = ao.bake(low, BakeOptions(high=high, cage=cage, occluder=walls, **QUICK)).save(f"{tmp_path}/out/")
    few = {"points": 200, "rays": 64}
    with pytest.raises(InputError) as raised:
        ao.verify(done.mesh, options=VerifyOptions(**few))
    assert raised.value.worded(option_name) == (
        f"{done.texture}: was baked with --occluder a.obj, --occluder b.obj, --high high.obj, --cage cage.obj, which "
        f"are not in the folder of {done.mesh}; give the options with the paths of all 4 files"
    )
    (tmp_path / "out" / "a.obj").write_bytes(walls[0].read_bytes())  # --occluder takes both of its files even then
    with pytest.raises(InputError, match=r"occluder b.obj, which is not .* give the option with the paths of all 2"):
        ao.verify(done.mesh, options=VerifyOptions(high=high, cage=cage, **few))
    given = VerifyOptions(high=high, cage=cage, occluder=walls, **few)
    assert ao.verify(done.mesh, options=given).options.cage == str(cage)


def test_axes_that_differ_are_a_warning(tmp_path):
    for name, axis in (("y.usda", "Y"), ("z.usda", "Z")):
        (tmp_path / name).write_text(
            f'#usda 1.0\n(\n    upAxis = "{axis}"\n)\ndef Mesh "m"\n{{\n    int[] faceVertexCounts = [3]\n'
            "    int[] faceVertexIndices = [0, 1, 2]\n    point3f[] points = [(0, 0, 0), (1, 0, 0), (0, 1, 0)]\n}\n"
        )
    report = ao.bake(tmp_path / "y.usda", BakeOptions(occluder=tmp_path / "z.usda", **QUICK)).report
    assert any(line.startswith("z.usda: its up axis is z, that of y.usda is y") for line in report.warnings)


def test_the_command_line_names_a_file_that_cannot_be_used_and_protects_it(tmp_path):
    saved(tmp_path, "b.obj", box())
    roof = saved(tmp_path, "roof.obj", quad((-5, -5, 2), (10, 0, 0), (0, 10, 0)))
    done = run(tmp_path, "bake", "b.obj", "--occluder", "rof.obj", "--size", 64, "-n", 64)
    assert (done.returncode, len(done.stderr.splitlines())) == (4, 1)
    assert "rof.obj: there is no such file (did you mean roof.obj?)" in done.stderr
    before = roof.read_bytes()
    done = run(tmp_path, "bake", "b.obj", "--occluder", "roof.obj", "-o", "roof.obj", "--size", 64, "-n", 64)
    assert done.returncode == 2
    assert "roof.obj: belongs to the input itself" in done.stderr
    assert roof.read_bytes() == before
    assert sorted(path.name for path in tmp_path.iterdir()) == ["b.obj", "roof.obj"]
