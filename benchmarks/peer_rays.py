"""Rays a second of another tool's ambient occlusion, from the vertices of a mesh, for the interpreter that has it.

    python benchmarks/peer_rays.py igl|pymeshlab MESH.ply

The last line printed is JSON.
"""

import json
import sys
import time

RAYS = 256  # from each vertex


def main() -> None:
    """Measure the tool that is named."""
    module, path = sys.argv[1:]
    seconds, vertices = {"igl": libigl, "pymeshlab": meshlab}[module](path)
    print(json.dumps({"seconds": seconds, "rays": vertices * RAYS}))


def libigl(path: str) -> tuple[float, int]:
    """Cast rays by igl.embree.ambient_occlusion, its acceleration structure included."""
    import numpy as np
    import trimesh
    from igl import embree

    mesh = trimesh.load(path, process=False)
    positions, faces = np.array(mesh.vertices, float), np.array(mesh.faces, np.int64)
    normals = np.array(mesh.vertex_normals, float)
    start = time.perf_counter()
    embree.ambient_occlusion(positions, faces, positions, normals, RAYS)
    return time.perf_counter() - start, len(positions)


def meshlab(path: str) -> tuple[float, int]:
    """Cast rays by MeshLab's filter over Embree, its acceleration structure included."""
    import pymeshlab

    meshes = pymeshlab.MeshSet()
    meshes.load_new_mesh(path)
    start = time.perf_counter()
    meshes.compute_scalar_ambient_occlusion(rays=RAYS)
    return time.perf_counter() - start, meshes.current_mesh().vertex_number()


if __name__ == "__main__":
    main()
