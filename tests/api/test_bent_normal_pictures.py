"""Pictures of bent normals and of spherical harmonics, read back as a viewer reads them."""

import json

import numpy as np
import pytest

import aoprecalc as ao
from aoprecalc.api.bake import bake_file
from aoprecalc.io.images import read_pixels
from aoprecalc.options import BakeOptions
from aoprecalc.texture_lookup import bilinear
from gltf_kit.gltf_documents import instances_under_different_nodes, nested_mirrors
from gltf_kit.gltf_maker import GltfMaker
from gltf_kit.gltf_validator import issues, needs_validator
from gltf_kit.gltf_values import GltfValues
from shapes import ball, box, join, torus

FAST = {"size": 128, "directions": 128, "backend": "ray"}


def unit(vectors):
    return vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-12)


def looked_up(picture, uvs):
    """Bilinear look-ups at (k, 2) UVs, v downwards as in glTF, (k, c)."""
    upright = uvs * (1, -1) + (0, 1)
    return np.stack(
        [bilinear(np.ascontiguousarray(channel), upright, repeats=False) for channel in picture.transpose(2, 0, 1)], 1
    )


def shaded(path, picture):
    """The vectors that a viewer such as three.js gets at three points of each triangle, and the UVs there.

    Tangent, bitangent and normal are interpolated and then normalised; the nodes of the file have no transform.
    """
    values = GltfValues(path)
    vectors, places = [], []
    for mesh in values.json["meshes"]:
        for primitive in mesh["primitives"]:
            at = {name: values.array(index) for name, index in primitive["attributes"].items()}
            corner = values.corners(primitive).reshape(-1, 3)
            texcoord = values.material(primitive)["occlusionTexture"].get("texCoord", 0)
            bitangent = np.cross(at["NORMAL"], at["TANGENT"][:, :3]) * at["TANGENT"][:, 3:]
            for weights in np.array([(0.6, 0.2, 0.2), (0.2, 0.6, 0.2), (1, 1, 1)]) / ((1,), (1,), (3,)):
                t, b, n, uvs = (
                    np.einsum("c,fcx->fx", weights, entry[corner].astype(float))
                    for entry in (at["TANGENT"][:, :3], bitangent, at["NORMAL"], at[f"TEXCOORD_{texcoord}"])
                )
                local = looked_up(picture, uvs)
                basis = np.stack([unit(t), unit(b), unit(n)], axis=2)
                vectors.append(unit(np.einsum("fxy,fy->fx", basis, local)))
                places.append(uvs)
    return np.concatenate(vectors), np.concatenate(places)


def degrees(one, other):
    return np.degrees(np.arccos(np.clip((unit(one) * unit(other)).sum(axis=-1), -1, 1)))


def crowded():
    """A ring with a box in it."""
    return ao.Mesh(*join(torus(around=24, across=12), box((-0.2, -0.2, -1), (0.2, 0.2, 1))))


@pytest.mark.parametrize("depth", ["8", pytest.param("16", marks=pytest.mark.slow)])
def test_a_viewer_gets_the_vectors_back_from_tangent_space(tmp_path, depth):
    result = ao.bake(crowded(), ao.BakeOptions(**FAST, bit_depth=depth, bent_normals=True))
    files = result.save(tmp_path / "ring.glb", bent_normals=tmp_path / "bent.png")
    assert files.bent_normals == (tmp_path / "bent.png",)
    found, uvs = shaded(tmp_path / "ring.glb", 2 * read_pixels(tmp_path / "bent.png") - 1)
    apart = degrees(found, looked_up(result.bent_normals, uvs))
    assert np.median(apart) < 1
    assert np.percentile(apart, 90) < 5


def test_green_goes_down_where_asked(tmp_path):
    pictures = {}
    for green in ("up", "down"):
        result = ao.bake(crowded(), ao.BakeOptions(**FAST, green=green, bent_normals=True))
        result.save(tmp_path / "ring.glb", bent_normals=tmp_path / f"{green}.exr")
        pictures[green] = read_pixels(tmp_path / f"{green}.exr")
    assert (pictures["up"] == pictures["down"] * np.array((1, -1, 1), np.float32)).all()
    assert np.abs(pictures["up"][..., 1]).max() > 0.1


def test_without_nodes_object_and_world_are_the_same(tmp_path):
    pictures = []
    for space in ("object", "world"):
        result = ao.bake(crowded(), ao.BakeOptions(**FAST, bent_space=space, bent_normals=True))
        result.save(tmp_path / "ring.png", bent_normals=tmp_path / f"{space}.tif", sh=tmp_path / f"{space}.exr")
        pictures.append(read_pixels(tmp_path / f"{space}.tif"))
    assert (pictures[0] == pictures[1]).all()
    valid = result.valid
    assert np.abs(2 * pictures[0][valid] - 1 - result.bent_normals[valid]).max() < 0.005
    assert np.abs(read_pixels(tmp_path / "world.exr")[valid] - result.sh[valid]).max() < 0.001


def test_integers_hold_half_of_the_vector_and_a_half(tmp_path):
    result = ao.bake(crowded(), ao.BakeOptions(**FAST, bit_depth="16", bent_space="world", bent_normals=True))
    result.save(tmp_path / "ring.png", sh=tmp_path / "sh.png")
    pixels = read_pixels(tmp_path / "sh.png")
    assert pixels.shape[2] == 4
    assert np.abs(pixels[..., 0] - result.ao).max() < 1e-4
    assert np.abs(2 * pixels[..., 1:] - 1 - result.sh[..., 1:]).max() < 1e-4


@pytest.mark.parametrize("build", [instances_under_different_nodes, nested_mirrors])
def test_the_nodes_of_a_gltf_turn_object_space_to_the_world(tmp_path, build):
    maker = GltfMaker(tmp_path)
    build(maker)
    source = maker.save("parts.gltf")
    options = {**FAST, "size": 64, "unwrap": "xatlas", "normals": "flat"}
    baked = {}
    for space in ("object", "world"):
        done = bake_file(
            source,
            tmp_path / f"{space}.png",
            bent_normals=tmp_path / f"{space}.exr",
            options=BakeOptions(**options, bent_space=space, bit_depth="auto"),
        )
        baked[space] = read_pixels(tmp_path / f"{space}.exr")
    scene, valid = done.baked.scene, done.baked.texture.valid
    for part in scene.parts:
        inside = np.zeros(valid.shape, bool)
        for uvs in done.baked.atlas.uvs[part.faces]:
            row, column = ((1 - uvs.mean(axis=0)[1]) * 64), uvs.mean(axis=0)[0] * 64
            inside[int(row), int(column)] = True
        assert inside.any()
        normal_matrix = np.linalg.inv(part.source.linear).T
        turned = unit(baked["object"][inside].astype(float) @ normal_matrix.T)
        assert degrees(turned, baked["world"][inside]).max() < 0.5


@needs_validator
def test_tangents_are_valid(tmp_path):
    result = ao.bake(crowded(), ao.BakeOptions(**FAST, bent_normals=True))
    result.save(tmp_path / "ring.glb", bent_normals=tmp_path / "bent.png")
    assert not [issue for issue in issues(tmp_path / "ring.glb")[0] if issue["severity"] < 2]


def test_the_command_line_and_the_report(tmp_path, command):
    ao.bake(ao.Mesh(*ball(2)), ao.BakeOptions(size=32, directions=16)).save(tmp_path / "ball.glb")
    words = "--size", 32, "-n", 64, "-o", tmp_path / "out.png", "--sh", f"{tmp_path}/", "--report", tmp_path / "r.json"
    done = command(
        "bake", tmp_path / "ball.glb", *words, "--bent-normals", tmp_path / "bent.png", "--bent-space", "world"
    )
    assert done.returncode == 0
    assert "bent.png  bent normals, world space" in done.stdout
    outputs = json.loads((tmp_path / "r.json").read_text())["outputs"]
    assert outputs["bent_normals"] == [str(tmp_path / "bent.png")]
    assert outputs["sh"] == [str(tmp_path / "ball_sh.exr")]
    assert read_pixels(tmp_path / "bent.png").shape == (32, 32, 3)


def test_what_cannot_be_written_is_said_before_the_work(tmp_path):
    result = ao.bake(ao.Mesh(*ball(1)), ao.BakeOptions(size=32, directions=16))
    with pytest.raises(ao.UsageError, match=r"bent_normals and sh need a bake with BakeOptions\(bent_normals=True\)"):
        result.save(tmp_path / "ball.png", bent_normals=tmp_path / "bent.png")
    result = ao.bake(ao.Mesh(*ball(1)), ao.BakeOptions(size=32, directions=16, bent_normals=True))
    with pytest.raises(ao.UsageError, match="holds no four linear channels"):
        result.save(tmp_path / "ball.png", sh=tmp_path / "sh.jpg")
    assert not list(tmp_path.iterdir())
