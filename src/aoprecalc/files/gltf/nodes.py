"""Where the nodes of a glTF document's scene stand in the world."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from aoprecalc.files.damage import damaged
from aoprecalc.files.gltf.accessors import doubles
from aoprecalc.files.gltf.document import GltfDocument, Json
from aoprecalc.model import Doubles

INSTANCING = "EXT_mesh_gpu_instancing"
_PLACES = {"TRANSLATION": "translation", "ROTATION": "rotation", "SCALE": "scale"}


@dataclass(frozen=True, eq=False)
class PlacedNode:
    """A node of the scene that is shown.

    matrix   (4, 4) float64, local to world
    names    its own and those of the nodes above it
    """

    matrix: Doubles
    names: frozenset[str]


def placed_nodes(document: GltfDocument) -> dict[int, PlacedNode]:
    """Return each node of the scene that is shown by its number, parents first.

    Raises InputError where the nodes do not form trees.
    """
    waiting = [(root, PlacedNode(np.eye(4), frozenset())) for root in reversed(_roots(document))]
    placed: dict[int, PlacedNode] = {}
    while waiting:
        index, parent = waiting.pop()
        if index in placed:
            raise damaged(document.path, f"node {index} is reached twice, a tree of nodes was expected")
        node = document.entry("nodes", index)
        names = parent.names | ({node["name"]} if node.get("name") else set())
        placed[index] = PlacedNode(parent.matrix @ _local_matrix(node), names)
        waiting.extend((child, placed[index]) for child in reversed(node.get("children", [])))
    return placed


def instance_matrices(document: GltfDocument, node: Json) -> Doubles | None:
    """Return where a node repeats its mesh, (n, 4, 4) float64 in its own space; None where it shows it once.

    (EXT_mesh_gpu_instancing: any of TRANSLATION, ROTATION and SCALE, one row for each repetition.)
    """
    attributes = node.get("extensions", {}).get(INSTANCING, {}).get("attributes", {})
    given = {name: doubles(document, index) for name, index in attributes.items() if name in _PLACES}
    if not given:
        return None
    counts = {name: len(rows) for name, rows in given.items()}
    if len(set(counts.values())) > 1:
        raise damaged(document.path, f"{INSTANCING} has rows of different numbers: {counts}")
    rows = zip(*given.values(), strict=True)
    return np.array([_local_matrix(dict(zip((_PLACES[name] for name in given), row, strict=True))) for row in rows])


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
