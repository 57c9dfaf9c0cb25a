"""Meshes made in code, points on them, and a listener for progress."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import shapes
from aoprecalc.progress import Progress
from aoprecalc.types import Float64Array, Int32Array, Part, Scene


@pytest.fixture(scope="session")
def scene_of() -> Callable[[object, object], Scene]:
    """Make a Scene from positions, (v, 3), and faces, (f, 3)."""

    def make(positions: object, faces: object) -> Scene:
        corners: Int32Array = np.array(faces, np.int32)
        part = Part("all", 0, len(corners), corners)
        return Scene(Path("made.obj"), "obj", np.array(positions, np.float64), corners, None, (), (part,))

    return make


@pytest.fixture(scope="session")
def plate(scene_of) -> Scene:
    """The square [-1, 1]^2 at z = 0, of two faces."""
    return scene_of([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], [[0, 1, 2], [0, 2, 3]])


@pytest.fixture(scope="session")
def ball(scene_of) -> Scene:
    """A sphere of radius 1 around the origin: an octahedron divided four times, 2048 faces, bulging in by 0.4 %.

    Coordinates are multiples of 2^-20, so that moving it by small powers of two is exact.
    """
    x, y, z = np.eye(3)
    faces = np.array([[a, b, c] if a.sum() * b.sum() * c.sum() > 0 else [a, c, b]
                      for a in (x, -x) for b in (y, -y) for c in (z, -z)])  # fmt: skip
    for _ in range(4):
        a, b, c = faces.transpose(1, 0, 2)
        ab, bc, ca = a + b, b + c, c + a
        faces = np.concatenate([np.stack(f, axis=1) for f in ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))])
        faces /= np.linalg.norm(faces, axis=2, keepdims=True)
    corners: Float64Array = np.rint(faces.reshape(-1, 3) * 2**20) / 2**20
    positions, index = np.unique(corners, axis=0, return_inverse=True)
    return scene_of(positions, index.reshape(-1, 3))


class Listener(Progress):
    """Keeps what it is told."""

    def __init__(self) -> None:
        self.steps = 0
        self.warnings: list[str] = []

    def advance(self, count: int = 1) -> None:
        self.steps += count

    def warn(self, text: str) -> None:
        self.warnings.append(text)


@pytest.fixture
def listener() -> Listener:
    return Listener()


@pytest.fixture(scope="session")
def capsule() -> Scene:
    """A capsule along z, of radius 0.6 and with 1.8 between the middles of its ends, which are round."""
    turn = np.linspace(0, np.pi / 2, 9)
    ring, height = 0.6 * np.sin(turn), 0.6 * np.cos(turn)
    return shapes.scene(*shapes.spun(np.concatenate([np.c_[ring, -height - 0.9], np.c_[ring, height + 0.9][::-1]])))


@pytest.fixture(scope="session")
def surface_points() -> Callable[[Scene, int, int], Float64Array]:
    """Draw points uniformly on a scene's surface, otherwise than the fits do: (count, 3), by (scene, count, seed)."""

    def draw(scene: Scene, count: int, seed: int) -> Float64Array:
        random = np.random.default_rng(seed)
        a, b, c = scene.corners.transpose(1, 0, 2)
        areas = np.linalg.norm(np.cross(b - a, c - a), axis=1)
        face = random.choice(len(areas), count, p=areas / areas.sum())
        weights = random.dirichlet(np.ones(3), count)
        return np.einsum("kc,kcx->kx", weights, scene.corners[face])

    return draw
