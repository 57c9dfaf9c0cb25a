"""Simplification for the 3D view says why it cannot be had, whatever the library and the mesh do to it."""

import sys

import numpy as np
import pytest

from aoprecalc.errors import AoprecalcError
from aoprecalc.io.meshes import load_scene
from aoprecalc.mesh.surface import shading_normals
from aoprecalc.render import simplification
from aoprecalc.render.simplification import NotSimplifiedError, simplified
from aoprecalc.render.view_geometry import view_geometry
from aoprecalc.types import TexturedMesh
from shapes import MESHES, ball, join, quad, scene, torus


def shown(positions, faces, uvs=None):
    """A mesh to show, of the vertices that faces use."""
    used, corners = np.unique(faces, return_inverse=True)
    made = scene(np.asarray(positions, float)[used], corners.reshape(-1, 3))
    return of_scene(made, uvs)


def of_scene(made, uvs=None):
    normals = shading_normals(made).astype(float)
    return TexturedMesh(made, normals, uvs, None, np.ones(len(made.faces), bool))


def child(text):
    return [sys.executable, "-c", text]


LOUD = "import sys; sys.exit('ValueError: no such edge')"


@pytest.mark.parametrize(
    ("command", "reason"),
    [
        (child(LOUD), "could not simplify the mesh: ValueError: no such edge"),
        (child("import os; os.abort()"), "could not simplify the mesh: signal 6"),
        (child("import time; time.sleep(60)"), r"has not simplified the mesh within 0\.2 s"),
        (["/no/such/program"], "could not simplify the mesh"),
    ],
    ids=["raises", "crashes", "does not end", "does not start"],
)
def test_what_the_library_does_is_told(command, reason, monkeypatch):
    monkeypatch.setattr(simplification, "_CHILD", command)
    monkeypatch.setattr(simplification, "_SECONDS", 0.2 if "sleep" in command[-1] else 60)
    with pytest.raises(NotSimplifiedError, match=reason):
        view_geometry(shown(*ball(2)), 10)


def test_without_the_library_only_meshes_within_the_budget_are_shown(monkeypatch):
    monkeypatch.setitem(sys.modules, "opengl_decimate", None)
    mesh = shown(*ball(2))
    assert len(view_geometry(mesh, 10_000).triangles) == len(mesh.scene.faces)
    with pytest.raises(NotSimplifiedError, match=r"opengl_decimate, which .* is not installed"):
        view_geometry(mesh, 10)


@pytest.fixture
def in_process(monkeypatch):
    """Has requests answered in this process, which is faster."""

    def answer(command, request, timeout):
        arrays = simplification._from_npz(request)
        count, triangles = int(arrays.pop("max_triangles")), arrays.pop("triangles")
        with np.errstate(all="ignore"):
            left, triangles = simplification._simplify(arrays, triangles, count)
        return simplification._to_npz({**left, "triangles": triangles})

    monkeypatch.setattr(simplification, "ask", answer)


def soup(random):
    points = int(random.integers(3, 300))
    return random.normal(size=(points, 3)), random.integers(0, points, (int(random.integers(1, 900)), 3))


def damaged(random):
    """A torus, some of whose triangles are turned, twice there, missing or hang on one vertex."""
    positions, faces = torus(around=int(random.integers(3, 40)), across=int(random.integers(3, 20)))
    faces = faces[random.random(len(faces)) > 0.1]
    faces = np.concatenate([faces, faces[random.random(len(faces)) < 0.2]])
    faces[random.random(len(faces)) < 0.1] = faces[random.random(len(faces)) < 0.1][:1, ::-1]
    faces[random.random(len(faces)) < 0.05, 0] = 0
    return positions, faces


def of_size(factor, shape):
    def made(random):
        positions, faces = shape(random)
        return positions * factor, faces

    return made


def flat(random):
    positions, faces = soup(random)
    return positions * (1, 0, 0), faces


def one_again(random):
    positions, faces = soup(random)
    return positions, np.repeat(faces[:1], len(faces), axis=0)


def one_edge(random):
    positions, faces = soup(random)
    faces[:, :2] = 0, 1
    return positions, faces


def many_at_a_place(random):
    positions, faces = soup(random)
    return np.round(positions), faces


def far_apart(random):
    positions, faces = damaged(random)
    return positions * 10.0 ** random.uniform(-12, 12, (len(positions), 1)), faces


NASTY = {
    "soup": soup, "damaged": damaged, "flat": flat, "one again": one_again, "one edge": one_edge,
    "many at a place": many_at_a_place, "far apart": far_apart, "tiny": of_size(1e-30, damaged),
    "huge": of_size(1e30, damaged), "huge soup": of_size(1e200, soup),
}  # fmt: skip


@pytest.mark.parametrize("kind", NASTY)
def test_a_nasty_mesh_is_shown_or_refused(kind, in_process):
    """Thirty of each kind: what is shown is whole, finite and within what is allowed."""
    outcomes = set()
    for seed in range(30):
        random = np.random.default_rng([seed, list(NASTY).index(kind)])
        positions, faces = NASTY[kind](random)
        made = scene(positions, faces)
        normals = random.normal(size=(len(faces), 3, 3))
        normals /= np.linalg.norm(normals, axis=2, keepdims=True)
        uvs = None if seed % 3 == 0 else random.uniform(-2, 2, (len(faces), 3, 2))
        smooth = np.tile([0.0, 0.0, 1.0], (len(faces), 3, 1))
        mesh = TexturedMesh(made, normals if seed % 2 else smooth, uvs, None, np.ones(len(faces), bool))
        allowed = int(random.integers(1, len(faces) + 1))
        try:
            view = view_geometry(mesh, allowed)
        except NotSimplifiedError:
            outcomes.add("refused")
            continue
        outcomes.add("shown")
        assert 0 < len(view.triangles) <= 3 * allowed
        assert np.isfinite([(column.lower, column.step) for column in view.columns]).all()
        assert view.triangles.max() < len(view.columns[0].values)
        view.as_json()
    assert "shown" in outcomes


def test_the_process_gives_what_the_library_gives(in_process, monkeypatch):
    mesh = shown(*join(ball(3), quad((2, 0, 0), (1, 0, 0), (0, 1, 0), 20)))
    direct = view_geometry(mesh, 300).packed
    monkeypatch.undo()
    assert view_geometry(mesh, 300).packed == direct


def test_a_mesh_of_which_nothing_is_left_is_refused(in_process):
    attributes = {"POSITION": np.zeros((6, 3)), "NORMAL": np.tile([0.0, 0.0, 1.0], (6, 1))}
    with pytest.raises(NotSimplifiedError, match="nothing of the mesh is left"):
        simplified(attributes, np.arange(6, dtype=np.int32).reshape(-1, 3), 1)


@pytest.mark.corpus
@pytest.mark.slow
def test_the_nasty_meshes_of_the_corpus_are_shown_or_refused():
    outcomes = []
    for path in sorted((MESHES / "nasty").rglob("*.*")):
        try:
            made = load_scene(path)
        except AoprecalcError:
            continue
        try:
            outcomes.append(len(view_geometry(of_scene(made, made.uvs), 2000).triangles) <= 6000)
        except NotSimplifiedError:
            outcomes.append(True)
    assert len(outcomes) > 5
    assert all(outcomes)
