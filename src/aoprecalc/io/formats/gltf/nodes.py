"""The nodes of a glTF scene: their transforms, instances and levels of detail."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from aoprecalc.io.formats.builder import damaged_file
from aoprecalc.io.formats.gltf.document import GltfDocument, Json, float_values
from aoprecalc.io.formats.gltf.materials import LOD
from aoprecalc.types import Float64Array

INSTANCING = "EXT_mesh_gpu_instancing"
VISIBILITY = "KHR_node_visibility"
_TRS = {"TRANSLATION": "translation", "ROTATION": "rotation", "SCALE": "scale"}


@dataclass(frozen=True, eq=False)
class SceneNode:
    """A node of the shown scene.

    matrix   (4, 4) float64, local to world
    names    of the node and its ancestors
    lod      the level of detail that it belongs to (MSFT_lod): index of the node of the finest, and which; else None
    hidden   it, or a node above it, is not visible (KHR_node_visibility)
    """

    matrix: Float64Array
    names: frozenset[str]
    lod: tuple[int, int] | None = None
    hidden: bool = False


def scene_nodes(document: GltfDocument) -> dict[int, SceneNode]:
    """Return the nodes of the shown scene by index, parents first; raises InputError where they do not form trees.

    The coarser levels of detail of a node (MSFT_lod) are siblings of it, whether a parent names them or not.
    """
    pending = [(root, SceneNode(np.eye(4), frozenset())) for root in reversed(_roots(document))]
    named = {root for root, _ in pending} | _children(document)
    levels = _levels_of_detail(document)
    placed: dict[int, SceneNode] = {}
    while pending:
        index, parent = pending.pop()
        if index in placed:
            raise damaged_file(document.path, f"node {index} is reached twice, a tree of nodes was expected")
        node = document.entry("nodes", index)
        names = parent.names | ({node["name"]} if node.get("name") else set())
        hidden = parent.hidden or not node.get("extensions", {}).get(VISIBILITY, {}).get("visible", True)
        placed[index] = SceneNode(parent.matrix @ _local_matrix(node), names, levels.get(index, parent.lod), hidden)
        pending.extend((child, placed[index]) for child in reversed(node.get("children", [])))
        coarser = [other for other, (finest, _) in levels.items() if finest == index and other not in named]
        pending.extend((other, parent) for other in reversed(coarser) if other != index)
    return placed


def _levels_of_detail(document: GltfDocument) -> dict[int, tuple[int, int]]:
    """Return by node the level of detail that it is (MSFT_lod): the node of the finest, and which, 0 the finest."""
    levels: dict[int, tuple[int, int]] = {}
    for finest, node in enumerate(document.json.get("nodes", [])):
        for level, other in enumerate([finest, *node.get("extensions", {}).get(LOD, {}).get("ids", [])]):
            if level == 1:
                levels.setdefault(finest, (finest, 0))
            if level:
                document.entry("nodes", other)
                levels.setdefault(other, (finest, level))
    return levels


def instance_matrices(document: GltfDocument, node: Json) -> Float64Array | None:
    """Return the (n, 4, 4) instance matrices of a node (EXT_mesh_gpu_instancing), in its space; None if it has none."""
    attributes = node.get("extensions", {}).get(INSTANCING, {}).get("attributes", {})
    given = {name: float_values(document, index) for name, index in attributes.items() if name in _TRS}
    if not given:
        return None
    counts = {name: len(rows) for name, rows in given.items()}
    if len(set(counts.values())) > 1:
        raise damaged_file(document.path, f"{INSTANCING} has attributes of different lengths: {counts}")
    rows = zip(*given.values(), strict=True)
    return np.array([_local_matrix(dict(zip((_TRS[name] for name in given), row, strict=True))) for row in rows])


def _roots(document: GltfDocument) -> list[int]:
    if document.json.get("scenes"):
        roots: list[int] = document.entry("scenes", document.json.get("scene", 0)).get("nodes", [])
        return roots
    nodes: list[Json] = document.json.get("nodes", [])
    children = _children(document) | {node for node, (_, level) in _levels_of_detail(document).items() if level}
    return [index for index in range(len(nodes)) if index not in children]


def _children(document: GltfDocument) -> set[int]:
    return {child for node in document.json.get("nodes", []) for child in node.get("children", [])}


def _local_matrix(node: Json) -> Float64Array:
    if "matrix" in node:
        return np.array(node["matrix"], dtype=np.float64).reshape(4, 4).T
    matrix = np.eye(4)
    matrix[:3, :3] = _rotation(node.get("rotation", (0, 0, 0, 1))) * np.array(node.get("scale", (1, 1, 1)), np.float64)
    matrix[:3, 3] = node.get("translation", (0, 0, 0))
    return matrix


def _rotation(quaternion: Any) -> Float64Array:
    x, y, z, w = np.array(quaternion, dtype=np.float64) / (np.linalg.norm(quaternion) or 1.0)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )
