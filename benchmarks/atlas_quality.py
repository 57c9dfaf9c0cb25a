"""How well new UVs use a texture: used share, errors as rendered, and what bakes take, before and after.

    python benchmarks/atlas_quality.py [--before SRC] [--only NAME ...] MESHES

MESHES is a folder with the meshes of CASES; the armoured figure is made here, of parts that intersect and hide others.
SRC is the folder `src` of another version, such as that of `git worktree add ../before v0.1.0`: then a third line has
the ratios of this version to that one. Errors of both are measured by `aoprecalc verify` of this version.
"""

import argparse
import json
import os
import resource
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

Shape = tuple[np.ndarray, np.ndarray]  # positions (v, 3), faces (f, 3)

FIGURE = "armoured figure"
CASES: dict[str, tuple[str, ...]] = {
    "ToyCar": ("ToyCar/ToyCar.gltf",),
    "DamagedHelmet": ("DamagedHelmet/DamagedHelmet.gltf", "--unwrap", "xatlas"),
    "bigguy": ("bigguy.obj", "--unwrap", "xatlas"),
    FIGURE: (),
    "ogre": ("jerry_ogre/bs_rest.obj", "--unwrap", "xatlas"),
    "spot": ("spot.obj", "--unwrap", "xatlas"),
    "fruit fly, 4096": ("fruitfly_assembled_welded.ply", "--size", "4096"),
}
LEVELS = 3
HERE = Path(__file__).resolve().parents[1] / "src"


def main() -> None:
    """Print a line for each mesh and version, and one for their ratio."""
    parser = argparse.ArgumentParser()
    parser.add_argument("meshes", type=Path)
    parser.add_argument("--before", type=Path)
    parser.add_argument("--only", nargs="*", default=list(CASES), choices=list(CASES))
    given = parser.parse_args()
    print(f"{'mesh':16} version  charts gutter   used   rmse at levels 0, 1, 2  processor seconds")
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        for name in given.only:
            mesh, *options = CASES[name] or (str(write_figure(Path(folder))),)
            before = bake(given.before, given.meshes / mesh, options, Path(folder)) if given.before else None
            after = bake(HERE, given.meshes / mesh, options, Path(folder))
            for version, found in (("before", before), ("after", after)):
                if found is not None:
                    rows.append({"mesh": name, "version": version, **found})
                    print(line(rows[-1]), flush=True)
            if before is not None:
                old, new = (np.array([row["used"], *row["rmse"], row["seconds"]]) for row in rows[-2:])
                print(f"{'':16} ratio {'':16}" + "".join(f"{ratio:7.2f}" for ratio in new / old), flush=True)
    (Path(__file__).parent / "results" / "atlas_quality.json").write_text(json.dumps({"rows": rows}, indent=2) + "\n")


def bake(source: Path, mesh: Path, options: list[str], folder: Path) -> dict:
    """Bake with the version in `source`, and return what is compared; the errors are measured by this version."""
    asset = folder / "baked.glb"
    before = processor_seconds()
    report = run(source, "bake", str(mesh), "-o", str(asset), *options)
    seconds = processor_seconds() - before
    errors = run(HERE, "verify", str(asset))
    unwrap = report["unwrap"]
    return {
        "charts": unwrap["charts"],
        "gutter": unwrap["gutter"],
        "used": unwrap["used_share"],
        "rmse": [level["rmse"] for level in errors["levels"][:LEVELS]],
        "seconds": round(seconds, 1),
    }


def run(source: Path, *arguments: str) -> dict:
    """Return the report of a command of the version in `source`."""
    command = [sys.executable, "-m", "aoprecalc", *arguments, "--json", "-q"]
    environment = os.environ | {"PYTHONPATH": str(source.resolve())}
    return json.loads(subprocess.run(command, env=environment, check=True, capture_output=True, text=True).stdout)


def processor_seconds() -> float:
    """Return the processor seconds of all children so far, which other work on the machine changes little."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def line(row: dict) -> str:
    """Return a row of the table."""
    errors = " ".join(f"{error:.4f}" for error in row["rmse"])
    return (
        f"{row['mesh']:16} {row['version']:8} {row['charts']:6} {row['gutter']:6} {row['used']:6.2f}   {errors}   "
        f"{row['seconds']:19.1f}"
    )


# The figure.


def write_figure(folder: Path) -> Path:
    """Write the figure as OBJ, and return its path."""
    positions, faces = character()
    path = folder / "figure.obj"
    vertices = [f"v {x:.6f} {y:.6f} {z:.6f}" for x, y, z in positions.tolist()]
    path.write_text("\n".join([*vertices, *(f"f {a} {b} {c}" for a, b, c in (faces + 1).tolist())]) + "\n")
    return path


def prism(start, end, radii, sides=6, flat=1.0) -> Shape:
    """Return a capped tube through rings of these radii from start to end; flat scales its depth."""
    start, end = np.asarray(start, float), np.asarray(end, float)
    axis = end - start
    axis /= np.linalg.norm(axis)
    right = np.cross(axis, (0.0, 0.0, 1.0) if abs(axis[2]) < 0.9 else (1.0, 0.0, 0.0))
    right /= np.linalg.norm(right)
    up = np.cross(axis, right)
    angles = np.arange(sides) * 2 * np.pi / sides + np.pi / sides
    ring = np.cos(angles)[:, None] * right + flat * np.sin(angles)[:, None] * up
    along = np.linspace(0, 1, len(radii))
    rings = [start + (end - start) * t + ring * r for t, r in zip(along, radii, strict=True)]
    positions = np.concatenate([*rings, start[None], end[None]])
    i = np.arange(sides)
    j = (i + 1) % sides
    faces = []
    for k in range(len(radii) - 1):
        a, b = k * sides, (k + 1) * sides
        faces += [np.stack([a + i, a + j, b + j], 1), np.stack([a + i, b + j, b + i], 1)]
    last = (len(radii) - 1) * sides
    low, high = len(positions) - 2, len(positions) - 1
    faces += [np.stack([j, i, np.full(sides, low)], 1), np.stack([last + i, last + j, np.full(sides, high)], 1)]
    return positions, np.concatenate(faces)


def block(centre, size, turn=0.0, taper=1.0) -> Shape:
    """Return a box, turned about z, whose upper side is scaled by taper."""
    signs = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float)
    corners = signs * np.asarray(size, float) / 2
    corners[signs[:, 1] > 0] *= (taper, 1, taper)
    c, s = np.cos(turn), np.sin(turn)
    corners = corners @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]]) + centre
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    return corners, np.array([t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))])


def character(rivets=4) -> Shape:
    """Return the whole figure, about 2 units high."""
    shapes = [
        prism((0, 0.95, 0), (0, 1.5, 0), (0.17, 0.15, 0.2, 0.23, 0.12), 8, 0.65),
        prism((0, 1.42, 0), (0, 1.62, 0.01), (0.07, 0.06), 6),
        prism((0, 1.56, 0.02), (0, 1.84, 0.02), (0.05, 0.1, 0.115, 0.1, 0.04), 8),
        prism((0, 1.64, 0.02), (0, 1.88, 0.02), (0.135, 0.14, 0.1, 0.03), 8),  # helmet
        prism((0, 0.85, 0), (0, 1.02, 0), (0.16, 0.19), 8, 0.7),
        block((0, 1.25, 0.13), (0.34, 0.36, 0.09), taper=1.2),
        block((0, 1.25, -0.13), (0.34, 0.36, 0.09), taper=1.2),
        block((0, 0.98, 0), (0.4, 0.07, 0.3)),
        block((0, 0.98, 0.16), (0.09, 0.09, 0.03)),
    ]
    for k in range(9):  # skirt of plates
        angle = 2 * np.pi * k / 9
        shapes.append(
            block((0.19 * np.sin(angle), 0.84, 0.14 * np.cos(angle)), (0.13, 0.2, 0.03), turn=0.1 * (k % 3 - 1))
        )
    for side in (-1, 1):
        shoulder, elbow, wrist = (0.24 * side, 1.44, 0), (0.47 * side, 1.2, 0), (0.66 * side, 1.0, 0.06)
        hip, knee, ankle = (0.1 * side, 0.95, 0), (0.12 * side, 0.52, 0.02), (0.13 * side, 0.1, -0.02)
        shapes += [
            prism(shoulder, elbow, (0.085, 0.08, 0.06, 0.06), 6),
            prism(elbow, wrist, (0.06, 0.06, 0.045), 6),
            prism(hip, knee, (0.11, 0.11, 0.08, 0.075), 6),
            prism(knee, ankle, (0.075, 0.085, 0.05), 6),
            prism((0.2 * side, 1.46, 0), (0.34 * side, 1.4, 0), (0.12, 0.13, 0.1), 7),
            prism((0.26 * side, 1.43, 0), (0.38 * side, 1.33, 0), (0.12, 0.125, 0.11), 7),
            block((0.47 * side, 1.2, -0.05), (0.12, 0.12, 0.07), turn=0.78 * side),
            block((0.12 * side, 0.52, 0.09), (0.13, 0.16, 0.06)),
            block((0.13 * side, 0.3, 0.06), (0.12, 0.3, 0.07), taper=1.25),
            block((0.13 * side, 0.06, 0.06), (0.12, 0.12, 0.28), taper=0.8),
            block((0.13 * side, 0.02, 0.06), (0.135, 0.04, 0.3)),
            block((0.69 * side, 0.96, 0.07), (0.09, 0.1, 0.05), turn=0.78 * side),
            prism((0.59 * side, 1.08, 0.03), (0.66 * side, 1.0, 0.06), (0.07, 0.06), 7),
            block((0.2 * side, 0.93, 0.1), (0.09, 0.1, 0.08)),
            block((0.2 * side, 0.97, 0.1), (0.1, 0.03, 0.09)),
        ]
        for k in range(4):
            base = np.array((0.7 * side, 0.93, 0.05 + 0.022 * k - 0.01))
            tip = base + (0.05 * side, -0.06, 0.0)
            end = tip + (0.0, -0.045, 0.012)
            shapes += [prism(base, tip, (0.012, 0.011), 5), prism(tip, end, (0.011, 0.008), 5)]
        shapes.append(prism((0.66 * side, 0.97, 0.1), (0.68 * side, 0.9, 0.14), (0.014, 0.01), 5))
        for k in range(rivets):
            angle = 2 * np.pi * k / max(rivets, 1)
            at = np.array((0.31 * side, 1.42 + 0.07 * np.sin(angle), 0.1 * np.cos(angle)))
            shapes.append(block(at, (0.03, 0.03, 0.03), turn=angle))
            shapes.append(block((0.13 * side, 0.2 + 0.06 * k, 0.1), (0.02, 0.02, 0.03)))
    shapes += [
        prism((-0.7, 0.9, 0.1), (-0.62, 1.75, 0.3), (0.03, 0.028, 0.02), 4, 0.3),
        block((-0.7, 0.93, 0.1), (0.2, 0.03, 0.05)),
        prism((0.62, 0.9, 0.14), (0.62, 1.15, 0.17), (0.18, 0.2), 9, 0.2),
        block((0, 1.2, -0.22), (0.26, 0.3, 0.1)),
        prism((-0.16, 1.38, -0.22), (0.16, 1.38, -0.22), (0.06, 0.06), 7),
        prism((0, 1.88, 0.02), (0, 2.0, -0.05), (0.02, 0.012), 4),
    ]
    positions = np.concatenate([p for p, _ in shapes])
    starts = np.cumsum([0] + [len(p) for p, _ in shapes])
    return positions, np.concatenate([f + s for (_, f), s in zip(shapes, starts, strict=False)])


if __name__ == "__main__":
    main()
