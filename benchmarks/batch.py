"""How long batches take beside single runs, what they cost beyond the work, and what a cluster costs beyond that.

    python benchmarks/batch.py [--assets N] [--unchanged N] [--bake OPTIONS] [--runs N] [--tables]

Meshes are made here. All times are of whole commands, with llvmpipe on one thread (LP_NUM_THREADS=1) and without a
cache, medians of --runs; what is compared runs in turns.
- single     `aoprecalc bake` for each asset, one after the other, added up
- jobs       `aoprecalc batch --jobs 2`
- scheduler  `aoprecalc batch --scheduler`, two Dask workers of one thread each on this machine
- overhead   `aoprecalc batch --jobs 1` less the seconds of its assets' own reports, an asset
- unchanged  the batch once more, with --unchanged assets
Everything goes into benchmarks/results/batch.json, with --tables also the tables of the documentation
(result_tables.py).
"""

import argparse
import json
import os
import platform
import shlex
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import result_tables
import trimesh

RESULTS = Path(__file__).resolve().with_name("results") / "batch.json"
COMMAND = [sys.executable, "-c", "from aoprecalc.cli import main; main()"]
CLUSTER = """
import sys
from distributed import LocalCluster
if __name__ == "__main__":
    with LocalCluster(n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None) as cluster:
        print(cluster.scheduler_address, flush=True)
        sys.stdin.read()
"""


def make_meshes(folder: Path, count: int) -> list[Path]:
    """Write small meshes, no two alike."""
    folder.mkdir(parents=True)
    chance = np.random.default_rng(0)
    meshes = []
    for number in range(count):
        shapes = [
            trimesh.creation.torus(1, chance.uniform(0.2, 0.5), major_sections=24, minor_sections=12),
            trimesh.creation.cylinder(chance.uniform(0.1, 0.4), chance.uniform(1, 3), sections=24),
            trimesh.creation.box(chance.uniform(0.3, 1.5, 3)),
        ]
        mesh = trimesh.util.concatenate([shapes[0], shapes[1 + number % 2]])
        meshes.append(folder / f"asset-{number:04}.obj")
        mesh.export(meshes[-1])
    return meshes


def seconds(words: list[str]) -> float:
    started = time.perf_counter()
    subprocess.run([*COMMAND, *words], check=True, capture_output=True)
    return time.perf_counter() - started


def batch(meshes: Path, output: Path, bake: str, *words: str) -> float:
    shutil.rmtree(output, ignore_errors=True)
    return seconds(["batch", str(meshes), "-o", str(output), "--no-cache", "--bake", bake, *words])


def own_work(output: Path) -> float:
    reports = [json.loads(file.read_text()) for file in output.rglob("*_report.json")]
    return sum(report["seconds"]["total"] for report in reports)


def main() -> None:
    parser = argparse.ArgumentParser(description="Time batches.")
    parser.add_argument("--assets", type=int, default=200)
    parser.add_argument("--unchanged", type=int, default=1000)
    parser.add_argument("--bake", default="--size 256 -n 256")
    parser.add_argument("--runs", type=int, default=3)
    parser.add_argument("--tables", action="store_true", help="write the tables of the documentation")
    given = parser.parse_args()
    os.environ["LP_NUM_THREADS"] = "1"
    found: dict[str, list[float]] = {name: [] for name in ("single", "jobs", "scheduler", "overhead", "unchanged")}
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        meshes = make_meshes(folder / "meshes", given.assets)
        for _ in range(given.runs):
            single = folder / "single"
            single.mkdir(exist_ok=True)
            found["single"].append(
                sum(seconds(["bake", str(mesh), "-o", f"{single}/", *shlex.split(given.bake)]) for mesh in meshes)
            )
            found["jobs"].append(batch(folder / "meshes", folder / "jobs", given.bake, "--jobs", "2"))
            with subprocess.Popen(
                [sys.executable, "-c", CLUSTER], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
            ) as cluster:
                address = cluster.stdout.readline().strip()
                found["scheduler"].append(
                    batch(folder / "meshes", folder / "scheduler", given.bake, "--scheduler", address)
                )
                cluster.stdin.close()
            alone = batch(folder / "meshes", folder / "alone", given.bake, "--jobs", "1")
            found["overhead"].append((alone - own_work(folder / "alone")) / given.assets)
            print({name: round(values[-1], 3) for name, values in found.items() if values}, flush=True)
        many = make_meshes(folder / "many", given.unchanged)[0].parent
        batch(many, folder / "unchanged", "--size 32 -n 8", "--jobs", "2")
        again = ["batch", str(many), "-o", str(folder / "unchanged"), "--no-cache", "--bake", "--size 32 -n 8"]
        found["unchanged"] = [seconds(again) for _ in range(max(3, given.runs))]
    medians = {name: round(statistics.median(values), 4) for name, values in found.items()}
    ratios = {
        "jobs / single": round(medians["jobs"] / medians["single"], 3),
        "scheduler / jobs": round(medians["scheduler"] / medians["jobs"], 3),
    }
    document = {
        "machine": f"{platform.machine()}, {os.cpu_count()} cores",
        "assets": given.assets,
        "unchanged_assets": given.unchanged,
        "bake": given.bake,
        "seconds": medians,
        "ratios": ratios,
        "runs": {name: [round(value, 3) for value in values] for name, values in found.items()},
    }
    RESULTS.write_text(json.dumps(document, indent=2) + "\n")
    print(json.dumps({**medians, **ratios}, indent=2))
    if given.tables:
        result_tables.main()


if __name__ == "__main__":
    main()
