"""Where the nodes of a glTF document's scene stand in the world."""

from typing import Any

import numpy as np

from aoprecalc.files.damage import damaged
from aoprecalc.files.gltf.document import GltfDocument, Json
from aoprecalc.model import Doubles


def world_matrices(document: GltfDocument) -> dict[int, Doubles]:
    """Return the (4, 4) float64 local-to-world matrix of each node of the scene that is shown, parents first.

    Raises InputError where the nodes do not form trees.
    """
    waiting = [(root, np.eye(4)) for root in reversed(_roots(document))]
    placed: dict[int, Doubles] = {}
    while waiting:
        index, parent = waiting.pop()
        if index in placed:
            raise damaged(document.path, f"node {index} is reached twice, a tree of nodes was expected")
        node = document.entry("nodes", index)
        placed[index] = parent @ _local_matrix(node)
        waiting.extend((child, placed[index]) for child in reversed(node.get("children", [])))
    return placed


def _roots(document: GltfDocument) -> list[int]:
    if document.json.get("scenes"):
        roots: list[int] = document.entry("scenes", document.json.get("scene", 0)).get("nodes", [])
        return roots
    nodes: list[Json] = document.json.get("nodes", [])
    children = {child for node in nodes for child in node.get("children", [])}
    return [index for index in range(len(nodes)) if index not in children]


def _local_matrix(node: Json) -> Doubles:
    if "matrix" in node:
        return np.array(node["matrix"], dtype=np.float64).reshape(4, 4).T
    matrix = np.eye(4)
    matrix[:3, :3] = _rotation(node.get("rotation", (0, 0, 0, 1))) * np.array(node.get("scale", (1, 1, 1)), np.float64)
    matrix[:3, 3] = node.get("translation", (0, 0, 0))
    return matrix


def _rotation(quaternion: Any) -> Doubles:
    x, y, z, w = np.array(quaternion, dtype=np.float64) / (np.linalg.norm(quaternion) or 1.0)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )
