"""How fast textures of the same error are made: this project beside Blender's Cycles, libigl and MeshLab.

    python benchmarks/speed.py [--blender PYTHON] [--peers PYTHON] [--only NAME ...] [--runs N] [--tables]

Each mesh of ../shared/meshes that is listed below (else a torus made here) is baked on the same UVs at 1024 x 1024
texels by each tool with ever more directions or rays; the error of each texture is what `aoprecalc verify` finds. From
these points the time at the error of Cycles' 64 samples is read (log-log, between the two nearest), and the
ratio to its time. Seconds are of visibility and finishing, without reading, unwrapping, writing; medians of --runs, but
of one run for what takes more than five seconds.

PYTHON of --blender has bpy, that of --peers libigl and pymeshlab (benchmarks/requirements.txt); a tool that is missing
is a line that says so. libigl and MeshLab cast rays from vertices: of them only rays a second are told.

Then bakes of growing size, one thing at a time: triangles, texels, directions. Everything goes into
benchmarks/results/speed.json, charts (with matplotlib) into docs/pictures/speed.png; with --tables the tables of the
documentation are written, too (result_tables.py). `--only charts` measures nothing and draws the charts again.
"""

import argparse
import json
import os
import platform
import statistics
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
import result_tables
import trimesh
from result_tables import LONG, speed_table

ROOT = Path(__file__).resolve().parents[1]
MESHES = ROOT.parent / "shared" / "meshes"
RESULTS = ROOT / "benchmarks" / "results" / "speed.json"

# name, mesh, shading
CASES = [
    ("ogre", "jerry_ogre/bs_rest.obj", "smooth"),
    ("ogre", "jerry_ogre/bs_rest.obj", "flat"),
    ("bigguy", "bigguy.obj", "smooth"),
    ("bigguy", "bigguy.obj", "flat"),
]
SIZE = 1024
EFFORTS = {"gl": (64, 96, 128, 192, 256, 512, 1000), "ray": (64, 96, 128, 192, 256), "cycles": (16, 64)}
NAMES = {"gl": "aoprecalc, maps", "ray": "aoprecalc, rays", "cycles": "Cycles"}
PEERS = {"libigl": "igl", "MeshLab": "pymeshlab"}


def main() -> None:
    """Measure, print a line each, write results, charts and the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--blender", metavar="PYTHON", help="an interpreter that has bpy")
    parser.add_argument("--peers", metavar="PYTHON", default=sys.executable, help="one that has libigl and pymeshlab")
    parser.add_argument(
        "--only", nargs="+", default=(), metavar="NAME", help="mesh, mesh/shading, rays, growth or charts"
    )
    parser.add_argument("--runs", type=int, default=3)
    parser.add_argument("--tables", action="store_true", help="write the tables of the documentation")
    given = parser.parse_args()
    found = json.loads(RESULTS.read_text()) if RESULTS.exists() else {"points": [], "rays": [], "growth": []}
    with tempfile.TemporaryDirectory() as folder:
        for name, path, shading in CASES if MESHES.exists() else [made(Path(folder))]:
            key = f"{name}/{shading}"
            if not given.only or name in given.only or key in given.only:
                rows = points(key, MESHES / path, shading, given, Path(folder))
                found["points"] = [row for row in found["points"] if row["key"] != key] + rows
                write(found)
        if not given.only or "rays" in given.only:
            found["rays"] = rays(given.peers, Path(folder))
            write(found)
        if not given.only or "growth" in given.only:
            found["growth"] = growth(given.runs, Path(folder))
            write(found)
    print("\n".join(speed_table(found["points"])))
    draw_charts(found)
    if given.tables:
        result_tables.main()


def write(found: dict[str, list[dict[str, object]]]) -> None:
    """Write what has been measured so far."""
    machine = {"machine": platform.platform(), "cores": os.cpu_count()}
    RESULTS.write_text(json.dumps(machine | found, indent=2) + "\n")


def made(folder: Path) -> tuple[str, Path, str]:
    """Make a mesh where there is none to measure."""
    path = folder / "torus.obj"
    trimesh.creation.torus(1.0, 0.4, major_sections=96, minor_sections=48).export(path)
    return "torus", path, "smooth"


def points(key: str, mesh: Path, shading: str, given: argparse.Namespace, folder: Path) -> list[dict[str, object]]:
    """Bake one mesh by every tool and effort; return a row of seconds, error and memory for each."""
    place = folder / key.replace("/", "-")
    place.mkdir()
    common = ["--size", SIZE, "--normals", "flat" if shading == "flat" else "auto"]
    rows = []
    for tool, efforts in EFFORTS.items():
        if tool == "cycles" and not given.blender:
            print(f"{key}: no interpreter with bpy was named")
            continue
        for effort in efforts:
            if tool == "cycles":
                row = cycles(given.blender, next(place.glob("*_ao.obj")), effort)
            else:
                words = ["bake", mesh, "-o", f"{place}/", *common, "--backend", tool, "-n", effort, "--json", "-q"]
                done = [aoprecalc(*words)]
                report = json.loads(done[0][0])
                short = report["seconds"]["visibility"] < LONG
                done += [aoprecalc(*words) for _ in range(given.runs - 1 if short else 0)]
                verified = json.loads(aoprecalc("verify", next(place.glob("*_ao.obj")), "--json", "-q")[0])
                times = [json.loads(text)["seconds"] for text, _ in done]
                seconds = [time["visibility"] + time["finish"] for time in times]
                row = {"seconds": statistics.median(seconds), "spread": [min(seconds), max(seconds)]}
                row |= {"whole": statistics.median(time["total"] for time in times)}
                row |= {"rmse": verified["levels"][0]["rmse"], "megabytes": max(size for _, size in done)}
                row |= {"texels": report["texels"]["valid"], "shadow_size": report["shadow_size"]}
            rows.append({"key": key, "tool": tool, "effort": effort} | row)
            print(f"{key:16} {tool:7} {effort:5} {row['seconds']:7.2f} s  rmse {row['rmse']:.4f}", flush=True)
    return rows


def cycles(blender: str, mesh: Path, samples: int) -> dict[str, object]:
    """Bake with Cycles onto the UVs of a mesh that was baked before."""
    picture = mesh.with_name("cycles.exr")
    script = ROOT / "benchmarks" / "cycles_bake.py"
    text, megabytes = run(blender, script, mesh, "-o", picture, "--size", SIZE, "--samples", samples, "--json")
    verified = json.loads(aoprecalc("verify", mesh, "--texture", picture, "--json", "-q")[0])
    told = json.loads(text.splitlines()[-1])
    return {"seconds": told["seconds"], "rmse": verified["levels"][0]["rmse"], "megabytes": megabytes}


def rays(python: str, folder: Path) -> list[dict[str, object]]:
    """Return how many rays a second the peers cast from the vertices of a bumpy ball."""
    ball = trimesh.creation.icosphere(subdivisions=6)
    ball.vertices *= 1 + 0.2 * np.sin(7 * ball.vertices).prod(axis=1, keepdims=True)
    path = folder / "ball.ply"
    ball.export(path)
    rows = []
    for name, module in PEERS.items():
        done = subprocess.run(
            [python, str(ROOT / "benchmarks" / "peer_rays.py"), module, str(path)], capture_output=True, text=True
        )
        if done.returncode:
            print(f"{name}: {(done.stderr.strip().splitlines() or ['failed'])[-1]}")
            continue
        row = {"tool": name} | json.loads(done.stdout.splitlines()[-1])
        print(f"{row['tool']}: {row['rays'] / row['seconds'] / 1e6:.1f} M rays/s")
        rows.append(row)
    return rows


def growth(runs: int, folder: Path) -> list[dict[str, object]]:
    """Bake a torus of more and more triangles, texels and directions, one at a time."""
    rows = []
    for what, steps in {
        "triangles": [(across, 1024, 256) for across in (16, 50, 158, 500)],
        "texels": [(50, size, 256) for size in (512, 1024, 2048, 4096)],
        "directions": [(50, 1024, count) for count in (64, 256, 1000, 4000)],
    }.items():
        for across, size, directions in steps:
            path = folder / f"torus-{across}.ply"
            if not path.exists():
                write_torus(path, across)
            words = ["bake", path, "-o", f"{folder}/", "--unwrap", "keep", "--size", size, "-n", directions]
            done = [aoprecalc(*words, "--json", "-q") for _ in range(runs if size < 2048 and directions < 4000 else 1)]
            reports = [json.loads(text) for text, _ in done]
            row = {"what": what, "triangles": reports[0]["input"]["triangles"], "size": size}
            row |= {"texels": reports[0]["texels"]["valid"], "directions": directions}
            row |= {"seconds": statistics.median(report["seconds"]["visibility"] for report in reports)}
            row |= {"megabytes": max(megabytes for _, megabytes in done)}
            rows.append(row)
            print(f"{what:10} {row[what]:>9,} {row['seconds']:7.2f} s {row['megabytes']:6.0f} MB", flush=True)
    return rows


def write_torus(path: Path, across: int) -> None:
    """Write a torus of 4 across^2 triangles that is laid out in the unit square, as an OBJ's UVs would be."""
    around, along = 2 * across, across
    u, v = (grid.ravel() for grid in np.meshgrid(np.arange(around + 1), np.arange(along + 1)))
    a, b = 2 * np.pi * (u % around) / around, 2 * np.pi * (v % along) / along
    ring = 1 + 0.4 * np.cos(b)
    corners = np.column_stack([ring * np.cos(a), ring * np.sin(a), 0.4 * np.sin(b)])
    first = (np.arange(along)[:, None] * (around + 1) + np.arange(around)).ravel()
    right, up = first + 1, first + around + 1
    faces = np.concatenate([np.column_stack([first, right, up + 1]), np.column_stack([first, up + 1, up])])
    visual = trimesh.visual.TextureVisuals(uv=np.column_stack([u / around, v / along]))
    trimesh.Trimesh(corners, faces, visual=visual, process=False).export(path)


def draw_charts(found: dict[str, list[dict[str, object]]]) -> None:
    """Draw error over time for each mesh, and time over triangles, texels and directions."""
    try:
        from matplotlib import pyplot, ticker
    except ModuleNotFoundError:
        print("no charts: matplotlib is not installed")
        return

    def in_words(value: float, _: int) -> str:
        return f"{value:,g}" if value < 1e6 else f"{value / 1e6:g} M"

    keys = list(dict.fromkeys(row["key"] for row in found["points"]))
    kinds = list(dict.fromkeys(row["what"] for row in found["growth"]))
    figure, axes = pyplot.subplots(2, max(len(keys), len(kinds), 1), figsize=(14, 7), squeeze=False)
    for plot, key in zip(axes[0], keys, strict=False):
        for tool, name in NAMES.items():
            rows = [row for row in found["points"] if row["key"] == key and row["tool"] == tool]
            plot.loglog([row["seconds"] for row in rows], [row["rmse"] for row in rows], "o-", label=name, markersize=4)
        plot.set(title=key, xlabel="seconds", ylabel="RMSE as rendered")
    for plot, what in zip(axes[1], kinds, strict=False):
        rows = [row for row in found["growth"] if row["what"] == what]
        size, seconds = np.array([[row[what], row["seconds"]] for row in rows], float).T
        plot.loglog(size, seconds, "o-", markersize=4)
        plot.loglog(size, seconds[-1] * size / size[-1], ":", color="gray", label="linear")
        plot.set(title=f"torus, more {what}", xlabel=what, ylabel="seconds of visibility")
    for plot in axes.flat:
        plot.set_visible(plot.has_data())
        plot.grid(alpha=0.3, which="both")
        for axis in (plot.xaxis, plot.yaxis):
            axis.set_major_formatter(in_words)
            axis.set_minor_formatter(ticker.NullFormatter())
    for plot in axes[0]:
        plot.yaxis.set_major_locator(ticker.LogLocator(subs=(1, 2, 3, 5)))
    tools, linear = (plot.get_legend_handles_labels() for plot in (axes[0][0], axes[1][0]))
    figure.legend(tools[0] + linear[0], tools[1] + linear[1], loc="lower right", bbox_to_anchor=(0.95, 0.2))
    figure.tight_layout()
    figure.savefig(ROOT / "docs" / "pictures" / "speed.png", dpi=100)


def aoprecalc(*words: object) -> tuple[str, float]:
    """Run the command line; return its standard output and its memory."""
    return run(sys.executable, "-m", "aoprecalc", *words)


def run(*words: object) -> tuple[str, float]:
    """Run a program; return its standard output and its greatest memory in megabytes."""
    with tempfile.TemporaryFile("w+") as out, tempfile.TemporaryFile("w+") as errors:
        child = subprocess.Popen([str(word) for word in words], stdout=out, stderr=errors)
        _, status, usage = os.wait4(child.pid, 0)
        child.returncode = os.waitstatus_to_exitcode(status)
        out.seek(0)
        errors.seek(0)
        if child.returncode:
            sys.exit(errors.read() or out.read())
        return out.read(), usage.ru_maxrss / 1024


if __name__ == "__main__":
    main()
