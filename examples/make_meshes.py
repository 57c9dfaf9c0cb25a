"""Makes the example meshes: small scenes whose parts shade each other.

    python examples/make_meshes.py [FOLDER]

Writes colonnade.obj (y up), rings.ply and arches.stl (z up); every part is a closed surface, and none of them has UVs.
"""

import argparse
import itertools
from pathlib import Path

import numpy as np
import trimesh

# Radii and heights of a column, from the floor up. Layers of the base and the roof: how far they reach beyond the axes
# of the columns, and their heights.
COLUMN = [(0.24, 0.0), (0.24, 0.06), (0.2, 0.12), (0.18, 0.16), (0.17, 0.7), (0.145, 1.46), (0.23, 1.58), (0.23, 1.66)]
BASE = [(0.6, -0.24), (0.6, -0.12), (0.42, -0.12), (0.42, 0.0)]
ROOF = [(0.3, 1.66), (0.3, 1.9), (0.45, 1.9), (0.45, 2.0)]
RIDGE = 2.65  # height
WIDTH = 1.6  # between the two rows of columns
TILE = 0.26  # half the width of the square of floor or ceiling in which a column stands
SIDES = 32  # of a column


def colonnade(columns: int = 5) -> trimesh.Trimesh:
    """Make two rows of columns on a stepped base, under a gable roof: one closed surface."""
    axes = [(float(x), z) for x in range(columns) for z in (0.0, WIDTH)]
    base = [_layer(columns, reach, y) for reach, y in BASE]
    roof = [_layer(columns, reach, y) for reach, y in ROOF]
    ridge = roof[-1] * (1, 0, 1) + (0, RIDGE, 0)
    ridge[..., 2] = WIDTH / 2 + np.clip(ridge[..., 2] - WIDTH / 2, -0.03, 0.03)  # narrow, but no edge
    roof.append(ridge)
    quads = [_sheet(base[0])[:, ::-1], *_walls(base), *_walls(roof), _sheet(ridge)]
    for layer, (radius, y), flip in ((base[-1], COLUMN[0], 1), (roof[0], COLUMN[-1], -1)):  # floor and ceiling
        quads.append(_sheet(layer, holes=True)[:, ::flip])
        for x, z in axes:
            quads.append(_band(_square(y), _circle(radius, y))[:, ::flip] + (x, 0, z))
    for x, z in axes:
        quads += [_band(_circle(*low), _circle(*high)) + (x, 0, z) for low, high in itertools.pairwise(COLUMN)]
    corners = np.concatenate(quads)
    triangles = np.concatenate([corners[:, [0, 1, 2]], corners[:, [0, 2, 3]]])
    vertices, faces = np.unique(triangles.reshape(-1, 3).round(9) + 0.0, axis=0, return_inverse=True)
    mesh = trimesh.Trimesh(vertices, faces.reshape(-1, 3), process=False)
    mesh.update_faces(mesh.nondegenerate_faces())  # layers narrow to the ridge
    return mesh


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


# Parts of the colonnade. Their quads, (q, 4, 3), run counter-clockwise seen from outside the solid.


def _lines(low: float, high: float, centers: list[float]) -> np.ndarray:
    """Return ascending coordinates of grid lines: the ends, and those that divide the sides of the columns' tiles."""
    tiles = [center + np.linspace(-TILE, TILE, SIDES // 4 + 1) for center in centers]
    return np.concatenate([[low], *tiles, [high]])


def _layer(columns: int, reach: float, y: float) -> np.ndarray:
    """Return a horizontal grid of points, (rows along x, along z, 3), that ends `reach` beyond the columns' axes."""
    x = _lines(-reach, columns - 1 + reach, [float(column) for column in range(columns)])
    z = _lines(-reach, WIDTH + reach, [0.0, WIDTH])
    return np.stack(np.meshgrid(x, y, z, indexing="ij"), axis=-1)[:, 0]


def _sheet(layer: np.ndarray, holes: bool = False) -> np.ndarray:
    """Return the quads of a layer, seen from above, with or without those of the columns' tiles."""
    quads = np.stack([layer[:-1, :-1], layer[:-1, 1:], layer[1:, 1:], layer[1:, :-1]], axis=2)
    within = [np.isclose(np.ptp(quads[..., axis], axis=2), TILE * 8 / SIDES) for axis in (0, 2)]
    return quads[~(within[0] & within[1])] if holes else quads.reshape(-1, 4, 3)


def _walls(layers: list[np.ndarray]) -> list[np.ndarray]:
    """Return the quads between the outlines of layers, from the lowest to the highest."""
    outlines = [np.concatenate([g[0, :-1], g[:-1, -1], g[-1, :0:-1], g[:0:-1, 0]]) for g in layers]
    return [_band(low, high) for low, high in itertools.pairwise(outlines)]


def _band(low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Return the quads between two closed lines of as many points, which run counter-clockwise seen from above."""
    return np.stack([low, np.roll(low, -1, axis=0), np.roll(high, -1, axis=0), high], axis=1)


def _circle(radius: float, y: float) -> np.ndarray:
    """Return points of a circle about the y axis, (SIDES, 3); the first is opposite a corner of `_square`."""
    angle = np.pi / 4 + np.arange(SIDES) * 2 * np.pi / SIDES
    return np.column_stack([radius * np.cos(angle), np.full(SIDES, y), -radius * np.sin(angle)])


def _square(y: float) -> np.ndarray:
    """Return points of the sides of a tile, (SIDES, 3)."""
    step = np.linspace(TILE, -TILE, SIDES // 4, endpoint=False)
    side = np.full(SIDES // 4, TILE)
    x, z = np.concatenate([step, -side, -step, side]), np.concatenate([-side, -step, side, step])
    return np.column_stack([x, np.full(SIDES, y), z])


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
