"""Makes the example meshes: small scenes whose parts shade each other.

    python examples/make_meshes.py [FOLDER]

Writes colonnade.obj (y up), rings.ply and arches.stl (z up); every part is a closed surface, and none of them has UVs.
"""

import argparse
from pathlib import Path

import numpy as np
import trimesh

# Half widths and heights, from the floor up, of what is turned or built up in layers below.
SHAFT = [(0.24, 0.0), (0.24, 0.06), (0.2, 0.12), (0.18, 0.16), (0.17, 0.7), (0.145, 1.46), (0.23, 1.58), (0.23, 1.66)]
STEPS = [(0.6, -0.24), (0.6, -0.12), (0.42, -0.12), (0.42, 0.0)]
BEAM = [(0.26, 1.66), (0.26, 1.9), (0.42, 1.9), (0.42, 2.0)]
WIDTH = 1.6  # between the two rows of columns


def colonnade(columns: int = 5) -> trimesh.Trimesh:
    """Make two rows of columns on a stepped base, under a gable roof."""
    length = columns - 1.0
    base = [_rectangle(length, reach, y) for reach, y in STEPS]
    # A narrow ridge rather than an edge, so that the last layer still is a rectangle.
    roof = [_rectangle(length, reach, y) for reach, y in BEAM]
    roof.append([(x, 2.65, WIDTH / 2 + np.clip(z - WIDTH / 2, -0.03, 0.03)) for x, _, z in roof[-1]])
    shafts = [_turned(SHAFT, (x, 0.0, z)) for x in range(columns) for z in (0.0, WIDTH)]
    return trimesh.util.concatenate([_layers(base), _layers(roof), *shafts])


def rings(count: int = 5) -> trimesh.Trimesh:
    """Make a chain of interlocking rings."""
    links = []
    for link in range(count):
        ring = trimesh.creation.torus(major_radius=1.0, minor_radius=0.3, major_sections=48, minor_sections=24)
        ring.apply_transform(trimesh.transformations.rotation_matrix(link * np.pi / 2, (1, 0, 0)))
        ring.apply_translation((1.35 * link, 0, 0))
        links.append(ring)
    return trimesh.util.concatenate(links)


def arches(count: int = 3, stones: int = 11) -> trimesh.Trimesh:
    """Make a row of round arches, each of wedge-shaped stones with narrow joints, on piers that stand on a floor."""
    parts = [trimesh.creation.box(bounds=[(-0.8, -0.8, -0.2), (2.4 * count + 0.8, 1.8, 0.0)])]
    for pier in range(count + 1):
        parts.append(trimesh.creation.box(bounds=[(2.4 * pier - 0.35, 0.0, 0.0), (2.4 * pier + 0.35, 1.0, 1.5)]))
    for arch in range(count):
        angles = np.linspace(0, np.pi, stones + 1)
        for start, end in zip(angles[:-1] + 0.015, angles[1:] - 0.015, strict=True):
            corners = [
                (2.4 * (arch + 0.5) + radius * np.cos(angle), y, 1.52 + radius * np.sin(angle))
                for radius in (0.87, 1.2)
                for angle in (start, end)
                for y in (0.05, 0.95)
            ]
            parts.append(trimesh.convex.convex_hull(np.array(corners)))
    return trimesh.util.concatenate(parts)


def _rectangle(length: float, reach: float, y: float) -> list[tuple[float, float, float]]:
    """Return the corners of the columns' plan grown by `reach`, counter-clockwise seen from below."""
    low, right, back = -reach, length + reach, WIDTH + reach
    return [(low, y, low), (right, y, low), (right, y, back), (low, y, back)]


def _layers(rectangles: list[list[tuple[float, float, float]]]) -> trimesh.Trimesh:
    """Join rectangles, from the lowest to the highest, to a closed solid."""
    quads = [(0, 1, 2, 3), tuple(4 * len(rectangles) - 1 - corner for corner in range(4))]
    for first in range(0, 4 * len(rectangles) - 4, 4):
        for side in range(4):
            corner, following = first + side, first + (side + 1) % 4
            quads.append((corner, corner + 4, following + 4, following))
    faces = [triangle for a, b, c, d in quads for triangle in ((a, b, c), (a, c, d))]
    return trimesh.Trimesh(np.concatenate(rectangles), faces)


def _turned(profile: list[tuple[float, float]], place: tuple[float, float, float]) -> trimesh.Trimesh:
    """Turn a profile of (radius, height) about an upright axis at `place`."""
    line = [(0.0, profile[0][1]), *profile, (0.0, profile[-1][1])]
    solid = trimesh.creation.revolve(np.array(line), sections=32)
    solid.apply_transform(trimesh.transformations.rotation_matrix(-np.pi / 2, (1, 0, 0)))
    solid.apply_translation(place)
    return solid


def main() -> None:
    """Write the meshes into the folder named on the command line, by default the present one."""
    parser = argparse.ArgumentParser(description="Make the example meshes.")
    parser.add_argument("folder", nargs="?", type=Path, default=Path())
    folder = parser.parse_args().folder
    folder.mkdir(parents=True, exist_ok=True)
    colonnade().export(folder / "colonnade.obj", header=None, include_normals=False)
    rings().export(folder / "rings.ply")
    arches().export(folder / "arches.stl")


if __name__ == "__main__":
    main()
