"""Bakes with a maximum distance, beside those of Blender's Cycles.

    python benchmarks/blender_distance.py --blender PYTHON [--only NAME ...] [--tables]

PYTHON has bpy. Two scenes that code makes, and meshes of ../shared/meshes that exist, are baked on the same UVs at
512 x 512 texels with maximum distances of 5, 10 and 25% of the diagonal: by Cycles, with 64 samples a texel, and by
rays here, with directions on the whole sphere of which half are above the surface: 128 are as many rays. What is
farther does not occlude at all in either (`--falloff none`): the floor under a plate at height h gets
(h / distance)^2, which is printed first.

Errors are those of float textures, looked up at points of the surface, against ray tracing as `aoprecalc verify` does
it, with the default estimator: Cycles is nearer to that than to `--estimator mean`. Seconds are those of the
processors, with two threads, of the bake alone, without reading, unwrapping and writing; who comes first alternates.

Everything goes into benchmarks/results/blender_distance.json, in which a run with --only replaces its own rows; with
--tables the tables of the documentation are written, too (result_tables.py).
"""

import argparse
import json
import subprocess
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import result_tables
import trimesh

import aoprecalc as ao
from aoprecalc.api.bake_scene import bake_scene
from aoprecalc.io import load_scene, read_image
from aoprecalc.mesh.surface import sample_surface
from aoprecalc.metrics.errors import error_statistics
from aoprecalc.metrics.reference import RayCount, reference_ao
from aoprecalc.options import ValueOptions
from aoprecalc.progress import Progress
from aoprecalc.texture_lookup import bilinear
from aoprecalc.types import Baked, Scene
from aoprecalc.visibility.integrand import Integrand

ROOT = Path(__file__).resolve().parents[1]
MESHES = ROOT.parent / "shared" / "meshes"
RESULTS = ROOT / "benchmarks" / "results" / "blender_distance.json"
sys.path.insert(0, str(ROOT / "examples"))

from make_meshes import colonnade  # noqa: E402 - the folder is known only here

MADE = ("colonnade", "clutter")
FOUND = {"ogre": "jerry_ogre/bs_rest.obj", "spot": "spot.obj", "bigguy": "bigguy.obj"}
SHARES = (5, 10, 25)  # per cent of the diagonal
SIZE, MARGIN, THREADS = 512, 8, 2
SAMPLES = 64  # of Cycles
DIRECTIONS = (64, 128, 256)  # 2 * SAMPLES are as many rays a texel
POINTS, RAYS = 6_000, 48 * 48  # of the reference

# The floor under a plate that is 40 times as wide as high, and the plate.
PLATES = "\n".join(
    [f"v {x} {y} {z}" for y in (0, 1) for x, z in ((-20, -20), (-20, 20), (20, 20), (20, -20))]
    + [f"vt {u} {v}" for low in (0.05, 0.55) for u, v in ((0, 0), (0, 0.4), (0.4, 0.4), (0.4, 0))
       for u, v in [(low + u, low + v)]]
    + ["f 1/1 2/2 3/3", "f 1/1 3/3 4/4", "f 5/5 7/7 6/6", "f 5/5 8/8 7/7", ""]
)  # fmt: skip


def clutter() -> trimesh.Trimesh:
    """Return boxes of many sizes that lie about on a floor."""
    rng = np.random.default_rng(0)
    boxes = [trimesh.creation.box(bounds=[(-5, -5, -0.2), (5, 5, 0)])]
    for _ in range(40):
        turn = trimesh.transformations.random_rotation_matrix(rng.random(3))
        turn[:3, 3] = rng.uniform((-4, -4, 0.2), (4, 4, 1.5))
        boxes.append(trimesh.creation.box(rng.uniform(0.2, 1.6, 3), turn))
    return trimesh.util.concatenate(boxes)


def prepared(name: str, folder: Path) -> Path:
    """Return an OBJ with the UVs and the normals that both bake."""
    options = ao.BakeOptions(size=SIZE, padding=MARGIN, directions=64, backend="ray", threads=THREADS)
    if name in MADE:
        path = folder / f"{name}.obj"
        (colonnade() if name == "colonnade" else clutter()).export(path, include_normals=False)
        options = replace(options, crease_angle=40)
    else:
        path = MESHES / FOUND[name]
    return ao.bake(path, options).save(f"{folder}/{name}/").mesh


def by_cycles(blender: str, mesh: Path, distance: float, size: int = SIZE) -> tuple[np.ndarray, dict[str, object]]:
    """Return a texture of Cycles, and what it tells."""
    picture = mesh.with_name("cycles.exr")
    words = [blender, ROOT / "benchmarks" / "cycles_bake.py", mesh, "-o", picture, "--size", size, "--margin", MARGIN]
    words += ["--samples", SAMPLES, "--distance", distance, "--threads", THREADS, "--json"]
    done = subprocess.run(list(map(str, words)), capture_output=True, text=True)
    if done.returncode:
        sys.exit(done.stderr or done.stdout)
    return read_image(picture), json.loads(done.stdout.splitlines()[-1])


def by_rays(scene: Scene, distance: float, directions: int, size: int = SIZE) -> tuple[Baked, float]:
    """Return a bake of ours, and its seconds."""
    options = ao.BakeOptions(
        size=size, padding=MARGIN, directions=directions, max_distance=distance, backend="ray", threads=THREADS,
        unwrap="keep",
    )  # fmt: skip
    start = time.process_time()
    return bake_scene(scene, options), time.process_time() - start


def plates(blender: str, folder: Path) -> dict[str, object]:
    """Return values in the middle of the floor under a plate of height 1, for distances on either side of it."""
    path = folder / "plates.obj"
    path.write_text(PLATES)
    middle = np.full((1, 2), 0.25)
    rows = []
    for distance in (0.99, 1.01, 2.0, 4.0):
        theirs, told = by_cycles(blender, path, distance, 64)
        ours, _ = by_rays(load_scene(path), distance, 4096, 64)
        values = [float(bilinear(picture, middle, repeats=False)[0]) for picture in (theirs, ours.texture.values)]
        row = {"distance": distance, "expected": min(1.0, distance**-2), "cycles": values[0], "rays": values[1]}
        rows.append({key: round(value, 4) for key, value in row.items()})
        print(", ".join(f"{key} {value:.3f}" for key, value in row.items()))
    return {"cycles": told["tool"], "plates": rows}


def rows_of(name: str, blender: str, folder: Path) -> list[dict[str, object]]:
    """Bake one scene with each distance by both; return a row for each bake."""
    mesh = prepared(name, folder)
    scene = load_scene(mesh)
    diagonal = float(np.linalg.norm(np.ptp(scene.positions, axis=0)))
    baked, _ = by_rays(scene, diagonal, 64)
    points = sample_surface(baked.scene, baked.atlas.mapped, POINTS, 0)
    rows: list[dict[str, object]] = []
    for number, share in enumerate(SHARES):
        distance = share / 100 * diagonal
        integrand = Integrand.from_options(ValueOptions(max_distance=distance), baked.scene)
        rays = RayCount(RAYS, 0, THREADS)
        expected = reference_ao(baked.scene, baked.normals, points, rays, Progress(), integrand)
        efforts = [("cycles", SAMPLES), *(("rays", count) for count in DIRECTIONS)]
        for tool, effort in reversed(efforts) if number % 2 else efforts:
            if tool == "cycles":
                picture, told = by_cycles(blender, mesh, distance)
                seconds = told["processor_seconds"]
            else:
                ours, seconds = by_rays(scene, distance, effort)
                picture = ours.texture.values
            values = bilinear(picture, points.interpolate(baked.atlas.uvs), repeats=baked.atlas.repeats)
            errors = error_statistics(values - expected)
            row = {"scene": name, "triangles": len(scene.faces), "percent": share, "tool": tool, "effort": effort}
            numbers = {"bias": errors.bias, "rmse": errors.rmse, "p99": errors.p99, "seconds": seconds}
            rows.append(row | {key: round(value, 5) for key, value in numbers.items()})
            print(
                f"{name:10} {share:3}% {tool:7} {effort:4}  bias {errors.bias:+.4f}  rmse {errors.rmse:.4f}"
                f"  p99 {errors.p99:.4f}  {seconds:6.2f} s",
                flush=True,
            )
    return sorted(rows, key=lambda row: (row["percent"], row["tool"], row["effort"]))


def main() -> None:
    """Measure the scenes, print a line for each bake, and write the results."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--blender", metavar="PYTHON", required=True, help="an interpreter that has bpy")
    parser.add_argument("--only", nargs="+", choices=(*MADE, *FOUND), metavar="NAME", help="scenes")
    parser.add_argument("--tables", action="store_true", help="write the tables of the documentation")
    given = parser.parse_args()
    known = [*MADE, *(name for name, path in FOUND.items() if (MESHES / path).exists())]
    found = json.loads(RESULTS.read_text()) if RESULTS.exists() else {"rows": []}
    with tempfile.TemporaryDirectory() as folder:
        found |= plates(given.blender, Path(folder))
        for name in known:
            if given.only and name not in given.only:
                continue
            rows = [row for row in found["rows"] if row["scene"] != name]
            rows += rows_of(name, given.blender, Path(folder))
            found["rows"] = sorted(rows, key=lambda row: known.index(row["scene"]))
            RESULTS.write_text(json.dumps(found, indent=2) + "\n")
    print("\n".join(result_tables.distance_table(found["rows"])))
    if given.tables:
        result_tables.main()


if __name__ == "__main__":
    main()
