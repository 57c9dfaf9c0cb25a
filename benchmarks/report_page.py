"""How large the report page of many assets is, and how soon a browser can use it.

    python benchmarks/report_page.py [--assets N] [--runs N] [--folder DIR] [--tables]

Needs the extra `browser` and Chromium (scripts/setup-browser). The meshes are made here, no two alike, and where
../shared/meshes is there, its meshes are among them. They are baked by one batch in --folder, which is not timed: what
that folder holds already is not baked again. Seconds are medians of --runs, but for the first:
- write        `aoprecalc report`, the whole command, once, in seconds of the processor
- interactive  from the start of the navigation until a click on a heading of the table has sorted it
- load         until the page and all that is in it has been read
- view         from a click on an asset until its 3D view is drawn, by SwiftShader on the processor
Everything goes into benchmarks/results/report.json, with --tables also the tables of the documentation
(result_tables.py).
"""

import argparse
import json
import os
import platform
import resource
import shutil
import statistics
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
import result_tables
import trimesh

ROOT = Path(__file__).resolve().parents[1]
RESULTS = Path(__file__).resolve().with_name("results") / "report.json"
SHARED = ROOT.parent / "shared" / "meshes"
REAL = ("bigguy.obj", "monsterfrog.obj", "spot.obj", "stanford-bunny.obj", "jerry_ogre/bs_rest.obj",
        "ToyCar/ToyCar.gltf", "DamagedHelmet/DamagedHelmet.gltf")  # fmt: skip
BAKE, SPHERES = "--size 512 -n 64", "-n 32 -s 5000"
COMMAND = [sys.executable, "-m", "aoprecalc"]

# Clicks on a heading until the table is sorted; then `interactive` is the time since the navigation began.
INTERACTIVE = """
const tried = setInterval(() => {
  const button = document.querySelector("#assets thead button[data-key=name]");
  button?.click();
  if (!button?.closest("th").hasAttribute("aria-sort")) return;
  clearInterval(tried);
  requestAnimationFrame(() => setTimeout(() => { globalThis.interactive = performance.now(); }));
}, 5);
"""
# Opens an asset; returns the milliseconds until its view is drawn.
VIEW = """(id) => new Promise((done) => {
  const started = performance.now();
  document.querySelector(`#assets a[href="#${id}"]`).click();
  const wait = () => document.querySelector(`#${id} [data-view]`)?.dataset.state === "live"
    ? done(performance.now() - started) : requestAnimationFrame(wait);
  wait();
})"""


def make_meshes(folder: Path, count: int) -> None:
    """Write meshes of 320 to 20,480 triangles, no two alike, and the real ones."""
    folder.mkdir(parents=True)
    real = [SHARED / name for name in REAL if (SHARED / name).exists()]
    for path in real[:count]:
        shutil.copytree(path.parent, folder / path.parent.name) if path.parent != SHARED else shutil.copy(path, folder)
    chance = np.random.default_rng(0)
    for number in range(count - len(real[:count])):
        mesh = trimesh.creation.icosphere(2 + number % 4)
        middles = chance.normal(size=(12, 3))
        middles /= np.linalg.norm(middles, axis=1, keepdims=True)
        depth = 0.45 * np.exp((mesh.vertices @ middles.T - 1) / 0.05).sum(axis=1)
        mesh.vertices *= (1 - np.minimum(depth, 0.6))[:, None] * chance.uniform(0.5, 1.5, 3)
        mesh.export(folder / f"rock-{number:03}.obj", header=None, include_normals=False)


def measure(page_file: Path, runs: int) -> dict[str, list[float]]:
    """Open the page in a new browser profile for each run; return milliseconds."""
    from playwright.sync_api import sync_playwright

    sys.path.insert(0, str(ROOT / "tests"))
    from browser.chromium import launched

    found: dict[str, list[float]] = {name: [] for name in ("interactive", "load", "view")}
    with sync_playwright() as driver, launched(driver) as browser:
        for run in range(runs + 1):
            context = browser.new_context(viewport={"width": 1280, "height": 900})
            page = context.new_page()
            page.add_init_script(INTERACTIVE)
            page.goto(page_file.as_uri())
            page.wait_for_function("() => globalThis.interactive")
            ids = page.evaluate(
                "() => [...document.querySelectorAll('#assets tr[data-status=made]')].map((it) => it.dataset.asset)"
            )
            times = {
                "interactive": page.evaluate("() => interactive"),
                "load": page.evaluate("() => performance.getEntriesByType('navigation')[0].loadEventEnd"),
                "view": page.evaluate(VIEW, ids[run * 7 % len(ids)]),
            }
            context.close()
            if run:  # the first starts the browser's processes
                for name, value in times.items():
                    found[name].append(round(value, 1))
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description="Measure the report page of many assets.")
    parser.add_argument("--assets", type=int, default=100)
    parser.add_argument("--runs", type=int, default=7)
    parser.add_argument("--folder", type=Path, help="of meshes and results, kept; else a temporary one")
    parser.add_argument("--tables", action="store_true", help="write the tables of the documentation")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = given.folder or Path(name)
        if not (folder / "meshes").exists():
            make_meshes(folder / "meshes", given.assets)
        if not (folder / "results" / "batch.json").exists():
            batch = ["batch", "meshes", "-o", "results", "--no-cache", "--report", "results/batch.json"]
            subprocess.run([*COMMAND, *batch, "--bake", BAKE, "--spheres", SPHERES], cwd=folder, check=True)
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        subprocess.run([*COMMAND, "report", "results", "-o", "report.html", "-q"], cwd=folder, check=True)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        write = round(after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime, 1)
        size = (folder / "report.html").stat().st_size
        found = measure(folder / "report.html", given.runs)
    document = {
        "machine": f"{platform.machine()}, {os.cpu_count()} cores",
        "assets": given.assets,
        "bake": BAKE,
        "bytes": size,
        "seconds": {
            "write": write,
            **{name: round(statistics.median(values) / 1000, 3) for name, values in found.items()},
        },
        "runs": {name: [round(value / 1000, 3) for value in values] for name, values in found.items()},
    }
    RESULTS.write_text(json.dumps(document, indent=2) + "\n")
    print(json.dumps(document, indent=2))
    if given.tables:
        result_tables.main()


if __name__ == "__main__":
    main()
