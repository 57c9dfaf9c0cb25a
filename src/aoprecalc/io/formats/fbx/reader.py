"""Read the meshes of an FBX, in the pose that it stores and in world space, with their materials."""

import gc
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aoprecalc.errors import InputError, counted, one_or_many
from aoprecalc.io.formats.base import SourceDocument
from aoprecalc.io.formats.builder import MeshPiece, build_scene, cofactors, damaged_file
from aoprecalc.io.formats.fbx.materials import FbxMaterial, FbxMaterials, held, held_each
from aoprecalc.io.formats.polygons import Polygons, corner_order, lost_faces, polygon_triangles
from aoprecalc.io.formats.textures import PartSource
from aoprecalc.progress import Note
from aoprecalc.types import Float64Array, Int64Array, Material, Scene

_MAX_PARTS = 50_000  # instances multiply: a few kilobytes may be more than memory
_MAX_TOLD = 5  # warnings of ufbx that are passed on
_NO_INDEX = 0xFFFFFFFF


def read_fbx(path: Path, data: bytes) -> Scene:
    """Read every mesh that is shown as a part, or as one for each of its materials; instances where they are placed.

    The process cannot be used for long afterwards: nothing of the file is freed.
    Raises InputError where the file is damaged or has no such mesh.
    """
    gc.disable()  # it would find fewer references than there are
    import ufbx

    try:
        scene = ufbx.load_memory(
            data,
            ignore_animation=True,
            index_error_handling=ufbx.IndexErrorHandling.NO_INDEX,
            use_blender_pbr_material=True,
        )
    except ufbx.UfbxError as error:
        raise damaged_file(path, f"cannot be read as FBX ({error})") from error
    return _SceneReader(path, scene).read()


@dataclass(frozen=True, eq=False)
class _Layer:
    """Values of a mesh and the one at each of its corners; -1 for none."""

    values: Float64Array
    indices: Int64Array

    def at(self, corners: Int64Array) -> Float64Array:
        """Return the values at (..., n) corners, (..., n, size), NaN where there is none."""
        indices = self.indices[corners]
        return np.where((indices >= 0)[..., None], self.values[indices], np.nan)


@dataclass(frozen=True, eq=False)
class _Mesh:
    """The polygons of a mesh.

    counts      (p,) corners of each polygon
    starts      (p,) its first corner
    materials   (p,) the index of its material, among those of a node
    positions   (v, 3) float64
    vertices    (c,) the index of the position at each corner
    uv_sets     by name
    """

    counts: Int64Array
    starts: Int64Array
    materials: Int64Array
    positions: Float64Array
    vertices: Int64Array
    normals: _Layer | None
    uv_sets: dict[str, _Layer]


class _SceneReader:
    """Reads a scene of ufbx."""

    def __init__(self, path: Path, scene: Any) -> None:
        """Start without messages."""
        self._path, self._scene = path, scene
        self._meshes: dict[int, _Mesh] = {}
        self._counts: Counter[str] = Counter()
        self._warnings: dict[str, None] = {}
        self._lost: set[str] = set()
        self._materials = FbxMaterials(path)
        layers = (layer for layer in held_each(scene.display_layers) if not layer.visible)
        self._hidden = {node.element_id for layer in layers for node in held_each(layer.nodes)}

    def read(self) -> Scene:
        """Return the scene."""
        nodes = [node for node in held_each(self._scene.nodes) if held(node.mesh) is not None]
        shown = [node for node in nodes if self._is_shown(node)]
        self._counts["hidden"] = len(nodes) - len(shown)
        if len(shown) > _MAX_PARTS:
            raise InputError(f"{self._path}: more than {_MAX_PARTS:,} meshes; join them, or use a smaller scene")
        placed = [(piece, _level(node)) for node in shown for piece in self._pieces(node)]
        pieces, messages = [piece for piece, _ in placed], self._messages()
        if not pieces and messages:
            raise InputError(f"{self._path}: no mesh is shown, a surface was expected; {messages[0]}")
        polygons = [source.polygons for piece in pieces if isinstance(source := piece.source, FbxPart)]
        document = SourceDocument(
            Polygons.concatenate([Polygons.of_triangles(0), *polygons]), self._materials.sources()
        )
        scene = build_scene(self._path, "fbx", pieces, document, [*messages, *_frame(self._scene.settings)])
        levels = [level for piece, level in placed if len(piece.vertices)]
        parts = (replace(part, lod=level) for part, level in zip(scene.parts, levels, strict=True))
        unit, up = float(self._scene.settings.unit_meters), self._scene.settings.axes.up.name[-1].lower()
        return replace(
            scene,
            parts=tuple(parts),
            up=up if up in ("y", "z") else None,
            unit=unit if 0 < unit < np.inf else None,
        )

    def _is_shown(self, node: Any) -> bool:
        """Tell whether a node is shown, with all those above it."""
        above: Any = node
        while above is not None:
            if not above.visible or above.element_id in self._hidden:
                return False
            above = held(above.parent)
        return True

    def _pieces(self, node: Any) -> list[MeshPiece]:
        """Return the faces of the mesh of a node, in the world, by material."""
        mesh = self._mesh(held(node.mesh))
        columns: Float64Array = np.array(node.geometry_to_world, np.float64)  # of the matrix, as rows
        linear, mirrored = columns[:3].T, np.linalg.det(columns[:3]) < 0
        positions = mesh.positions @ columns[:3] + columns[3]
        materials = list(held_each(node.materials))
        pieces = []
        for number in np.unique(mesh.materials).tolist():
            chosen = np.flatnonzero(mesh.materials == number)
            counts = mesh.counts[chosen]
            corners = np.repeat(mesh.starts[chosen], counts) + corner_order(counts, mirrored) - _run_starts(counts)
            polygons = Polygons(counts, *polygon_triangles(counts, mesh.vertices[corners], positions))
            at = corners[polygons.triangles]
            normals = None if mesh.normals is None else mesh.normals.at(at) @ cofactors(linear).T * (-1) ** mirrored
            known = self._materials.of(materials[number]) if 0 <= number < len(materials) else None
            uv_sets = _uv_sets(mesh, known, at)
            material = Material() if known is None else known.examined.at(uv_sets[0] if uv_sets else None)
            source = FbxPart(None if known is None else known.name, polygons)
            names = [*_names_above(node), held(node.mesh).name, source.material]
            vertices = mesh.vertices[at]
            pieces.append(MeshPiece(node.name, positions, vertices, normals, uv_sets, source, names, material))
        return pieces

    def _mesh(self, mesh: Any) -> _Mesh:
        """Return the polygons of a mesh, which instances share."""
        if mesh.element_id not in self._meshes:
            self._meshes[mesh.element_id] = self._read_mesh(mesh)
        return self._meshes[mesh.element_id]

    def _read_mesh(self, mesh: Any) -> _Mesh:
        faces: Int64Array = np.array(mesh.faces, np.int64).reshape(-1, 2)
        materials = _integers(mesh.face_material) if len(mesh.face_material) else np.zeros(len(faces), np.int64)
        holes = np.array(mesh.face_hole, bool) if len(mesh.face_hole) else np.zeros(len(faces), bool)
        for line in lost_faces(faces[~holes, 1]):
            self._warnings[f"{self._path}: {line}"] = None
        self._counts["subdivided"] += mesh.subdivision_display_mode.value > 1
        has = {
            "skins": len(mesh.skin_deformers),
            "blend shapes": len(mesh.blend_deformers),
            "geometry caches": len(mesh.cache_deformers),
            "colours of vertices": mesh.vertex_color.exists,
        }
        self._lost |= {words for words, number in has.items() if number}
        uv_sets = ((uv_set.name, _layer(uv_set.vertex_uv, 2)) for uv_set in mesh.uv_sets)
        return _Mesh(
            faces[~holes, 1],
            faces[~holes, 0],
            materials[~holes],
            np.array(mesh.vertices, np.float64).reshape(-1, 3),
            _integers(mesh.vertex_indices),
            _layer(mesh.vertex_normal, 3),
            {name: layer for name, layer in uv_sets if layer is not None},
        )

    def _messages(self) -> list[str]:
        """Return what the user should know of the scene."""
        scene, count = self._scene, self._counts
        has = {
            "animations": len(scene.anim_curves),
            "lights": len(scene.lights),
            "cameras": len(scene.cameras),
            "curves": len(scene.line_curves) + len(scene.nurbs_curves),
            "NURBS surfaces": len(scene.nurbs_surfaces),
        }
        lost = sorted(self._lost | {words for words, number in has.items() if number})
        lines = [*self._warnings, *self._materials.messages]
        lines += (f"{self._path}: {warning.description}" for warning in list(scene.metadata.warnings)[:_MAX_TOLD])
        if lost:
            lines.append(f"{self._path}: FBX is read without {', '.join(lost)}, which it has; export it as glTF")
        if number := count["hidden"]:
            lines.append(Note(f"{counted(number, 'hidden mesh', 'hidden meshes')} left out"))
        if number := count["subdivided"]:
            are = one_or_many(number, "subdivision surface is", "subdivision surfaces are")
            lines.append(Note(f"{number} {are} read as the control cage"))
        return lines


@dataclass(frozen=True)
class FbxPart(PartSource):
    """The faces of a node that have one material: its polygons, and their triangles, which are those of the part."""

    polygons: Polygons = field(default_factory=lambda: Polygons.of_triangles(0))


def _frame(settings: Any) -> Iterator[Note]:
    """Yield notes on a unit and axes that differ from those of a GLB, metres and Y up: numbers are kept."""
    if settings.unit_meters != 1:
        yield Note(f"its unit is {settings.unit_meters:g} metres; its numbers are kept, and a GLB calls them metres")
    axes = [getattr(settings.axes, side).name for side in ("right", "up", "front")]
    if axes[1] != "POSITIVE_Y":
        yield Note(f"its axis {_axis(axes[1])} points up; its numbers are kept, and in a GLB Y points up")
    if "UNKNOWN" not in axes and np.linalg.det([_direction(name) for name in axes]) < 0:
        yield Note("its axes are left-handed; its numbers are kept, so that a GLB shows its mirror image")


def _axis(name: str) -> str:
    return f"{'-' if name.startswith('NEGATIVE') else ''}{name[-1]}"


def _direction(name: str) -> NDArray[np.float64]:
    return np.asarray(np.eye(3)["XYZ".index(name[-1])] * (-1 if name.startswith("NEGATIVE") else 1))


def _integers(values: Any) -> Int64Array:
    """Return indices, -1 for none."""
    array = np.fromiter(values, np.int64, len(values))
    return np.where(array == _NO_INDEX, -1, array)


def _layer(attribute: Any, size: int) -> _Layer | None:
    """Return the values of an attribute at the corners of a mesh; None where it has none."""
    values: Float64Array = np.array(attribute.values, np.float64).reshape(-1, size)
    return _Layer(values, _integers(attribute.indices)) if attribute.exists and len(values) else None


def _run_starts(counts: Int64Array) -> Int64Array:
    """Return at each corner of polygons the number of corners before its polygon."""
    return np.repeat(np.cumsum(counts) - counts, counts)


def _uv_sets(mesh: _Mesh, material: FbxMaterial | None, at: Int64Array) -> tuple[Float64Array, ...]:
    """Return the UVs at corners: those of the material's pictures first."""
    first = material.uv_set if material is not None else ""
    names = dict.fromkeys([*([first] if first in mesh.uv_sets else []), *mesh.uv_sets])
    return tuple(mesh.uv_sets[name].at(at) for name in names)


def _names_above(node: Any) -> Iterator[str]:
    """Yield the names of the nodes above a node."""
    above = held(node.parent)
    while above is not None:
        if above.name:
            yield above.name
        above = held(above.parent)


def _level(node: Any) -> tuple[int, int] | None:
    """Return the level of detail that a node is of a LodGroup above it: of which, and which, 0 the finest."""
    above = held(node.parent)
    while above is not None:
        if above.attrib_type.name == "LOD_GROUP":
            children = [child.element_id for child in held_each(above.children)]
            return above.element_id, children.index(node.element_id)
        node, above = above, held(above.parent)
    return None
