"""Quality and speed of the sphere methods, compared with scikit-learn's KMeans and MorphIt.

    python benchmarks/spheres.py [--peers PYTHON] [--only NAME ...] [--tables]

Measures the meshes of ../shared/meshes that exist, or else a generated torus, in four parts:

quality     silhouettes, surface error and seconds of each method, with 20 to 200 spheres
kmeans      Lloyd's algorithm and scikit-learn's, on the same samples from the same centres to the same fixed point
scale       method shadow on the same mesh, scaled by 0.001 and by 1000
collision   fraction of new samples in the spheres of method collision, and of lloyd with --radius cover

Seconds cover all of `fit_sphere_set`: sampling, fitting and measuring; for MorphIt, its `pack`; for kmeans, medians of
three runs of the iteration alone. PYTHON has morphit-rs
(benchmarks/requirements.txt). MorphIt's steps are in units of length: it gets each mesh at its own size and with a
longest side of 0.2 and of 2, and the best of the three counts. A peer that is missing is a line that says so.

--only takes names of parts, meshes, methods, numbers of spheres, or several with slashes between them, such as
quality/bunny/100. Everything goes into benchmarks/results/spheres.json, in which such a run replaces only its own rows,
and with --tables the tables of the documentation are written (result_tables.py).
"""

import argparse
import json
import os
import platform
import subprocess
import tempfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from statistics import median
from time import perf_counter

import numpy as np
import result_tables
import trimesh
from result_tables import METHODS, USUAL, Row

from aoprecalc.io import load_scene
from aoprecalc.options import SphereOptions
from aoprecalc.progress import Progress
from aoprecalc.spheres import fit_sphere_set, measure_quality
from aoprecalc.spheres.lloyd import lloyd
from aoprecalc.spheres.sampling import NormalizedFrame, sample_points, signed_distances
from aoprecalc.types import Scene

ROOT = Path(__file__).resolve().parents[1]
MESHES = ROOT.parent / "shared" / "meshes"
RESULTS = ROOT / "benchmarks" / "results" / "spheres.json"

# name, mesh, numbers of spheres
CASES = [
    ("bunny", "stanford-bunny.obj", (20, 64, 100, 200)),
    ("bigguy", "bigguy.obj", (100,)),
    ("ogre", "jerry_ogre/bs_rest.obj", (100,)),
    ("fruit fly", "fruitfly_assembled_welded.ply", (100, 200)),
]
MEASURES = ("silhouette_iou", "silhouette_iou_min", "leak", "spill", "surface_error_mean")
SCALES = (1.0, 1e-3, 1e3)
SIZES = (None, 0.2, 2.0)  # longest sides at which MorphIt gets a mesh; None: its own
FRESH, FRESH_SEED = 50_000, 12_345  # samples that no fit uses
NEAR = 0.001  # of the diagonal: a sample this close to a sphere counts as contained

MORPHIT = """
import json, sys, time
import morphit_rs, numpy
given = numpy.load(sys.argv[1])
mesh = morphit_rs.Mesh.from_arrays(given["positions"], given["faces"])
config = morphit_rs.Config.preset("MorphIt-B", num_spheres=int(sys.argv[2]), seed=0)
start = time.perf_counter()
found = morphit_rs.pack(mesh, config)
seconds = time.perf_counter() - start
print(json.dumps({"seconds": seconds, "centers": found.centers.tolist(), "radii": found.radii.tolist()}))
"""


def main() -> None:
    """Measure the selected rows, print a line for each, and write results and tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--peers", metavar="PYTHON", help="an interpreter that has morphit-rs")
    parser.add_argument(
        "--only", nargs="+", default=(), metavar="NAME", help="parts, meshes, methods, or part/mesh/..."
    )
    parser.add_argument("--tables", action="store_true", help="write the tables of the documentation")
    given = parser.parse_args()
    scenes: dict[str, Scene] = {}
    for key, name, path, work in plan(given.peers):
        if given.only and not any(set(only.split("/")) <= set(key.split("/")) for only in given.only):
            continue
        if name not in scenes:
            scenes[name] = load_scene(path) if path else torus()
        try:
            row = {"key": key, "mesh": name, "triangles": len(scenes[name].faces)} | work(scenes[name])
        except PeerMissing as missing:
            print(f"{key}: {missing}")
            continue
        write(row)
        numbers = "  ".join(f"{what} {value:.4g}" for what, value in row.items() if isinstance(value, float))
        print(f"{key:32} {numbers}", flush=True)
    if given.tables:
        result_tables.main()


class PeerMissing(Exception):  # noqa: N818
    """Another tool is missing or failed; the message says which and why."""


def plan(peers: str | None) -> list[tuple[str, str, Path | None, Callable[[Scene], Row]]]:
    """Return a key, a mesh and its file (None: made here), and the work, for every row, in the order of the tables."""
    existing = [(name, MESHES / path, counts) for name, path, counts in CASES if (MESHES / path).exists()]
    cases = existing or [("torus", None, (USUAL,))]
    rows: list[tuple[str, str, Path | None, Callable[[Scene], Row]]] = []
    for name, path, counts in cases:
        for count in counts:
            for method in METHODS:
                options = SphereOptions(spheres=count, method="lloyd" if method == "MorphIt-B" else method)

                def work(scene: Scene, options: SphereOptions = options, method: str = method) -> Row:
                    return morphit(scene, options, peers) if method == "MorphIt-B" else measure_method(scene, options)

                rows.append((f"quality/{name}/{count}/{method}", name, path, work))
    rows += [(f"kmeans/{name}", name, path, kmeans) for name, path, _ in cases]
    for scale in SCALES:
        name, path, _ = cases[0]
        rows.append((f"scale/{name}/{scale:g}", name, path, lambda scene, scale=scale: scaled(scene, scale)))
    rows += [(f"collision/{name}", name, path, collision) for name, path, _ in cases]
    return rows


def measure_method(scene: Scene, options: SphereOptions) -> Row:
    """Fit by one of our methods."""
    start = perf_counter()
    spheres, measured = fit_sphere_set(scene, options, Progress())
    seconds = perf_counter() - start
    row: Row = {"spheres": options.spheres, "made": len(spheres), "method": options.method, "seconds": seconds}
    return row | {what: measured[what] for what in MEASURES}


def morphit(scene: Scene, options: SphereOptions, peers: str | None) -> Row:
    """Fit by MorphIt at several sizes of the mesh; the best silhouettes count."""
    if not peers:
        raise PeerMissing("no interpreter with morphit-rs was named")
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        for size in SIZES:
            scale = size / np.ptp(scene.positions, axis=0).max() if size else 1.0
            path = Path(folder) / "mesh.npz"
            np.savez(path, positions=scene.positions * scale, faces=scene.faces)
            words = [peers, "-c", MORPHIT, str(path), str(options.spheres)]
            try:
                done = subprocess.run(words, capture_output=True, text=True)
            except OSError as error:
                raise PeerMissing(str(error)) from error
            if done.returncode:
                raise PeerMissing((done.stderr.strip().splitlines() or ["failed"])[-1])
            result = json.loads(done.stdout.splitlines()[-1])
            centers, radii = np.array(result["centers"]).reshape(-1, 3) / scale, np.array(result["radii"]) / scale
            measured = measure_quality(scene, centers, radii, options, Progress())
            row: Row = {"spheres": options.spheres, "made": len(radii), "method": "MorphIt-B"}
            row |= {"longest_side": size, "seconds": result["seconds"]}
            rows.append(row | {what: measured[what] for what in MEASURES})
    return max(rows, key=lambda row: row["silhouette_iou"])


def kmeans(scene: Scene) -> Row:
    """Run Lloyd's algorithm and scikit-learn's alternately, three times each."""
    try:
        from sklearn.cluster import KMeans
    except ModuleNotFoundError as error:
        raise PeerMissing(f"scikit-learn: {error}") from error
    options = SphereOptions(spheres=USUAL)
    frame = NormalizedFrame.from_positions(scene.positions)
    points = sample_points(scene, frame, options.samples, USUAL, np.random.default_rng(options.seed))
    initial, max_iterations = points[:USUAL], options.max_iterations
    estimator = KMeans(USUAL, init=initial, n_init=1, tol=0, max_iter=max_iterations, algorithm="lloyd")
    seconds = []
    for _ in range(3):
        start = perf_counter()
        ours = lloyd(points, initial, max_iterations, Progress())
        between = perf_counter()
        theirs = estimator.fit(points)
        seconds.append((between - start, perf_counter() - between))
    our_seconds, their_seconds = (median(column) for column in zip(*seconds, strict=True))
    inertia = float(np.square(ours.distances).sum())
    row: Row = {"spheres": USUAL, "seconds": our_seconds, "their_seconds": their_seconds}
    row |= {"ratio": their_seconds / our_seconds, "iterations": ours.iterations}
    row |= {"their_iterations": int(theirs.n_iter_)}
    distance = float(np.abs(theirs.cluster_centers_ - ours.centers).max())
    return row | {"inertia": inertia, "their_inertia": float(theirs.inertia_), "centers_apart": distance}


def scaled(scene: Scene, scale: float) -> Row:
    """Fit by method shadow to a mesh `scale` times as large."""
    larger = replace(scene, positions=scene.positions * scale)
    return {"scale": scale} | measure_method(larger, SphereOptions(spheres=USUAL, method="shadow"))


def collision(scene: Scene) -> Row:
    """Measure the fraction of new samples in the spheres, and the spill: collision, and lloyd with radius cover."""
    frame = NormalizedFrame.from_positions(scene.positions)
    fresh = sample_points(scene, frame, FRESH, 1, np.random.default_rng(FRESH_SEED))
    row: Row = {"spheres": USUAL}
    for prefix, options in (
        ("", SphereOptions(spheres=USUAL, method="collision")),
        ("cover_", SphereOptions(spheres=USUAL, radius="cover")),
    ):
        spheres, quality = fit_sphere_set(scene, options, Progress())
        signed = signed_distances(fresh, frame.to_normalized(spheres.centers), spheres.radii / frame.scale)
        row |= {f"{prefix}held": float((signed <= NEAR * frame.diagonal).mean())}
        row |= {f"{prefix}spill": quality["spill"], f"{prefix}silhouette_iou": quality["silhouette_iou"]}
    return row


def torus() -> Scene:
    """Generate a mesh as a stand-in for missing ones."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "torus.ply"
        trimesh.creation.torus(1.0, 0.4, major_sections=96, minor_sections=48).export(path)
        return load_scene(path)


def write(row: Row) -> None:
    """Replace the row with the same key, in the order of the plan."""
    rows = json.loads(RESULTS.read_text())["rows"] if RESULTS.exists() else []
    rows = [old for old in rows if old["key"] != row["key"]] + [row]
    order = {key: place for place, (key, *_) in enumerate(plan(None))}
    rows.sort(key=lambda each: order.get(each["key"], len(order)))
    machine = {"machine": platform.platform(), "cores": os.cpu_count()}
    RESULTS.parent.mkdir(exist_ok=True)
    RESULTS.write_text(json.dumps(machine | {"rows": rows}, indent=2) + "\n")


if __name__ == "__main__":
    main()
