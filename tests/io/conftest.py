"""Meshes made here, so that these tests need no file from elsewhere."""

import numpy as np
import pytest

from gltf_kit.baked_by_hand import make_atlas, make_normals, write_with_texture
from gltf_kit.gltf_maker import GltfMaker

# The corners of a cube as quads, counter-clockwise from outside.
CUBE_POINTS = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=np.float64)
CUBE_QUADS = np.array([[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]])
CUBE_NORMALS = np.array([[-1, 0, 0], [1, 0, 0], [0, -1, 0], [0, 1, 0], [0, 0, -1], [0, 0, 1]], dtype=np.float64)
CUBE_TRIANGLES = np.concatenate([CUBE_QUADS[:, [0, 1, 2]], CUBE_QUADS[:, [0, 2, 3]]])


@pytest.fixture
def cube():
    """(8, 3) points, (6, 4) quads, (6, 3) normals, (12, 3) triangles."""
    return CUBE_POINTS, CUBE_QUADS, CUBE_NORMALS, CUBE_TRIANGLES


@pytest.fixture
def save(tmp_path):
    """save(name, text or bytes) -> the path of the file that was made."""

    def save_file(name, content):
        path = tmp_path / name
        path.parent.mkdir(exist_ok=True)
        path.write_bytes(content.encode() if isinstance(content, str) else content)
        return path

    return save_file


@pytest.fixture
def cube_obj(save):
    """A cube of quads with hard normals and UVs in two groups of two materials."""
    lines = ["# a cube", "mtllib none.mtl", "o cube"]
    lines += [f"v {x} {y} {z}" for x, y, z in CUBE_POINTS]
    lines += [f"vn {x} {y} {z}" for x, y, z in CUBE_NORMALS]
    lines += [f"vt {(i % 4) / 4:.3f} {(i // 4) / 7:.6f}" for i in range(24)]
    for side, quad in enumerate(CUBE_QUADS):
        if side in (0, 2):
            lines += [f"g half {side}", f"usemtl paint {side}"]
        lines.append("f " + " ".join(f"{v + 1}/{4 * side + at + 1}/{side + 1}" for at, v in enumerate(quad)))
    return save("cube.obj", "\n".join(lines) + "\n")


@pytest.fixture
def atlas_of():
    return make_atlas


@pytest.fixture
def normals_of():
    return make_normals


@pytest.fixture
def bake(tmp_path):
    """bake(scene, name, ...) writes a mesh with a new atlas and normals; returns (path, atlas, normals, warnings)."""

    def write(scene, name, method="xatlas", normals=None, texture="x_ao.png"):
        return write_with_texture(scene, tmp_path / "out" / name, method, normals, texture)

    return write


@pytest.fixture
def gltf(tmp_path):
    return GltfMaker(tmp_path)


@pytest.fixture
def gltf_cube(gltf):
    """(maker, primitive) of a cube whose 24 vertices have hard normals and UVs."""
    points = CUBE_POINTS[CUBE_QUADS].reshape(-1, 3).astype("<f4")
    uvs = np.tile([[0, 0], [1, 0], [1, 1], [0, 1]], (6, 1)) * 0.25 + np.repeat(np.arange(6), 4)[:, None] / 8
    quads = np.arange(24).reshape(6, 4)
    triangles = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]]).astype("<u2")
    attributes = {
        "POSITION": gltf.accessor(points, min=[-1, -1, -1], max=[1, 1, 1]),
        "NORMAL": gltf.accessor(np.repeat(CUBE_NORMALS, 4, axis=0).astype("<f4")),
        "TEXCOORD_0": gltf.accessor(uvs.astype("<f4")),
    }
    return gltf, {"attributes": attributes, "indices": gltf.accessor(triangles.reshape(-1))}
