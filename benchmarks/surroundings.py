"""Errors of a small object's texture in surroundings of any size.

    python benchmarks/surroundings.py [--before OTHER/src] [--backend gl ray]

Bakes a stool, and it alone, on floors 10 to 10,000 times as wide as itself, with `aoprecalc bake --only stool`, and two
stools at the ends of such a floor; prints the RMS error against ray tracing, with --before also that of another
checkout. The reference is that of this checkout: textures of both are measured by its `aoprecalc verify`.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
import trimesh

HERE = Path(__file__).resolve().parents[1] / "src"
WIDTHS = (10, 100, 1_000, 10_000)


def stool(at: float) -> trimesh.Trimesh:
    """Return a seat on a block, two units wide, at x = `at`."""
    seat = trimesh.creation.box(bounds=[(at - 1, 1, -1), (at + 1, 1.3, 1)])
    return trimesh.util.concatenate([seat, trimesh.creation.box(bounds=[(at - 0.4, 0, -0.4), (at + 0.4, 1, 0.4)])])


def floor(width: float) -> trimesh.Trimesh:
    """Return a square in the plane y = 0 that faces up."""
    corners = np.array([(-1, 0, -1), (-1, 0, 1), (1, 0, 1), (1, 0, -1)]) * width / 2
    return trimesh.Trimesh(corners, [(0, 1, 2), (0, 2, 3)], process=False)


def write_scene(path: Path, width: float, places: tuple[float, ...]) -> None:
    """Write stools and a floor as a GLB."""
    scene = trimesh.Scene()
    for number, at in enumerate(places):
        scene.add_geometry(stool(at), node_name=f"stool{number}", geom_name=f"stool{number}")
    scene.add_geometry(floor(width), node_name="floor", geom_name="floor")
    scene.export(path)


def error(mesh: Path, source: Path, backend: str, folder: Path) -> float | None:
    """Bake with one checkout and return the RMS error that this one measures."""
    asset = folder / "baked.glb"
    only = ["--only", "stool*"]
    bake = ["bake", mesh, *only, "--backend", backend, "-o", asset, "-q"]
    if run(source, *bake) is None or (answer := run(HERE, "verify", asset, *only, "--json", "-q")) is None:
        return None
    return float(json.loads(answer)["levels"][0]["rmse"])


def run(source: Path, *words: object) -> str | None:
    """Return what a command of a checkout prints; None where it refuses the mesh."""
    command = [sys.executable, "-m", "aoprecalc", *map(str, words)]
    done = subprocess.run(
        command, env={**os.environ, "PYTHONPATH": str(source)}, capture_output=True, text=True, check=False
    )
    if done.returncode not in (0, 1) or done.stderr.startswith("error"):
        print(done.stderr, end="", file=sys.stderr)
        return None
    return done.stdout


def main() -> None:
    """Print a row for each floor."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--before", type=Path, metavar="SRC", help="the src folder of another checkout")
    parser.add_argument("--backend", nargs="+", default=("gl",), choices=("gl", "ray"))
    given = parser.parse_args()
    sources = [HERE] if given.before is None else [given.before.resolve(), HERE]
    columns = [(source, backend) for backend in given.backend for source in sources]
    names = [f"{backend} {'now' if source == HERE else 'before'}" for source, backend in columns]
    print(f"{'floor':>7} {'stools':>6} " + " ".join(f"{name:>10}" for name in names))
    with tempfile.TemporaryDirectory() as temporary:
        mesh = Path(temporary) / "scene.glb"
        for width in WIDTHS:
            for places in ((0.0,), (-0.4 * width, 0.4 * width)):
                write_scene(mesh, width * 2, places)
                found = [error(mesh, source, backend, Path(temporary)) for source, backend in columns]
                cells = ["   refused" if rmse is None else f"{rmse:>10.4f}" for rmse in found]
                print(f"{width:>7} {len(places):>6} " + " ".join(cells), flush=True)


if __name__ == "__main__":
    main()
