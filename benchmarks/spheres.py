"""Seconds to fit 100 spheres to 100,000 samples, beside scikit-learn's KMeans on the same samples from the same start.

    python benchmarks/spheres.py [MESH ...]

Without arguments: the meshes of ../shared/meshes that are there, else a ball made here. Each time is the median of
three. `fit` is all that is done after reading the mesh (samples, spheres, radii, quality), `lloyd` only what KMeans
does too, to the same fixed point.
"""

import sys
from collections.abc import Callable
from pathlib import Path
from statistics import median
from time import perf_counter
from typing import TypeVar

import numpy as np
from sklearn.cluster import KMeans

from aoprecalc.files import load_scene
from aoprecalc.model import Part, Scene
from aoprecalc.options import SphereOptions
from aoprecalc.progress import Progress
from aoprecalc.spheres import fit
from aoprecalc.spheres.frame import Frame
from aoprecalc.spheres.lloyd import lloyd
from aoprecalc.spheres.sample import draw

MESHES = Path(__file__).resolve().parents[2] / "shared" / "meshes"
DEFAULTS = ("stanford-bunny.obj", "bigguy.obj")
OPTIONS = SphereOptions()
T = TypeVar("T")


def timed(work: Callable[[], T]) -> tuple[float, T]:
    """Seconds, the median of three, and the last result."""
    seconds = []
    for _ in range(3):
        start = perf_counter()
        result = work()
        seconds.append(perf_counter() - start)
    return median(seconds), result


def ball() -> Scene:
    """A bumpy ball of 40,000 faces."""
    rings, sectors = 100, 200
    theta, phi = np.meshgrid(np.linspace(1e-3, np.pi - 1e-3, rings + 1), np.linspace(0, 2 * np.pi, sectors + 1))
    radius = 1 + 0.2 * np.sin(5 * theta) * np.sin(4 * phi)
    direction = np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], axis=-1)
    index = np.arange((rings + 1) * (sectors + 1)).reshape(sectors + 1, rings + 1)
    a, b, c, d = (index[x : sectors + x, y : rings + y].ravel() for x, y in ((0, 0), (0, 1), (1, 1), (1, 0)))
    faces = np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)]).astype(np.int32)
    positions = (radius[..., None] * direction).reshape(-1, 3)
    return Scene(Path("bumpy ball"), "obj", positions, faces, None, None, (Part("ball", 0, len(faces), faces),))


def compare(scene: Scene) -> None:
    """Print one line about one mesh."""
    count = OPTIONS.spheres
    frame = Frame.around(scene.positions)
    points = draw(scene, frame, OPTIONS.samples, count, np.random.default_rng(OPTIONS.seed))
    start = points[:count]
    theirs_at = KMeans(count, init=start, n_init=1, tol=0, max_iter=OPTIONS.max_iterations, algorithm="lloyd")

    whole, _ = timed(lambda: fit(scene, OPTIONS, Progress()))
    ours, clusters = timed(lambda: lloyd(points, start, OPTIONS.max_iterations, Progress()))
    theirs, model = timed(lambda: theirs_at.fit(points))
    inertia = (clusters.distances**2).sum()
    print(
        f"{scene.path.name:24} fit {whole:6.2f} s   lloyd {ours:6.2f} s   scikit-learn {theirs:6.2f} s   "
        f"ratio {theirs / ours:5.2f}   iterations {clusters.iterations} and {model.n_iter_}   "
        f"inertia differs by {abs(inertia / model.inertia_ - 1):.0e}"
    )


def main() -> None:
    """Compare on the meshes named, or on the default ones."""
    paths = [Path(name) for name in sys.argv[1:]] or [MESHES / name for name in DEFAULTS if (MESHES / name).exists()]
    for scene in map(load_scene, paths) if paths else [ball()]:
        compare(scene)


if __name__ == "__main__":
    main()
