"""Errors of ambient occlusion at vertices: fitted to the texture, and sampled at the vertices by rays.

    python benchmarks/vertex_values.py [MESH ...] [--made]

Bakes each mesh with the default options and `--vertex-ao attribute`, and interpolates its values over the faces; so it
does with values that rays find at the vertices: the mean of those from the faces around. Prints a Markdown table of
the RMS errors of both against rays from points uniform on the surface, and their ratio. --made adds shapes that code
makes, with a crease angle of 40 degrees.
"""

import argparse
from dataclasses import replace
from pathlib import Path

import numpy as np
import trimesh

import aoprecalc as ao
from aoprecalc.api.bake_scene import bake_scene
from aoprecalc.api.vertex_ao import interpolation_error
from aoprecalc.mesh.surface import SurfacePoints, sample_surface
from aoprecalc.mesh.vertex_values import vertex_groups
from aoprecalc.metrics.reference import reference_ao
from aoprecalc.options import VerifyOptions
from aoprecalc.progress import Progress
from aoprecalc.types import Baked


def made() -> dict[str, ao.Mesh]:
    """Return shapes by name."""
    ring = trimesh.creation.torus(1, 0.5, major_sections=24, minor_sections=12)
    ball = trimesh.creation.icosphere(2)
    ball.apply_translation((0, 0, 1))
    cells = np.linspace(-4, 4, 17)
    x, y = (axis.ravel() for axis in np.meshgrid(cells, cells, indexing="ij"))
    i, j = (axis.ravel() for axis in np.indices((16, 16)))
    a, b = 17 * i + j, 17 * (i + 1) + j
    squares = np.concatenate([np.column_stack([a, b, b + 1]), np.column_stack([a, b + 1, a + 1])])
    floor = trimesh.Trimesh(np.column_stack([x, y, 0 * x]), squares, process=False)
    boxes = [trimesh.creation.box((1, 1, height)) for height in (1, 2, 3)]
    for number, box in enumerate(boxes):
        box.apply_translation((1.7 * number - 1.7, 0.3 * number, box.extents[2] / 2))
    shapes = {
        "ring": ring,
        "ball on a floor": trimesh.util.concatenate([floor, ball]),
        "boxes on a floor": trimesh.util.concatenate([floor, *boxes]),
    }
    return {name: ao.Mesh(shape.vertices, shape.faces, name=name) for name, shape in shapes.items()}


def sampled(baked: Baked, how: VerifyOptions) -> np.ndarray:
    """Return the values at the corners, (f, 3), that rays find at the vertices."""
    scene, groups = baked.scene, vertex_groups(baked.scene, baked.normals)
    corners = np.arange(groups.size)
    places = SurfacePoints(corners // 3, np.eye(3)[corners % 3])
    found = reference_ao(scene, baked.normals, places, how, Progress())
    return (np.bincount(groups.ravel(), found) / np.bincount(groups.ravel()))[groups]


def row(name: str, mesh: ao.Mesh, options: ao.BakeOptions, points: int, rays: int) -> str:
    """Return a row of the table."""
    baked = bake_scene(mesh._scene, options)
    where = sample_surface(baked.scene, baked.atlas.mapped, points, 0)
    expected = reference_ao(baked.scene, baked.normals, where, VerifyOptions(rays=rays), Progress())
    at_vertices = sampled(baked, VerifyOptions(rays=max(64, rays // 4), seed=1))  # from each of about six corners
    before, after = (interpolation_error(values, where, expected) for values in (at_vertices, baked.vertex_ao))
    return f"| {name} | {len(baked.scene.faces)} | {before:.4f} | {after:.4f} | {after / before:.2f} |"


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("meshes", nargs="*", type=Path, metavar="MESH")
    parser.add_argument("--made", action="store_true", help="also shapes that code makes")
    parser.add_argument("--size", type=int, default=1024, help="of the texture")
    parser.add_argument("--directions", type=int, default=1000, help="of the bake")
    parser.add_argument("--points", type=int, default=10_000, help="at which errors are measured")
    parser.add_argument("--rays", type=int, default=4096, help="from each point")
    given = parser.parse_args()
    options = ao.BakeOptions(size=given.size, directions=given.directions, vertex_ao="attribute")
    print("| mesh | triangles | sampled | fitted | ratio |\n|---|---|---|---|---|", flush=True)
    hard = replace(options, crease_angle=40)
    jobs = [(path.stem, ao.load(path), options) for path in given.meshes]
    jobs += [(name, mesh, hard) for name, mesh in made().items()] if given.made else []
    for name, mesh, own in jobs:
        print(row(name, mesh, own, given.points, given.rays), flush=True)


if __name__ == "__main__":
    main()
