"""Errors of textures as rendered, and the time of baking them.

    python benchmarks/fidelity.py [--blender PYTHON] [--only NAME ...] [--tables]

Bakes the meshes of ../shared/meshes that exist (else a generated torus) with both backends and, if an interpreter
that has `bpy` is named, with Blender's Cycles, smooth and flat; measures every texture with `aoprecalc verify`; writes
benchmarks/results/fidelity.json, in which a run with --only replaces only its own rows, and with --tables the tables
of the documentation (result_tables.py).
"""

import argparse
import json
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import result_tables
import trimesh

from aoprecalc.io import load_scene, read_image
from aoprecalc.mesh.surface import sample_surface
from aoprecalc.texture_lookup import bilinear

ROOT = Path(__file__).resolve().parents[1]
MESHES = ROOT.parent / "shared" / "meshes"
RESULTS = ROOT / "benchmarks" / "results" / "fidelity.json"
AUTHORED = MESHES / "jerry_ogre" / "ao_rest.png"

# name, mesh, size, shading, tools
CASES = [
    ("ogre", "jerry_ogre/bs_rest.obj", 1024, "smooth", ("gl", "ray", "cycles")),
    ("ogre", "jerry_ogre/bs_rest.obj", 1024, "flat", ("gl", "ray", "cycles")),
    ("bigguy", "bigguy.obj", 1024, "smooth", ("gl", "ray", "cycles")),
    ("bigguy", "bigguy.obj", 1024, "flat", ("gl", "ray", "cycles")),
    ("bunny", "stanford-bunny.obj", 1024, "smooth", ("gl", "ray", "cycles")),
    ("spot", "spot.obj", 1024, "smooth", ("gl", "ray", "cycles")),
    ("fruit fly", "fruitfly_assembled_welded.ply", 4096, "smooth", ("gl",)),
]
CYCLES_SAMPLES = 64


def main() -> None:
    """Measure the selected rows, print a line for each, and write the results."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--blender", metavar="PYTHON", help="an interpreter that has bpy")
    parser.add_argument("--only", nargs="+", default=(), metavar="NAME", help="meshes, or mesh/shading/tool")
    parser.add_argument("--tables", action="store_true", help="write the tables of the documentation")
    given = parser.parse_args()
    rows = json.loads(RESULTS.read_text())["rows"] if RESULTS.exists() else []
    with tempfile.TemporaryDirectory() as folder:
        for name, path, size, shading, tools in CASES if MESHES.exists() else [generated(Path(folder))]:
            for tool in tools:
                key = f"{name}/{shading}/{tool}"
                if given.only and not any(key == only or name == only for only in given.only):
                    continue
                if tool == "cycles" and not given.blender:
                    print(f"{key}: no interpreter with bpy was named")
                    continue
                row = measure(name, MESHES / path, size, shading, tool, given.blender, Path(folder))
                rows = [old for old in rows if old["key"] != key] + [row]
                write(rows)
                print(f"{key:24} {row['seconds']:7.1f} s  rmse {row['rmse']:.4f}  p99 {row['p99']:.4f}", flush=True)
    if given.tables:
        result_tables.main()


def write(rows: list[dict[str, object]]) -> None:
    """Write the rows in the order of the cases."""
    order = [f"{name}/{shading}/{tool}" for name, _, _, shading, tools in CASES for tool in tools]
    rows.sort(key=lambda row: order.index(row["key"]) if row["key"] in order else len(order))
    RESULTS.write_text(json.dumps({"rows": rows}, indent=2) + "\n")


def generated(folder: Path) -> tuple[str, Path, int, str, tuple[str, ...]]:
    """Generate a mesh as a stand-in for missing ones."""
    path = folder / "torus.ply"
    trimesh.creation.torus(1.0, 0.4, major_sections=96, minor_sections=48).export(path)
    return "torus", path, 1024, "smooth", ("gl", "ray")


def measure(
    name: str, mesh: Path, size: int, shading: str, tool: str, blender: str | None, folder: Path
) -> dict[str, object]:
    """Bake with one tool and return its row."""
    work = folder / f"{name}-{shading}"
    work.mkdir(exist_ok=True)
    normals = "flat" if shading == "flat" else "auto"
    backend = "gl" if tool == "cycles" else tool
    done = list(work.glob("*_ao.obj")) + list(work.glob("*_ao.ply"))
    if tool != "cycles" or not done:
        words = ["bake", mesh, "-o", f"{work}/", "--size", size, "--normals", normals, "--backend", backend, "--json"]
        start = time.perf_counter()
        report = json.loads(aoprecalc(*words))
        row = {"seconds": time.perf_counter() - start, "directions": report["directions"]}
    baked = next(iter([*work.glob("*_ao.obj"), *work.glob("*_ao.ply")]))
    texture = baked.with_suffix(".png")
    label = f"aoprecalc, {tool}"
    if tool == "cycles":
        texture = work / "cycles.exr"
        script = ROOT / "benchmarks" / "cycles_bake.py"
        words = [blender, script, baked, "-o", texture, "--size", size, "--samples", CYCLES_SAMPLES, "--json"]
        result = json.loads(run(*words).splitlines()[-1])
        label, row = f"{result['tool']}, {result['samples']} samples", {"seconds": result["seconds"]}
    verified = json.loads(aoprecalc("verify", baked, "--texture", texture, "--json"))
    levels = verified["levels"]
    row |= {"key": f"{name}/{shading}/{tool}", "mesh": name, "triangles": verified["input"]["triangles"], "size": size}
    row |= {"shading": shading, "tool": label, **{key: levels[0][key] for key in levels[0] if key != "level"}}
    row |= {"mip1": levels[1]["rmse"], "mip2": levels[2]["rmse"]}
    if tool == "gl":
        shutil.copy(texture, work / "gl.png")
    elif tool == "ray":
        row["apart"] = rms_difference(baked, read_image(texture), read_image(work / "gl.png"))
    if name == "ogre" and AUTHORED.exists():
        row["r"] = correlation(baked, read_image(texture), read_image(AUTHORED))
    return row


def rms_difference(mesh: Path, ours: np.ndarray, theirs: np.ndarray) -> float:
    """Return the RMS difference of two textures at points uniform on the surface."""
    return float(np.sqrt(((sample_texture(mesh, ours) - sample_texture(mesh, theirs)) ** 2).mean()))


def correlation(mesh: Path, ours: np.ndarray, theirs: np.ndarray) -> float:
    """Return Pearson's r of two textures at points uniform on the surface."""
    return float(np.corrcoef(sample_texture(mesh, ours), sample_texture(mesh, theirs))[0, 1])


def sample_texture(mesh: Path, texture: np.ndarray) -> np.ndarray:
    """Look a texture up at points uniform on the surface."""
    scene = load_scene(mesh)
    points = sample_surface(scene, np.ones(len(scene.faces), bool), 20_000, 0)
    return bilinear(texture, points.interpolate(scene.uvs), repeats=False)


def aoprecalc(*words: object) -> str:
    """Run the command line; return its standard output."""
    return run(sys.executable, "-m", "aoprecalc", *words, "-q")


def run(*words: object) -> str:
    """Run a program; return its standard output."""
    done = subprocess.run([str(word) for word in words], capture_output=True, text=True)
    if done.returncode:
        sys.exit(done.stderr or done.stdout)
    return done.stdout


if __name__ == "__main__":
    main()
