"""High to low: the texture of a simple mesh holds the ambient occlusion of a detailed one."""

import json
import pickle
from dataclasses import replace

import numpy as np
import pytest
import trimesh

import aoprecalc as ao
from aoprecalc.api.bake_scene import bake_prepared
from aoprecalc.api.high_to_low import with_detail
from aoprecalc.api.prepared_scene import prepare_bake
from aoprecalc.errors import ArgumentError, InputError
from aoprecalc.mesh.roles import assign_roles
from aoprecalc.mesh.surface import shading_normals
from aoprecalc.options import BakeOptions, VerifyOptions
from aoprecalc.progress import Progress, StageTimer
from aoprecalc.raster.layout import atlas_from_uvs
from aoprecalc.render.simplification import simplified
from aoprecalc.texture_lookup import bilinear
from aoprecalc.types import AlphaMask, Material
from aoprecalc.visibility import plan
from aoprecalc.visibility.backend import open_backend
from aoprecalc.visibility.plan import FIT_CHUNK
from aoprecalc.visibility.setup import BakeInputs, BakeSetup
from bake.test_projection import bumpy, plane
from shapes import MESHES, box, join, quad, quad_uvs, scene, scene_of_parts

QUICK = {"directions": 256, "size": 64}
SQUARE = quad_uvs((0, 0), (1, 1))


def flat(name="rock_low"):
    """The unit square, of which the texture is the whole page."""
    return ao.Mesh(*plane(), uvs=SQUARE, name=name)


def fine(height=0.05, frequency=8):
    return ao.Mesh(*bumpy(height, 64, frequency), name="rock_high")


def rms(first, second):
    return float(np.sqrt(((first - second) ** 2).mean()))


@pytest.mark.parametrize("backend", ["gl", "ray"])
def test_a_plane_over_a_bumpy_plane_gets_what_the_bumpy_plane_has_itself(backend):
    options = BakeOptions(backend=backend, unwrap="keep", **QUICK)
    positions, faces = bumpy(0.05, 64, 25)
    own = ao.bake(ao.Mesh(positions, faces, uvs=positions[faces][..., :2]), options)
    result = ao.bake(flat(), options, high=[fine(frequency=25)])
    assert own.ao.min() < 0.9
    assert rms(result.ao, own.ao) < 0.005  # of the samples in a texel those on slopes stand for more surface
    assert result.report.high_to_low.missed == 0
    assert result.report.high_to_low.triangles == 8192


def test_depth_maps_and_rays_see_the_same_from_the_points_found():
    by_backend = [ao.bake(flat(), BakeOptions(backend=kind, **QUICK), high=[fine()]).ao for kind in ("gl", "ray")]
    assert rms(*by_backend) < 0.005


def test_the_low_mesh_does_not_occlude_and_all_of_the_high_one_does():
    roof = ao.Mesh(*quad((-500, -500, 0.5), (0, 1000, 0), (1000, 0, 0)), name="roof_high")
    options = BakeOptions(cage=0.01, **QUICK)
    alone = ao.bake(flat(), options, high=[ao.Mesh(*plane(-0.005), name="rock_high")])
    under = ao.bake(flat(), options, high=[ao.Mesh(*plane(-0.005), name="rock_high"), roof])
    assert (alone.ao == 1).all()
    assert under.ao.max() < 0.02


@pytest.mark.parametrize(("match", "bottom"), [("name", 0.1), ("nothing", 1.0)])
def test_parts_get_the_details_of_their_partners_but_all_occludes(match, bottom, tmp_path):
    """Of two plates close above each other the lower one is dark, unless it gets what the upper one has."""
    for kind in ("low", "high"):
        plates = trimesh.Scene()
        for name, z in (("top", 0.02), ("bottom", 0.0)):
            positions, faces = plane(0.01 if kind == "low" else z)
            plate = trimesh.Trimesh(positions + (0, 0, 1e-4 * (name == "top")), faces, process=False)
            plates.add_geometry(plate, geom_name=f"{name}_{kind}", node_name=f"{name}_{kind}")
        plates.export(tmp_path / f"{kind}.glb")
    options = BakeOptions(high=tmp_path / "high.glb", cage=0.05, match=match, unwrap="xatlas", **QUICK)
    result = ao.bake(tmp_path / "low.glb", options)
    middles = bilinear(result.ao, result.mesh.uvs.mean(axis=1), repeats=False)
    assert middles[:2] == pytest.approx(1.0, abs=1e-3)
    assert middles[2:] == pytest.approx(bottom, abs=0.1)
    matches = {pair.part: pair.high for pair in result.report.high_to_low.matches}
    named = {"top_low": ("top_high",), "bottom_low": ("bottom_high",)}
    assert matches == (named if match == "name" else {"top_low": (), "bottom_low": ()})


def test_names_that_do_not_match_are_told(tmp_path):
    for kind, names in (("low", ("a", "b_low")), ("high", ("c", "b_high")), ("other", ("d", "e"))):
        plates = trimesh.Scene()
        for z, name in enumerate(names):
            plates.add_geometry(trimesh.Trimesh(*plane(0.5 * z), process=False), geom_name=name, node_name=name)
        plates.export(tmp_path / f"{kind}.glb")
    report = ao.bake(tmp_path / "low.glb", BakeOptions(high=tmp_path / "high.glb", **QUICK)).report
    assert any("1 part ('a') has no partner and meets all of the detailed surface" in line for line in report.warnings)
    assert any("1 part ('c') of the detailed mesh matches no part" in line for line in report.warnings)
    report = ao.bake(tmp_path / "low.glb", BakeOptions(high=tmp_path / "other.glb", **QUICK)).report
    assert any("no names of parts match" in line for line in report.notes)


def over_the_middle(high, backend, **options):
    """The texture of a square at z = 0, of which the distance of the cage is 0.1."""
    low = scene(*quad((-0.5, -0.5, 0), (1, 0, 0), (0, 1, 0)), SQUARE)
    options = BakeOptions(backend=backend, unwrap="keep", cage=0.1, size=64, directions=2000, **options)
    prepared, progress = prepare_bake(low, options, [high]), Progress()
    with open_backend(options, progress) as backend:
        texture = bake_prepared(prepared, backend, options, progress, StageTimer(progress)).texture
    assert texture.valid.all()
    return texture.values


FLOOR = quad((-3, -3, -0.05), (6, 0, 0), (0, 6, 0))
X = (np.arange(64) + 0.5) / 64 - 0.5  # of the columns
AWAY = np.abs(X) > 0.02  # from the edge of a half plane
BESIDE = (1 + np.abs(X) / np.hypot(X, 0.1)) / 2  # what is open beside a long half plane that ends above x = 0


@pytest.mark.parametrize("backend", ["gl", "ray"])
def test_a_plane_is_met_through_the_hole_of_a_masked_sheet_over_it(backend):
    high = scene_of_parts(quad((-3, -3, 0.05), (6, 0, 0), (0, 6, 0)), FLOOR)
    mask = AlphaMask(np.array([[0, 1]], np.float32), SQUARE, np.ones((2, 3)), 0.5, ("clamp", "clamp"))
    first, second = high.parts
    high = replace(high, parts=(replace(first, material=Material(alpha_mask=mask)), second))
    values = over_the_middle(high, backend)
    assert np.abs(values - np.where(X < 0, BESIDE, 1.0))[:, AWAY].max() < 0.02


@pytest.mark.parametrize("backend", ["gl", "ray"])
def test_a_pane_of_glass_is_met_and_does_not_occlude_unless_asked_for(backend):
    """A pane over one half of a floor: its upper side is open, and so is the floor beside it, unless glass occludes."""
    high = scene_of_parts(quad((-3, -3, 0.05), (3, 0, 0), (0, 6, 0)), FLOOR)
    first, second = high.parts
    high = replace(high, parts=(replace(first, material=Material(transparent=True)), second))
    assert np.abs(over_the_middle(high, backend) - 1)[:, AWAY].max() < 0.02
    opaque = over_the_middle(high, backend, glass_occludes=True)
    assert np.abs(opaque - np.where(X < 0, 1.0, BESIDE))[:, AWAY].max() < 0.03  # at texels near the edge


def test_misses_are_counted_named_and_filled_from_around():
    hole = 0.25
    frame = join(
        quad((0, 0, 0), (1, 0, 0), (0, hole, 0)),
        quad((0, 1 - hole, 0), (1, 0, 0), (0, hole, 0)),
        quad((0, hole, 0), (hole, 0, 0), (0, 1 - 2 * hole, 0)),
        quad((1 - hole, hole, 0), (hole, 0, 0), (0, 1 - 2 * hole, 0)),
    )
    wall = quad((1, -500, 0), (0, 1000, 0), (0, 0, 1000))  # faces -x: half of the light is gone at x = 1
    result = ao.bake(flat(), BakeOptions(cage=0.05, match="nothing", **QUICK), high=[ao.Mesh(*frame), ao.Mesh(*wall)])
    told = result.report.high_to_low
    assert told.missed_share == pytest.approx(0.25, abs=0.03)
    assert told.missed == np.count_nonzero(~result.valid)
    assert any("25.0% of the texels are not on the detailed surface" in line for line in result.report.warnings)
    assert result.ao[~result.valid].min() > 0.5
    complete = ao.bake(
        flat(), BakeOptions(cage=0.05, match="nothing", **QUICK), high=[ao.Mesh(*plane()), ao.Mesh(*wall)]
    )
    assert rms(result.ao, complete.ao) < 0.03


def test_details_that_no_texel_meets_are_an_error_that_says_why():
    options, none = BakeOptions(cage=0.05, **QUICK), r"none of \d+ texels meets the detailed surface"
    corners, faces = plane()
    with pytest.raises(InputError, match=f"{none}; use a greater cage"):
        ao.bake(flat(), options, high=[ao.Mesh(corners + (0, 0, 1), faces)])
    with pytest.raises(InputError, match=f"{none}, which is 30 away from the mesh; put both in the same place"):
        ao.bake(flat(), options, high=[ao.Mesh(corners + (0, 0, 30), faces)])
    with pytest.raises(InputError, match=f"{none}: the diagonal of .* is .*, that of the details .*; give them the"):
        ao.bake(flat(), options, high=[ao.Mesh(100 * corners + (0, 0, 1), faces)])


@pytest.mark.parametrize(
    ("place", "told"),
    [
        ((0, 0, 0), ""),
        ((0.1, 0.1, 0.1), ""),
        ((1.8, 0, 0), "45% of its diagonal beyond the details along x: from -1 to 1, the details from 0.8 to 2.8"),
        ((0, -1, 0), "25% of its diagonal beyond the details along y: from -1 to 1, the details from -2 to 0"),
    ],
    ids=str,
)
def test_details_elsewhere_are_told(place, told):
    """The diagonal of the block is 4, its height 2 sqrt(2)."""
    positions, faces = box((-1, -1, -np.sqrt(2)), (1, 1, np.sqrt(2)))
    details = ao.Mesh(positions + np.asarray(place), faces)
    report = ao.bake(ao.Mesh(positions, faces), BakeOptions(**QUICK), high=[details]).report
    found = [line for line in report.warnings if "beyond the details" in line]
    assert found == ([f"the mesh reaches {told}; put both in the same place"] if told else [])


def test_details_that_reach_farther_than_the_mesh_are_no_other_place():
    roof = ao.Mesh(*quad((-500, -500, 0.5), (0, 1000, 0), (1000, 0, 0)))
    report = ao.bake(flat(), BakeOptions(cage=0.01, **QUICK), high=[ao.Mesh(*plane(-0.005)), roof]).report
    assert not [line for line in report.warnings if "beyond the details" in line]


def files(folder):
    """A low and a high mesh, and a cage, as files."""
    for name, shape in (("rock.obj", plane()), ("rock_high.ply", bumpy(0.05)), ("cage.obj", plane(0.06))):
        trimesh.Trimesh(*shape, process=False).export(folder / name)


@pytest.mark.parametrize("cage", ["auto", 0.06, "5%", "cage.obj"])
def test_every_kind_of_cage_gives_the_same_where_it_encloses_the_details(cage, tmp_path):
    files(tmp_path)
    cage = tmp_path / cage if cage == "cage.obj" else cage
    options = BakeOptions(high=tmp_path / "rock_high.ply", cage=cage, unwrap="xatlas", **QUICK)
    expected = replace(options, cage=0.08)
    assert rms(ao.bake(tmp_path / "rock.obj", options).ao, ao.bake(tmp_path / "rock.obj", expected).ao) < 1e-3


def test_the_command_line_bakes_and_verify_finds_the_details_beside_the_mesh(tmp_path, command, monkeypatch):
    files(tmp_path)
    monkeypatch.chdir(tmp_path)
    done = command("bake", "rock.obj", "--high", "rock_high.ply", "--cage", "cage.obj", "--size", 64, "--json")
    assert done.returncode == 0
    report = json.loads(done.stdout)
    assert report["high_to_low"]["cage"] == [0.06, 0.06]
    assert report["options"]["cage"] == "cage.obj"
    done = command("verify", "rock_ao.obj", "--points", 500, "--rays", 256, "--tolerance", 0.02)
    assert done.returncode == 0
    assert "--high rock_high.ply --cage cage.obj" in done.stderr
    done = command("verify", "rock_ao.obj", "--points", 500, "--rays", 256, "--cage", "0.06", "--tolerance", 0.02)
    assert done.returncode == 0


def test_a_cage_without_details_and_details_that_are_no_mesh_are_refused(tmp_path):
    files(tmp_path)
    with pytest.raises(ArgumentError, match="cage is '2%', but there is no detailed mesh; add high"):
        ao.bake(flat(), BakeOptions(cage="2%", **QUICK))
    with pytest.raises(ArgumentError, match="match is 'nothing', but there is no detailed mesh"):
        ao.bake(flat(), BakeOptions(match="nothing", **QUICK))
    with pytest.raises(ArgumentError, match="given twice"):
        ao.bake(flat(), BakeOptions(high="rock.obj"), high=[fine()])
    with pytest.raises(ArgumentError, match="instances is 'share'"):
        ao.bake(flat(), BakeOptions(instances="share"), high=[fine()])
    with pytest.raises(InputError, match="no such file"):
        ao.bake(flat(), BakeOptions(high=tmp_path / "gone.obj"))
    with pytest.raises(InputError, match=r"cage.obj: has 2 faces, a cage of .* has 12 faces"):
        ao.bake(ao.Mesh(*box()), BakeOptions(cage=tmp_path / "cage.obj", **QUICK), high=[fine()])


def test_chunks_and_threads_do_not_change_a_byte(monkeypatch):
    options = BakeOptions(backend="ray", unwrap="keep", size=1100, directions=4)
    whole = ao.bake(flat(), options, high=[fine()]).ao
    assert np.array_equal(ao.bake(flat(), replace(options, threads=1), high=[fine()]).ao, whole)
    monkeypatch.setattr(plan, "_MAX_FIT_CHUNKS", 1)
    assert whole.size > FIT_CHUNK
    assert np.array_equal(ao.bake(flat(), options, high=[fine()]).ao, whole)


def test_another_process_gets_the_same_points_from_the_pickled_inputs():
    options = BakeOptions(backend="ray", unwrap="keep", **QUICK)
    scene = with_detail(assign_roles(flat()._scene, options), options, 0, [fine()._scene])
    atlas = atlas_from_uvs(scene, SQUARE, np.ones(2, bool))
    inputs = BakeInputs(scene, atlas, shading_normals(scene), options)
    with open_backend(options, Progress()) as backend:
        here, there = (BakeSetup(backend, own) for own in (inputs, pickle.loads(pickle.dumps(inputs))))
        for group in (0, 1):
            one, other = (setup.samples(setup.sides[0], slice(100, 900), group) for setup in (here, there))
            assert np.array_equal(one.faces, other.faces)
            assert np.array_equal(one.weights, other.weights)


@pytest.mark.slow
def test_a_batch_of_two_processes_writes_the_bytes_of_a_single_bake(tmp_path, command, monkeypatch):
    files(tmp_path)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("AOPRECALC_CACHE", str(tmp_path / "cache"))
    (tmp_path / "parts.toml").write_text(
        'inputs = ["rock.obj"]\noutput = "out"\n[bake]\nsize = 64\nhigh = "rock_high.ply"\ncage = "cage.obj"\n'
    )
    assert command("batch", "parts.toml", "--jobs", 2).returncode == 0
    assert command("bake", "rock.obj", "--high", "rock_high.ply", "--cage", "cage.obj", "--size", 64).returncode == 0
    assert (tmp_path / "out" / "rock_ao.png").read_bytes() == (tmp_path / "rock_ao.png").read_bytes()
    report = json.loads((tmp_path / "out" / "rock_report.json").read_text())
    assert (report["options"]["high"], report["options"]["cage"]) == (["../rock_high.ply"], "../cage.obj")


def test_the_size_is_chosen_by_the_details():
    options = BakeOptions(size="auto", directions=64)
    smooth, rough = (ao.bake(flat(), options, high=[fine(0.05, f)]).report.texels.width for f in (2, 60))
    assert smooth < rough


def displaced_sphere(sections):
    """A sphere of about 4 * sections^2 triangles, with waves, and finer ones on these."""
    sphere = trimesh.creation.uv_sphere(count=(sections, sections))
    x, y, z = sphere.vertices.T
    waves = 0.05 * np.sin(5 * x) * np.sin(4 * y) * np.sin(6 * z) + 0.01 * np.sin(30 * x) * np.sin(25 * y + 30 * z)
    return ao.Mesh(sphere.vertices * (1 + waves[:, None]), sphere.faces)


def reference_error(low, high, **options):
    """The RMSE of the texture to the detailed surface's own AO, by rays, and what was missed."""
    result = ao.bake(low, BakeOptions(directions=1000, **options), high=[high], verify=True)
    return result.report.verify.levels[0].rmse, result.report.high_to_low.missed_share


@pytest.mark.slow
def test_a_displaced_sphere_of_half_a_million_triangles_on_two_thousand():
    error, missed = reference_error(displaced_sphere(23), displaced_sphere(354), size=1024)
    assert error < 0.02
    assert missed < 0.001


@pytest.mark.slow
@pytest.mark.corpus
def test_a_simplified_ogre_gets_the_ao_of_the_original():
    original = trimesh.load(MESHES / "jerry_ogre" / "bs_rest.obj", process=False, force="mesh")
    original.merge_vertices(merge_tex=True, merge_norm=True)
    attributes = {"POSITION": original.vertices.astype(np.float32), "NORMAL": original.vertex_normals.astype("f4")}
    simple, triangles = simplified(attributes, original.faces.astype(np.int32), 4000)
    assert len(triangles) < 5000
    error, missed = reference_error(
        ao.Mesh(simple["POSITION"], triangles), ao.Mesh(original.vertices, original.faces), size=1024
    )
    assert error <= 0.02
    assert missed < 0.01


def test_verify_takes_meshes_in_memory():
    result = ao.bake(flat(), BakeOptions(**QUICK), high=[fine()])
    few = VerifyOptions(points=500, rays=256)
    assert ao.verify(result.mesh, options=few, high=[fine()]).error < 0.02
