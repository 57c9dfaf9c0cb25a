"""Meshes from arrays, from trimesh and from files are one thing."""

import numpy as np
import pytest
import trimesh
from PIL import Image

import aoprecalc as ao
from shapes import dented, torus

OPTIONS = ao.BakeOptions(size=64, directions=64)


@pytest.fixture(scope="module")
def ring():
    positions, faces = torus(around=16, across=8)
    return ao.Mesh(positions, faces, name="ring")


@pytest.fixture(scope="module")
def baked(ring):
    return ao.bake(ring, OPTIONS)


def write_obj(path, positions, faces):
    lines = ["v {!r} {!r} {!r}".format(*map(float, row)) for row in positions]
    path.write_text("\n".join([*lines, *("f {} {} {}".format(*row) for row in faces + 1)]) + "\n")
    return path


def test_a_soup_bakes_as_the_welded_mesh_and_as_its_file(ring, baked, tmp_path):
    soup = ao.Mesh(ring.vertices[ring.faces].reshape(-1, 3), np.arange(3 * len(ring.faces)).reshape(-1, 3))
    from_soup = ao.bake(soup, OPTIONS)
    from_file = ao.bake(write_obj(tmp_path / "ring.obj", ring.vertices, ring.faces), OPTIONS)
    assert from_soup.report.ao.mean == from_file.report.ao.mean == baked.report.ao.mean
    assert from_soup.report.input.vertices == len(ring.vertices)
    assert len(soup.vertices) == 3 * len(ring.faces)


def test_a_soup_has_the_spheres_of_the_welded_mesh():
    positions, faces = dented(1)
    options = ao.SphereOptions(6, samples=500)
    soup = ao.Mesh(positions[faces].reshape(-1, 3), np.arange(faces.size).reshape(-1, 3))
    welded, unwelded = (ao.fit_spheres(mesh, options) for mesh in (ao.Mesh(positions, faces), soup))
    assert np.array_equal(welded.centers, unwelded.centers)
    assert welded.quality == unwelded.quality


def test_arrays_are_kept_checked_and_read_only(ring):
    assert (ring.vertices.dtype, ring.faces.dtype) == (np.float64, np.int32)
    assert (ring.normals, ring.uvs, ring.ao) == (None, None, None)
    with pytest.raises(ValueError, match="read-only"):
        ring.vertices[0] = 0
    with pytest.raises(AttributeError):
        ring.name = "other"


def test_what_is_given_may_change_afterwards():
    positions, faces = torus(around=16, across=8)
    mesh = ao.Mesh(positions, faces, uvs=positions[:, :2])
    kept = mesh.vertices.copy(), mesh.uvs.copy()
    positions[:] = 0
    assert np.array_equal(mesh.vertices, kept[0])
    assert np.array_equal(mesh.uvs, kept[1])


def test_values_per_vertex_and_per_corner_are_the_same():
    positions, faces = torus(around=16, across=8)
    normals, uvs = 3 * positions, positions[:, :2]
    at_vertices = ao.Mesh(positions, faces, normals=normals, uvs=uvs)
    at_corners = ao.Mesh(positions, faces, normals=normals[faces], uvs=uvs[faces])
    assert np.array_equal(at_vertices.normals, at_corners.normals)
    assert np.array_equal(at_vertices.uvs, at_corners.uvs)
    assert np.linalg.norm(at_vertices.normals, axis=2) == pytest.approx(1, abs=1e-6)


def test_a_bake_returns_the_mesh_with_its_texture(ring, baked):
    assert (baked.ao.shape, baked.ao.dtype) == ((64, 64), np.float32)
    assert (baked.mesh.uvs.shape, baked.mesh.uvs.dtype) == ((len(ring.faces), 3, 2), np.float64)
    assert (baked.mesh.normals.shape, baked.mesh.normals.dtype) == ((len(ring.faces), 3, 3), np.float32)
    assert np.array_equal(baked.mesh.faces, ring.faces)
    assert np.array_equal(baked.mesh.ao, baked.ao)
    assert baked.report.error is None  # of 64 directions
    assert 0 < baked.report.ao.mean == pytest.approx(baked.ao[baked.valid].mean(), abs=1e-6)


def test_trimesh_and_back(ring, baked):
    mesh = baked.mesh.to_trimesh()
    assert isinstance(mesh, trimesh.Trimesh)
    assert isinstance(mesh.visual, trimesh.visual.TextureVisuals)
    assert np.array_equal(mesh.triangles, ring.vertices[ring.faces])
    picture = np.asarray(mesh.visual.material.image)
    assert np.array_equal(picture, np.floor(255 * baked.ao + 0.5))
    again = ao.Mesh.from_trimesh(mesh, normals=True)
    assert np.array_equal(again.uvs, baked.mesh.uvs)
    assert again.normals == pytest.approx(baked.mesh.normals, abs=1e-6)
    kept = ao.bake(mesh, OPTIONS)
    assert kept.report.unwrap.method == "keep"
    assert kept.report.ao.mean == pytest.approx(baked.report.ao.mean, abs=1e-4)


def test_trimesh_writes_what_the_picture_is(baked, tmp_path):
    baked.mesh.to_trimesh().export(tmp_path / "ring.glb")
    loaded = trimesh.load(tmp_path / "ring.glb", force="mesh")
    assert np.array_equal(
        np.asarray(loaded.visual.material.baseColorTexture.convert("L")), np.floor(255 * baked.ao + 0.5)
    )


def test_trimesh_without_uvs(ring):
    plain = trimesh.Trimesh(ring.vertices, ring.faces, process=False)
    assert ao.Mesh.from_trimesh(plain).uvs is None
    assert np.array_equal(ring.to_trimesh().vertices, ring.vertices)
    with pytest.raises(ao.ArgumentError, match="to_mesh"):
        ao.Mesh.from_trimesh(trimesh.Scene([plain]))


def test_a_texture_is_an_array_a_path_or_the_meshs_own(ring, baked, tmp_path):
    pytest.importorskip("embreex")
    options = ao.VerifyOptions(points=300, rays=64)
    own, array = ao.verify(baked.mesh, options=options), ao.verify(baked.mesh, baked.ao, options)
    assert own.levels == array.levels
    files = baked.save(f"{tmp_path}/out/")
    from_files = ao.verify(files.mesh, options=options)
    assert from_files.error == pytest.approx(own.error, abs=2e-3)
    in_bytes = np.asarray(Image.open(files.texture))
    assert in_bytes.dtype == np.uint8
    assert ao.verify(files.mesh, in_bytes, options).error == pytest.approx(from_files.error, abs=2e-6)
    assert ao.verify(baked.mesh, files.texture, options).error == pytest.approx(own.error, abs=2e-3)
