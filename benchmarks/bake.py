"""Seconds and memory of whole bakes, each in a process of its own, with the seconds of its stages.

    python benchmarks/bake.py [MESH ...] [--size N ...] [--directions N] [--runs N] [--json FILE]

Without meshes, a torus of 1k, 10k and 100k triangles is made. Medians are printed.
"""

import argparse
import json
import platform
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import trimesh


def main() -> None:
    """Run every mesh at every size and print one line each."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("meshes", nargs="*", type=Path)
    parser.add_argument("--size", type=int, nargs="+", default=[1024])
    parser.add_argument("--directions", type=int, default=1000)
    parser.add_argument("--runs", type=int, default=3)
    parser.add_argument("--json", type=Path)
    given = parser.parse_args()
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        print(f"{'mesh':32} {'size':>5} {'total s':>8} {'visibility':>10} {'Mtexdir/s':>9} {'MB':>6}")
        for mesh in given.meshes or make_meshes(Path(folder)):
            for size in given.size:
                row = measure(mesh.resolve(), size, given.directions, given.runs, Path(folder))
                rows.append(row)
                print(
                    f"{mesh.name:32} {size:5} {row['seconds']:8.2f} {row['visibility']:10.2f} "
                    f"{row['rate'] / 1e6:9.0f} {row['megabytes']:6.0f}"
                )
        startup = statistics.median(run(["--help"], folder)[0] for _ in range(5))
        print(f"aoprecalc --help: {startup:.3f} s")
    if given.json:
        result = {
            "machine": platform.platform(),
            "renderer": rows[0]["renderer"],
            "help_seconds": startup,
            "bakes": rows,
        }
        given.json.write_text(json.dumps(result, indent=2) + "\n")


def make_meshes(folder: Path) -> list[Path]:
    """Write a torus in three finenesses."""
    paths = []
    for across in (16, 50, 160):
        path = folder / f"torus-{across * across * 4}.ply"
        trimesh.creation.torus(1.0, 0.4, major_sections=2 * across, minor_sections=across).export(path)
        paths.append(path)
    return paths


def measure(mesh: Path, size: int, directions: int, runs: int, folder: Path) -> dict[str, object]:
    """Bake `runs` times; return medians, and the greatest memory."""
    words = ["bake", str(mesh), "-o", f"{folder}/", "--size", str(size), "-n", str(directions), "--json", "-q"]
    done = [run(words, str(folder)) for _ in range(runs)]
    reports = [json.loads(output) for _, output in done]
    visibility = statistics.median(report["seconds"]["visibility"] for report in reports)
    return {
        "mesh": mesh.name,
        "triangles": reports[0]["input"]["triangles"],
        "size": size,
        "directions": directions,
        "renderer": reports[0]["renderer"],
        "shadow_size": reports[0]["shadow_size"],
        "seconds": statistics.median(seconds for seconds, _ in done),
        "unwrap": statistics.median(report["seconds"]["unwrap"] for report in reports),
        "visibility": visibility,
        "rate": reports[0]["texels"]["valid"] * directions / visibility,
        # The greatest of all children so far: right for runs of growing size.
        "megabytes": resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1024,
    }


def run(words: list[str], folder: str) -> tuple[float, str]:
    """Run the command line once; return its seconds and standard output."""
    start = time.perf_counter()
    done = subprocess.run(
        [sys.executable, "-m", "aoprecalc", *words], cwd=folder, capture_output=True, text=True, check=True
    )
    return time.perf_counter() - start, done.stdout


if __name__ == "__main__":
    main()
