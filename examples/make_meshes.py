"""Makes the example meshes: small scenes whose parts shade each other.

    python examples/make_meshes.py [FOLDER]

Writes colonnade.obj, rings.ply and arches.stl; none of them has UVs.
"""

import sys
from pathlib import Path

import numpy as np
import trimesh


def colonnade(columns: int = 6) -> trimesh.Trimesh:
    """Two rows of columns on a stepped base, under a roof slab."""
    length = columns - 1.0
    parts = [
        trimesh.creation.box(bounds=[(-0.8, -0.25, -0.8), (length + 0.8, -0.1, 2.3)]),
        trimesh.creation.box(bounds=[(-0.6, -0.1, -0.6), (length + 0.6, 0.0, 2.1)]),
        trimesh.creation.box(bounds=[(-0.45, 1.8, -0.45), (length + 0.45, 2.0, 1.95)]),
        trimesh.creation.box(bounds=[(-0.3, 1.6, -0.3), (length + 0.3, 1.8, 0.3)]),
        trimesh.creation.box(bounds=[(-0.3, 1.6, 1.2), (length + 0.3, 1.8, 1.8)]),
    ]
    for x in range(columns):
        for z in (0.0, 1.5):
            parts.append(_column(float(x), z))
    return trimesh.util.concatenate(parts)


def rings(count: int = 5) -> trimesh.Trimesh:
    """A chain of interlocking rings."""
    links = []
    for link in range(count):
        ring = trimesh.creation.torus(major_radius=1.0, minor_radius=0.3, major_sections=48, minor_sections=24)
        ring.apply_transform(trimesh.transformations.rotation_matrix(link * np.pi / 2, (1, 0, 0)))
        ring.apply_translation((1.35 * link, 0, 0))
        links.append(ring)
    return trimesh.util.concatenate(links)


def arches(count: int = 3, stones: int = 11) -> trimesh.Trimesh:
    """A row of round arches, each of wedge-shaped stones with narrow joints, on piers that stand on a floor."""
    parts = [trimesh.creation.box(bounds=[(-0.8, -0.2, -0.8), (2.4 * count + 0.8, 0.0, 1.8)])]
    for pier in range(count + 1):
        parts.append(trimesh.creation.box(bounds=[(2.4 * pier - 0.35, 0.0, 0.0), (2.4 * pier + 0.35, 1.5, 1.0)]))
    for arch in range(count):
        angles = np.linspace(0, np.pi, stones + 1)
        for start, end in zip(angles[:-1] + 0.015, angles[1:] - 0.015, strict=True):
            corners = [
                (2.4 * (arch + 0.5) + radius * np.cos(angle), 1.52 + radius * np.sin(angle), z)
                for radius in (0.87, 1.2)
                for angle in (start, end)
                for z in (0.05, 0.95)
            ]
            parts.append(trimesh.convex.convex_hull(np.array(corners)))
    return trimesh.util.concatenate(parts)


def _column(x: float, z: float) -> trimesh.Trimesh:
    """A round shaft between two square plates."""
    shaft = trimesh.creation.cylinder(radius=0.18, height=1.4, sections=32)
    shaft.apply_transform(trimesh.transformations.rotation_matrix(np.pi / 2, (1, 0, 0)))
    shaft.apply_translation((x, 0.8, z))
    foot = trimesh.creation.box(bounds=[(x - 0.26, 0.0, z - 0.26), (x + 0.26, 0.1, z + 0.26)])
    head = trimesh.creation.box(bounds=[(x - 0.26, 1.5, z - 0.26), (x + 0.26, 1.6, z + 0.26)])
    return trimesh.util.concatenate([foot, shaft, head])


def main() -> None:
    """Write the meshes into the folder named on the command line, by default the present one."""
    folder = Path(sys.argv[1] if len(sys.argv) > 1 else ".")
    folder.mkdir(parents=True, exist_ok=True)
    colonnade().export(folder / "colonnade.obj", header=None, include_normals=False)
    rings().export(folder / "rings.ply")
    arches().export(folder / "arches.stl")


if __name__ == "__main__":
    main()
