"""How time and memory of a bake grow with triangles, texels and directions.

    python benchmarks/scale.py [--most N] [--only triangles texels directions]

Each bake is a process of its own, of a bumpy ball that is made here, by rays. A row has its processor seconds, those of
its unwrap by the clock, and the memory of its largest process; and as slopes the powers with which they have grown
since the row before: 1 is in proportion. N is the step of each table at which it ends, 0 the least.
"""

import argparse
import json
import math
import os
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

# What grows, its values, and the faces, side of the texture and directions of the bakes.
TABLES = {
    "triangles": [(10**power, 1024, 64) for power in (4, 5, 6, 7)],
    "texels": [(50_000, side, 64) for side in (512, 1024, 2048, 4096, 8192)],
    "directions": [(50_000, 1024, directions) for directions in (64, 128, 256, 512, 1024)],
}
COLUMNS = "seconds", "unwrap_seconds", "peak_mb"


def main() -> None:
    """Print a table for each quantity, and keep what was measured."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--most", type=int, default=len(TABLES["texels"]))
    parser.add_argument("--only", nargs="*", default=list(TABLES), choices=list(TABLES))
    given = parser.parse_args()
    results = {}
    with tempfile.TemporaryDirectory() as folder:
        for name in given.only:
            print(f"{name:>12} {'seconds':>9} {'slope':>6} {'unwrap s':>9} {'slope':>6} {'peak MB':>9} {'slope':>6}")
            rows = results[name] = []
            for faces, side, directions in TABLES[name][: given.most + 1]:
                mesh = write_ball(Path(folder), faces)
                row = bake(mesh, side, directions)
                row[name] = {"triangles": row["triangles"], "texels": side**2, "directions": directions}[name]
                rows.append(row)
                print(line(name, rows), flush=True)
    path = Path(__file__).parent / "results" / "scale.json"
    kept = json.loads(path.read_text()) if path.exists() else {}
    path.write_text(json.dumps(kept | results, indent=2) + "\n")


def bake(mesh: Path, side: int, directions: int) -> dict[str, float]:
    """Bake in a process of its own, and return what it took."""
    options = ["--size", str(side), "-n", str(directions), "--backend", "ray"]
    command = [sys.executable, "-m", "aoprecalc", "bake", str(mesh), "-o", f"{mesh.parent}/", *options, "--json", "-q"]
    with tempfile.TemporaryFile() as report:
        process = subprocess.Popen(command, stdout=report)
        _, status, used = os.wait4(process.pid, 0)  # of it and of what it has waited for
        if status:
            sys.exit(f"{' '.join(command)} failed")
        report.seek(0)
        told = json.load(report)
    return {
        "triangles": told["input"]["triangles"],
        "seconds": round(used.ru_utime + used.ru_stime, 2),
        "unwrap_seconds": round(told["seconds"]["unwrap"], 2),
        "peak_mb": round(used.ru_maxrss / 1024),
    }


def line(name: str, rows: list[dict[str, float]]) -> str:
    """Return the last row of a table."""
    row = rows[-1]
    cells = [f"{row[name]:12}"]
    for column in COLUMNS:
        slope = ""
        if len(rows) > 1 and row[column] > 0 < rows[-2][column]:
            slope = f"{math.log(row[column] / rows[-2][column]) / math.log(row[name] / rows[-2][name]):.2f}"
        cells.append(f"{row[column]:9} {slope:>6}")
    return " ".join(cells)


def write_ball(folder: Path, faces: int) -> Path:
    """Write a bumpy ball of about as many faces as PLY, if it is not there, and return its path."""
    path = folder / f"ball{faces}.ply"
    if not path.exists():
        positions, triangles = bumpy_ball(max(1, round(math.sqrt(faces / 12))))
        header = (
            f"ply\nformat binary_little_endian 1.0\nelement vertex {len(positions)}\nproperty float x\n"
            f"property float y\nproperty float z\nelement face {len(triangles)}\n"
            "property list uchar int vertex_indices\nend_header\n"
        )
        records = np.zeros(len(triangles), [("count", "u1"), ("corners", "<i4", 3)])
        records["count"], records["corners"] = 3, triangles
        path.write_bytes(header.encode() + positions.astype("<f4").tobytes() + records.tobytes())
    return path


def bumpy_ball(cells: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the positions and faces of a ball of 12 cells^2 triangles, with bumps of many sizes."""
    along = np.tan(np.linspace(-1, 1, cells + 1) * np.pi / 4)
    a, b = np.meshgrid(along, along, indexing="ij")
    one = np.ones_like(a)
    sides = (one, a, b), (-one, b, a), (b, one, a), (a, -one, b), (a, b, one), (b, a, -one)
    points = np.concatenate([np.stack(side, axis=-1).reshape(-1, 3) for side in sides])
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    row, column = np.divmod(np.arange(cells * cells), cells)
    corner = row * (cells + 1) + column
    halves = [(corner, corner + cells + 1, corner + cells + 2), (corner, corner + cells + 2, corner + 1)]
    one_side = np.concatenate([np.stack(half, axis=1) for half in halves])
    faces = np.concatenate([one_side + side * (cells + 1) ** 2 for side in range(6)])
    keys = (points * 2**20).round().astype(np.int64) + 2**20
    first, which = np.unique(keys @ (1 << 42, 1 << 21, 1), return_index=True, return_inverse=True)[1:]
    points, faces = points[first], which[faces]
    rng, height = np.random.default_rng(0), np.zeros(len(points))
    for octave in range(7):
        for _ in range(6):
            wave = rng.normal(size=3)
            wave *= 3 * 2**octave / np.linalg.norm(wave)
            height += 0.18 / 2**octave / math.sqrt(6) * np.sin(points @ wave + rng.uniform(0, 2 * np.pi))
    return points * (1 + height)[:, None], faces


if __name__ == "__main__":
    main()
