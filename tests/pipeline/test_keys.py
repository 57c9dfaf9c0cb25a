"""What decides whether a result is made again: every byte that it depends on, and nothing else."""

import os
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest

from aoprecalc.errors import AoprecalcError
from aoprecalc.io import MESH_EXTENSIONS, input_files, load_scene
from aoprecalc.io.meshes import source_files
from aoprecalc.options import BakeOptions, SphereOptions
from aoprecalc.pipeline import state as inputs
from aoprecalc.pipeline.jobs import Asset, JobSpec
from aoprecalc.pipeline.state import FileStamp, InputFiles, result_key, spec_key
from gltf_kit.gltf_documents import DOCUMENTS, STACKED, corner, pictured
from gltf_kit.gltf_maker import GltfMaker, png
from pipeline.helpers import write_ring
from shapes import MESHES, box

FILES = sorted(file for file in MESHES.rglob("*") if file.suffix.lower() in MESH_EXTENSIONS)
BOTH = JobSpec(BakeOptions(), SphereOptions())


def obj_with_pictures(folder):
    """An OBJ with two MTL files, of which one is missing, and pictures, of which one is missing."""
    (folder / "stone.png").write_bytes(png(np.zeros((2, 2))))
    (folder / "ring.mtl").write_text("newmtl stone\nmap_Kd stone.png\nnewmtl wood\nmap_Kd wood.png\nmap_Ka stone.png\n")
    return write_ring(folder / "ring.obj", mtllib="ring.mtl\nmtllib gone.mtl", usemtl="stone")


def ply_with_a_picture(folder):
    positions, faces = box()
    (folder / "box.png").write_bytes(png(np.zeros((2, 2))))
    head = f"ply\nformat ascii 1.0\ncomment TextureFile box.png\nelement vertex {len(positions)}\n"
    head += "property float x\nproperty float y\nproperty float z\n"
    head += f"element face {len(faces)}\nproperty list uchar int vertex_indices\nend_header\n"
    rows = [" ".join(map(str, row)) for row in positions] + [f"3 {a} {b} {c}" for a, b, c in faces]
    (folder / "box.ply").write_text(head + "\n".join(rows) + "\n")
    return folder / "box.ply"


def gltf_in_pieces(folder):
    maker = GltfMaker(folder)
    maker.node(mesh=maker.mesh(corner(maker, STACKED, material=pictured(maker, "a picture.png"))))
    maker.json["images"][0]["uri"] = "a%20picture.png"
    return maker.save("corner.gltf", "corner.bin")


def glb_with_a_picture_beside(folder):
    maker = GltfMaker(folder)
    maker.node(mesh=maker.mesh(corner(maker, STACKED, material=pictured(maker, "beside.png"))))
    return maker.save("corner.glb")


MADE = {
    obj_with_pictures: ["ring.obj", "ring.mtl", "gone.mtl", "stone.png", "wood.png"],
    ply_with_a_picture: ["box.ply", "box.png"],
    gltf_in_pieces: ["corner.gltf", "corner.bin", "a picture.png"],
    glb_with_a_picture_beside: ["corner.glb", "beside.png"],
}
ids = [make.__name__ for make in MADE]


def key(mesh):
    return result_key(spec_key(Asset("it", mesh, BOTH), Path("out")), InputFiles.of(mesh))


@pytest.mark.parametrize("make", MADE, ids=ids)
def test_a_mesh_has_all_the_files_that_it_is_made_from(make, tmp_path):
    mesh = make(tmp_path)
    assert list(InputFiles.of(mesh).files) == MADE[make]
    assert input_files(mesh, mesh.read_bytes()) == [tmp_path / name for name in MADE[make]]


@pytest.mark.parametrize("make", MADE, ids=ids)
def test_the_key_changes_with_every_byte_of_every_file(make, tmp_path):
    mesh = make(tmp_path)
    first = key(mesh)
    keys = {first}
    for name in MADE[make]:
        file = tmp_path / name
        before = file.read_bytes() if file.exists() else None
        file.write_bytes(b"" if before is None else before[:-1] + bytes([before[-1] ^ 1]))
        keys.add(key(mesh))
        file.write_bytes((before or b"") + b"\n")
        keys.add(key(mesh))
        if before is None:
            file.unlink()
        else:
            file.write_bytes(before)
        assert key(mesh) == first
    assert len(keys) == 1 + 2 * len(MADE[make])


@pytest.mark.parametrize("make", MADE, ids=ids)
def test_the_key_does_not_change_with_times(make, tmp_path):
    mesh = make(tmp_path)
    first = key(mesh)
    for file in tmp_path.iterdir():
        os.utime(file, ns=(1, 1))
    assert key(mesh) == first


def test_the_key_does_not_depend_on_where_a_project_lies(tmp_path, monkeypatch):
    keys = []
    for place in ("a", "b"):
        (tmp_path / place).mkdir()
        monkeypatch.chdir(obj_with_pictures(tmp_path / place).parent)
        keys.append(key(Path("ring.obj")))
    assert keys[0] == keys[1]


@pytest.mark.parametrize("build", DOCUMENTS.values(), ids=DOCUMENTS)
@pytest.mark.parametrize("name", ["made.gltf", "made.glb"])
def test_the_files_of_a_gltf_are_known_without_its_mesh(build, name, tmp_path):
    maker = GltfMaker(tmp_path)
    build(maker)
    mesh = maker.save(name, "made.bin")
    assert set(input_files(mesh, mesh.read_bytes())) == set(source_files(load_scene(mesh)))


@pytest.mark.parametrize("make", MADE, ids=ids)
def test_the_files_of_others_are_known_without_their_meshes(make, tmp_path):
    mesh = make(tmp_path)
    assert set(input_files(mesh, mesh.read_bytes())) == set(source_files(load_scene(mesh)))


@pytest.mark.corpus
@pytest.mark.parametrize("mesh", FILES or [MESHES], ids=lambda mesh: mesh.relative_to(MESHES).as_posix())
def test_the_files_of_real_meshes_are_known_without_them(mesh):
    known = input_files(mesh, mesh.read_bytes())
    assert known[0] == mesh
    assert len(known) == len(set(known))
    if mesh.stat().st_size < 3_000_000:  # larger ones take long to read
        try:
            scene = load_scene(mesh)
        except AoprecalcError:
            return
        assert set(known) == set(source_files(scene))


@pytest.mark.parametrize("name", ["a.obj", "a.ply", "a.stl", "a.off", "a.gltf", "a.glb", "a.doc"])
@pytest.mark.parametrize("data", [b"", bytes(range(256)), b"glTF" + bytes(40), b"{}", b"[]", b"ply\n", b"mtllib \n"])
def test_what_is_damaged_refers_to_nothing_and_has_a_key(name, data, tmp_path):
    mesh = tmp_path / name
    mesh.write_bytes(data)
    assert input_files(mesh, data)[0] == mesh
    assert len(key(mesh)) == 64


def test_a_mesh_that_is_missing_has_a_key_of_its_own(tmp_path):
    mesh = tmp_path / "ring.obj"
    first = key(mesh)
    mesh.write_bytes(b"")
    assert key(mesh) != first


# Another value of every option that matters; those that do not are said below.
OTHER = {
    BakeOptions: {
        "only": ("a",), "exclude": ("a",), "occluders_only": ("a",), "glass_occludes": True, "two_sided": True,
        "all_parts": True, "ground": True, "width": 64, "height": 64, "directions": 64, "sampling": "random", "seed": 1,
        "estimator": "mean", "shadow_size": 64, "backend": "ray", "unwrap": "xatlas", "padding": 2, "fill": "none",
        "bit_depth": "16", "normals": "flat", "crease_angle": 30.0, "target_error": 0.1, "instances": "share",
        "pack": "orm", "max_distance": 2.5, "cone": 90.0, "weight": "uniform", "texel_density": 9.0, "strength": 0.5,
        "max_error": 0.1, "invert": True, "vertex_ao": "color", "backfaces": "ignore", "occluder": ("wall.obj",),
        "bent_normals": True, "bent_space": "world", "green": "down",
        "self_occlusion": "part",
        "sky": "overcast",
        "textures": "mesh", "pose": ("walk@0.5",),
        "high": ("rock_high.obj",), "cage": "2%", "match": "nothing",
    },
    SphereOptions: {
        "spheres": 8, "samples": 500, "seed": 1, "radius": "cover", "init": "kmeans++", "max_iterations": 5,
        "method": "shadow", "tolerance": 0.1, "levels": (2, 4), "all_parts": True,
    },
}  # fmt: skip
SAME = {"threads": 2, "memory_limit": 1 << 30, "unwrap_timeout": 60.0}


def test_every_option_is_thought_of():
    assert {field.name for field in fields(BakeOptions)} == {
        *OTHER[BakeOptions],
        *SAME,
        "up",
        "falloff",
        "ground_height",
    }
    assert {field.name for field in fields(SphereOptions)} == {*OTHER[SphereOptions]}


def test_the_order_changes_with_every_option_that_matters():
    mesh = Path("rock.obj")
    specs = [BOTH, JobSpec(bake=BakeOptions()), JobSpec(spheres=SphereOptions())]
    specs += [replace(BOTH, bake=BakeOptions(**{name: value})) for name, value in OTHER[BakeOptions].items()]
    specs += [replace(BOTH, bake=BakeOptions(ground=True, up="x")), replace(BOTH, bake=BakeOptions(size="auto"))]
    specs += [replace(BOTH, bake=BakeOptions(max_distance=2.5, falloff="linear"))]
    specs += [replace(BOTH, bake=BakeOptions(ground=True, ground_height=height)) for height in (0, 1)]
    specs += [replace(BOTH, spheres=SphereOptions(**{name: value})) for name, value in OTHER[SphereOptions].items()]
    others = {
        "bake_output": (".exr", ".glb"),
        "verify": True,
        "spheres_output": (".csv",),
        "bent_normals": ".png",
        "sh": ".exr",
    }
    specs += [replace(BOTH, **{name: value}) for name, value in others.items()]
    keys = {spec_key(Asset("rock", mesh, spec), Path("out")) for spec in specs}
    assert len(keys) == len(specs)


def test_the_key_changes_with_every_byte_of_the_files_that_options_name(tmp_path):
    mesh, around = write_ring(tmp_path / "ring.obj"), tmp_path / "around"
    around.mkdir()
    wall = obj_with_pictures(around).rename(around / "wall.obj")
    asset = Asset("it", mesh, JobSpec(BakeOptions(occluder=wall)))

    def found():
        return result_key(spec_key(asset, Path("out")), InputFiles.of(mesh, asset.spec.files))

    first = found()
    assert set(InputFiles.of(mesh, asset.spec.files).files) == {
        "ring.obj",
        *(f"around/{name}" for name in ("wall.obj", "ring.mtl", "gone.mtl", "stone.png", "wood.png")),
    }
    for name in ("wall.obj", "ring.mtl", "stone.png"):
        before = (around / name).read_bytes()
        (around / name).write_bytes(before + b"\n")
        assert found() != first
        (around / name).write_bytes(before)
    assert found() == first
    wall.unlink()
    assert found() != first


def test_the_place_of_a_project_with_files_of_options_does_not_matter(tmp_path):
    keys = set()
    for place in ("a", "b"):
        mesh, wall = write_ring(tmp_path / place / "ring.obj"), write_ring(tmp_path / place / "around" / "wall.obj")
        asset = Asset("it", mesh, JobSpec(BakeOptions(occluder=wall)))
        inputs = InputFiles.of(mesh, asset.spec.files)
        keys.add(result_key(spec_key(asset, tmp_path / place / "out"), inputs))
    assert len(keys) == 1


@pytest.mark.parametrize("option", SAME)
def test_what_only_takes_time_does_not_matter(option):
    other = replace(BOTH, bake=BakeOptions(**{option: SAME[option]}))
    keys = {spec_key(Asset("rock", Path("rock.obj"), spec), Path("out")) for spec in (BOTH, other)}
    assert len(keys) == 1


def test_another_version_makes_everything_again(monkeypatch):
    asset = Asset("rock", Path("rock.obj"), BOTH)
    first = spec_key(asset, Path("out"))
    monkeypatch.setattr("aoprecalc.pipeline.state.__version__", "99.0")
    assert spec_key(asset, Path("out")) != first


def test_names_matter_that_results_hold():
    """The stem is in references between the files, the mesh's path in the report, and the way to it in materials."""
    keys = {
        spec_key(Asset(name, Path(mesh), BOTH), Path(output))
        for name, mesh, output in [
            ("rock", "rock.obj", "out"),
            ("stone", "rock.obj", "out"),
            ("props/rock", "rock.obj", "out"),
            ("rock", "props/rock.obj", "out"),
            ("rock", "rock.obj", "build/made/out"),
        ]
    }
    assert len(keys) == 5


def test_the_name_of_the_output_folder_does_not_matter():
    asset = Asset("rock", Path("assets/rock.obj"), BOTH)
    assert spec_key(asset, Path("out")) == spec_key(asset, Path("made"))


def test_a_file_is_trusted_by_its_times_once_they_are_old_enough(tmp_path, monkeypatch):
    file = tmp_path / "file"
    file.write_bytes(b"one")
    assert not FileStamp.of(file).matches(file)  # it might be changed again within the same tick of the clock
    assert FileStamp.of(file, is_final=True).matches(file)
    os.utime(file, ns=(10**18, 10**18))
    assert not FileStamp.of(file).matches(file)  # anyone can say that; the system's own time is that of now
    monkeypatch.setattr(inputs, "_TIMESTAMP_RESOLUTION", -(10**12))
    stamp = FileStamp.of(file)
    assert stamp.matches(file)
    os.utime(file, ns=(10**18, 10**18 + 1))
    assert not stamp.matches(file)
    file.write_bytes(b"four")
    os.utime(file, ns=(10**18, 10**18))
    assert not stamp.matches(file)
    file.unlink()
    assert not stamp.matches(file)


def test_a_file_that_is_missing_is_known_as_that(tmp_path):
    stamp = FileStamp.of(tmp_path / "file")
    assert stamp == FileStamp(-1, None, "")
    assert stamp.matches(tmp_path / "file")
    (tmp_path / "file").write_bytes(b"")
    assert not stamp.matches(tmp_path / "file")
