"""What the 3D view of a report draws: a mesh simplified, quantised and packed, and the script that unpacks it.

The order of the packed numbers, byte planes of differences, follows "WebGL Models: End-to-End" by Won Chun (2012).
"""

import base64
import zlib
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from aoprecalc.mesh.opaque_triangles import opaque_pieces
from aoprecalc.mesh.surface import barycentric_weights
from aoprecalc.mesh.topology import corners_to_vertices, neighbours_in_a_row, unique_rows
from aoprecalc.render.simplification import Attributes, simplified
from aoprecalc.types import BoolArray, Float64Array, Int32Array, Scene, TexturedMesh, UInt8Array

_FOLDER = Path(__file__).parent / "viewer"
_SCRIPTS = ("three.min.js", "packed_mesh.js", "surfaces.js", "mesh_view.js")  # in this order
# Steps of quantised numbers: of the mesh's extent along each axis, of a repeat of the texture, of the two of a normal.
_MAX_LEVELS, _POSITION_LEVELS, _UV_LEVELS, _NORMAL_LEVELS = 65535, 8192, 4096, 510

UInt16Array = NDArray[np.uint16]


def viewer_script() -> str | None:
    """Return the JavaScript of the 3D view, three.js and `viewer/*.js`; None where three.js was not built in.

    `scripts/setup-viewer` makes the first of the two, in a checkout and for the wheel.
    """
    if not (_FOLDER / _SCRIPTS[0]).is_file():
        return None
    return "\n".join((_FOLDER / name).read_text(encoding="utf-8") for name in _SCRIPTS)


@dataclass(frozen=True, eq=False)
class Column:
    """One number of each vertex, quantised: lower + step * values, values (n,) uint16."""

    name: str
    lower: float
    step: float
    values: UInt16Array

    @classmethod
    def quantized(cls, name: str, numbers: Float64Array, levels: int) -> "Column":
        """Quantise numbers, (n,), n >= 1; the greatest error is half of (max - min) / levels."""
        lower, upper = float(numbers.min()), float(numbers.max())
        step = (upper - lower) / levels
        values = np.rint((numbers - lower) / (step or 1.0)).astype(np.uint16)
        return cls(name, lower, step, values)

    def decoded(self) -> Float64Array:
        """Return the numbers as the view reads them, (n,)."""
        numbers: Float64Array = self.lower + self.step * self.values.astype(np.float64)
        return numbers


@dataclass(frozen=True)
class Surface:
    """What triangles of one kind look like.

    textured   the ambient-occlusion texture covers them
    strength   of that: 1 + strength * (AO - 1) is drawn
    color      (r, g, b), linear, in [0, 1]: the factor of their base colour; None where the mesh has no base colours
    texture    index of their base texture in `ViewGeometry.base_textures`; None without one
    """

    textured: bool
    strength: float
    color: tuple[float, float, float] | None
    texture: int | None


@dataclass(frozen=True, eq=False)
class ViewGeometry:
    """A mesh as the 3D view draws it.

    total_triangles   of the mesh that it stands for; `triangles` has fewer where it was simplified
    center, scale     (3,) and a number: (position - center) / scale is in the unit sphere, where the view has the mesh
    triangles         (t, 3) int32, those of each base texture together
    columns           of the n vertices: x, y, z; nu, nv, the normal (octahedral); surface, an index into `surfaces`;
                      u, v, those of the ambient-occlusion texture, v upwards; u1, v1, those of the base textures
    surfaces          the kinds of triangles
    base_textures     (height, width, 3) uint8 sRGB, row 0 at v = 1, reduced
    """

    total_triangles: int
    center: Float64Array
    scale: float
    triangles: Int32Array
    columns: tuple[Column, ...]
    surfaces: tuple[Surface, ...]
    base_textures: tuple[UInt8Array, ...] = ()

    @cached_property
    def packed(self) -> bytes:
        """The numbers of `triangles` and `columns`, deflated (zlib).

        First three byte planes, lowest first, of one number for each corner: how far its vertex is behind the first one
        that no corner before it uses. Then for each column two byte planes of the difference from the vertex before,
        modulo 65536, with the sign in the lowest bit.
        """
        corners = self.triangles.reshape(-1).astype(np.int64)
        unused = np.maximum.accumulate(np.concatenate([[-1], corners[:-1]])) + 1
        planes = [_byte_planes((unused - corners).astype(np.uint32), 3)]
        for column in self.columns:
            difference = np.diff(column.values, prepend=np.uint16(0)).view(np.int16)
            planes.append(_byte_planes(((difference << 1) ^ (difference >> 15)).view(np.uint16), 2))
        return zlib.compress(b"".join(planes), 9)

    def as_json(self) -> dict[str, Any]:
        """Return what the view takes as `asset.geometry`."""
        return {
            "triangles": len(self.triangles),
            "totalTriangles": self.total_triangles,
            "vertices": len(self.columns[0].values),
            "columns": [{"name": column.name, "lower": column.lower, "step": column.step} for column in self.columns],
            "surfaces": [vars(surface) for surface in self.surfaces],
            "data": base64.b64encode(self.packed).decode(),
        }

    def pack_spheres(self, centers: Float64Array, radii: Float64Array) -> str:
        """Return spheres, (n, 3) and (n,) in the mesh's coordinates, as the view takes them for `asset.spheres`."""
        spheres = np.column_stack([centers - self.center, radii]) / self.scale
        return base64.b64encode(spheres.astype("<f4").tobytes()).decode()


def view_geometry(mesh: TexturedMesh, max_triangles: int, base_texture_size: int = 512) -> ViewGeometry:
    """Simplify a mesh to `max_triangles` for the 3D view, and quantise it.

    max_triangles       of the view, >= 1; at most three times as many are left where pieces and holes need them
    base_texture_size   all base textures together have at most the square of it as texels

    A mesh with fewer triangles is kept as it is, but for the holes of alpha masks, which are cut out as far as
    `max_triangles` allows; with too many masked faces for that they are not. The same mesh gives the same bytes. Raises
    NotSimplifiedError where it cannot be simplified so far, as one of many small pieces.
    """
    scene = mesh.scene
    center, scale = _bounding_sphere(scene.positions)
    surfaces, surface_of_face, textures = _surfaces(mesh)
    attributes: Attributes = {
        "POSITION": (scene.corners - center) / scale,
        "NORMAL": mesh.normals,
        "_SURFACE": np.repeat(surface_of_face, 3).reshape(-1, 3, 1),
    }
    if mesh.uvs is not None:
        attributes["TEXCOORD_0"] = mesh.uvs
    if textures:
        attributes["TEXCOORD_1"] = _base_uvs(mesh)
    faces, attributes = _without_holes(scene, attributes, max_triangles)
    inwards = _inwards(attributes["POSITION"], attributes["NORMAL"])
    attributes, triangles = _indexed(faces, attributes)
    triangles[inwards] = triangles[inwards][:, ::-1]
    if len(triangles) > max_triangles:
        attributes, triangles = simplified(attributes, triangles, max_triangles)
    attributes, triangles = _in_order_of_use(attributes, triangles, surfaces)
    return ViewGeometry(
        total_triangles=len(scene.faces),
        center=center,
        scale=scale,
        triangles=triangles,
        columns=_columns(attributes),
        surfaces=surfaces,
        base_textures=_reduced(textures, base_texture_size),
    )


def _bounding_sphere(positions: Float64Array) -> tuple[Float64Array, float]:
    """Return the centre of the bounding box of (v, 3) positions, and half its diagonal; 1 where that is 0."""
    lower, upper = positions.min(axis=0) / 2, positions.max(axis=0) / 2
    half = upper - lower
    longest = float(half.max())  # the squares of lengths may be beyond what numbers hold
    return lower + upper, longest * float(np.linalg.norm(half / longest)) if longest else 1.0


def _surfaces(mesh: TexturedMesh) -> tuple[tuple[Surface, ...], Int32Array, list[UInt8Array]]:
    """Return the kinds of surface, the index of each face's kind, (f,), and the base textures that they use."""
    textures: list[UInt8Array] = []
    found: dict[Surface, int] = {}
    surface_of_face = np.empty(len(mesh.scene.faces), np.int32)
    strengths = np.ones(len(surface_of_face)) if mesh.strengths is None else mesh.strengths
    for index, part in enumerate(mesh.scene.parts):
        color, texture = None, None
        if mesh.base_colors:
            base = mesh.base_colors[index]
            color = base.factor
            if base.texture is not None:
                same = [known for known, other in enumerate(textures) if other is base.texture]
                texture = same[0] if same else len(textures)
                textures += [] if same else [base.texture]
        kinds = np.column_stack([mesh.textured[part.faces], strengths[part.faces]])
        for textured, strength in np.unique(kinds, axis=0)[::-1].tolist():
            surface = Surface(bool(textured), strength, color, texture)
            chosen = (kinds == (textured, strength)).all(axis=1)
            surface_of_face[part.faces][chosen] = found.setdefault(surface, len(found))
    return tuple(found), surface_of_face, textures


def _base_uvs(mesh: TexturedMesh) -> Float64Array:
    """Return the UVs of base textures at the corners, (f, 3, 2); (0, 0) where a part has none."""
    uvs = np.zeros((len(mesh.scene.faces), 3, 2))
    for part, base in zip(mesh.scene.parts, mesh.base_colors, strict=True):
        if base.texture is not None and base.uvs is not None:
            uvs[part.faces] = base.uvs
    return uvs


def _without_holes(scene: Scene, attributes: Attributes, max_triangles: int) -> tuple[Int32Array, Attributes]:
    """Cut out the holes of alpha masks: faces, (o, 3), of places, and attributes at their corners, (o, 3, c)."""
    masked = scene.per_face(part.material.alpha_mask is not None for part in scene.parts)
    max_pieces = max_triangles - np.count_nonzero(~masked)
    if not masked.any() or max_pieces < 2 * np.count_nonzero(masked):
        return scene.faces, attributes
    parts = tuple(replace(part, occludes=True) for part in scene.parts)
    corners, face_of = opaque_pieces(replace(scene, parts=parts), int(max_pieces))
    if not len(corners):
        return scene.faces, attributes
    weights = barycentric_weights(scene.corners[face_of], corners)
    cut = {name: weights @ values[face_of] for name, values in attributes.items()}
    cut["_SURFACE"] = attributes["_SURFACE"][face_of]
    return unique_rows(corners.reshape(-1, 3))[1].reshape(-1, 3).astype(np.int32), cut


def _indexed(faces: Int32Array, attributes: Attributes) -> tuple[Attributes, Int32Array]:
    """Make vertices, (n, c), of attributes at corners, (f, 3, c): one for corners that agree in all to 16 bits."""
    keys = [np.rint(values * _MAX_LEVELS) for name, values in attributes.items() if name != "POSITION"]
    vertices = corners_to_vertices(faces, *keys)
    at_vertices = {name: values.reshape(3 * len(faces), -1)[vertices.corner] for name, values in attributes.items()}
    return at_vertices, vertices.triangles.astype(np.int32)


def _inwards(corners: Float64Array, normals: Float64Array) -> BoolArray:
    """Return which triangles, (f,) bool, have a winding that their shading normals oppose at all corners."""
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    opposed: BoolArray = (np.einsum("fcx,fx->fc", normals, across) < 0).all(axis=1)
    return opposed


def _in_order_of_use(
    attributes: Attributes, triangles: Int32Array, surfaces: tuple[Surface, ...]
) -> tuple[Attributes, Int32Array]:
    """Sort the triangles by base texture, then neighbours in a row, and the vertices by the triangles that use them."""
    triangles = triangles[neighbours_in_a_row(triangles)]
    texture = np.array([-1 if surface.texture is None else surface.texture for surface in surfaces])
    of_triangle = texture[attributes["_SURFACE"][triangles[:, 0], 0]]
    triangles = triangles[np.argsort(of_triangle, kind="stable")]
    used, first, inverse = np.unique(triangles, return_index=True, return_inverse=True)
    order = np.argsort(first)
    rank = np.empty(len(order), np.int32)
    rank[order] = np.arange(len(order))
    triangles = rank[inverse].reshape(-1, 3)
    newest_last = (triangles.argmax(axis=1)[:, None] + [1, 2, 3]) % 3
    triangles = np.take_along_axis(triangles, newest_last, axis=1)
    return {name: values[used[order]] for name, values in attributes.items()}, triangles


def _columns(attributes: Attributes) -> tuple[Column, ...]:
    positions = attributes["POSITION"].T
    columns = [Column.quantized(name, positions[axis], _POSITION_LEVELS) for axis, name in enumerate("xyz")]
    octahedral = octahedral_from_normals(attributes["NORMAL"])
    for axis, name in enumerate(("nu", "nv")):
        values = np.rint((octahedral[:, axis] + 1) / 2 * _NORMAL_LEVELS).astype(np.uint16)
        columns.append(Column(name, -1.0, 2 / _NORMAL_LEVELS, values))
    columns.append(Column("surface", 0.0, 1.0, attributes["_SURFACE"][:, 0].astype(np.uint16)))
    for attribute, names in (("TEXCOORD_0", ("u", "v")), ("TEXCOORD_1", ("u1", "v1"))):
        if attribute in attributes:
            for axis, name in enumerate(names):
                numbers = attributes[attribute][:, axis]
                levels = _UV_LEVELS * max(int(np.ceil(np.ptp(numbers))), 1)
                columns.append(Column.quantized(name, numbers, min(levels, _MAX_LEVELS)))
    return tuple(columns)


def octahedral_from_normals(normals: Float64Array) -> Float64Array:
    """Map unit vectors, (n, 3), to the square [-1, 1]^2, (n, 2): Meyer et al. 2010."""
    flat = normals / np.maximum(np.abs(normals).sum(axis=1, keepdims=True), 1e-30)
    signs = np.where(flat[:, :2] < 0, -1.0, 1.0)
    folded: Float64Array = np.where(flat[:, 2:] < 0, (1 - np.abs(flat[:, 1::-1])) * signs, flat[:, :2])
    return folded


def _reduced(textures: list[UInt8Array], size: int) -> tuple[UInt8Array, ...]:
    """Reduce pictures so that all together have at most size * size texels."""
    side = int(size / len(textures) ** 0.5) if textures else 0
    reduced = []
    for texture in textures:
        picture = Image.fromarray(texture)
        picture.thumbnail((side, side), Image.Resampling.LANCZOS)
        reduced.append(np.asarray(picture))
    return tuple(reduced)


def _byte_planes(values: NDArray[np.unsignedinteger], planes: int) -> bytes:
    """Return the lowest bytes of all values, then the next, (planes * n) bytes."""
    return b"".join(((values >> (8 * plane)) & 255).astype(np.uint8).tobytes() for plane in range(planes))
