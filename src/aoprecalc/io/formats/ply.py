"""Stanford PLY, ASCII or binary: polygons of any mixture of sizes, triangle strips, UVs on vertices or corners.

trimesh's reader is not used: it refuses binary files that mix triangles with other polygons, reads strips as points,
and reorders the vertices where there are UVs.
"""

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aoprecalc.errors import counted, one_or_many
from aoprecalc.io.formats.archives import check_pictures
from aoprecalc.io.formats.base import (
    MeshFormat,
    MeshWithAo,
    PartOcclusion,
    SourceDocument,
    SourceMaterial,
    TextureReference,
    WrittenMesh,
    source_colors,
    source_polygons,
)
from aoprecalc.io.formats.builder import MeshPiece, build_scene, check_indices, damaged_file
from aoprecalc.io.formats.files import ColorImages, ImageSource, TextureCopies, same_file
from aoprecalc.io.formats.ply_table import (
    TYPES,
    Element,
    Lists,
    Property,
    Table,
    element_bytes,
    read_header,
    read_table,
)
from aoprecalc.io.formats.polygons import (
    NewUvs,
    OutputFaces,
    Polygons,
    cut_note,
    lost_faces,
    polygon_triangles,
    strip_triangles,
)
from aoprecalc.io.formats.textures import PartSource, first_uvs
from aoprecalc.io.images import is_baked
from aoprecalc.io.outputs import Outputs, relative_path
from aoprecalc.mesh.topology import unique_rows
from aoprecalc.progress import Note
from aoprecalc.texture_lookup import linear_from_srgb
from aoprecalc.types import BaseColor, Float32Array, Float64Array, Int64Array, Part, Scene

VERTEX_UVS = (("s", "t"), ("u", "v"), ("texture_u", "texture_v"), ("texture_s", "texture_t"))
# Red, green and blue of vertices or faces, and alpha.
COLORS = {
    ("red", "green", "blue"): "alpha",
    ("diffuse_red", "diffuse_green", "diffuse_blue"): "diffuse_alpha",
    ("r", "g", "b"): "a",
}
VERTEX_NORMALS = ("nx", "ny", "nz")
FACE_LISTS = ("vertex_indices", "vertex_index")
_OWN_LISTS = (*FACE_LISTS, "texcoord")

_REWRITTEN = ("vertex", "face", "tristrips")  # elements that the writer makes anew


@dataclass(frozen=True, eq=False)
class PlyDocument(SourceDocument):
    """A PLY file, for writing it back; properties have the types and the order of the file.

    `polygons` has its faces, then the triangles of its strips; their corners are in Part.vertices.

    vertices      the scalar properties of the vertices: name -> (n,) values
    faces         the scalar properties of the polygons: name -> (p,) values, 0 for the triangles of strips
    others        the elements beside vertices, faces and strips
    comments      its lines `comment` and `obj_info`, except those that name textures
    textures      the pictures that each `comment TextureFile` names
    occlusion     the one of them that was baked, which is not among `textures`
    vertex_lists  the list properties of the vertices
    face_lists    those of the polygons, beside their vertices and UVs; empty for the triangles of strips
    """

    vertices: dict[str, NDArray[Any]]
    faces: dict[str, NDArray[Any]]
    others: tuple[tuple[Element, Table], ...] = ()
    comments: tuple[str, ...] = ()
    textures: tuple[Path, ...] = ()
    occlusion: Path | None = None
    vertex_lists: Mapping[str, Lists] = field(default_factory=dict)
    face_lists: Mapping[str, Lists] = field(default_factory=dict)

    def colors(self, scene: Scene) -> Float32Array | None:
        """Return the linear colours of the vertices, else of the faces; with alpha where one is not 1."""
        if (colors := _colors(self.vertices)) is not None:
            return np.concatenate([colors[part.vertices] for part in scene.parts])
        if (colors := _colors(self.faces)) is not None:
            return colors[self.polygons.owners][:, None].repeat(3, axis=1)
        return None


def read_ply(path: Path, data: bytes) -> Scene:
    """Read a PLY file of the given bytes; raises InputError where it is damaged or has no usable faces."""
    header = read_header(path, data)
    tables = read_table(path, header.elements, header.body, header.order)
    columns = tables.get("vertex", Table({}, {})).columns
    if not all(axis in columns for axis in "xyz"):
        raise damaged_file(path, "its vertices have no x, y and z, which were expected")
    positions = np.column_stack([columns[axis] for axis in "xyz"]).astype(np.float64)

    polygons, vertices, corner_uvs = _faces(positions, tables)
    face = tables.get("face", Table({}, {})) if len(polygons.counts) else Table({}, {})
    face_columns, face_lists = face.columns, {name: face.lists[name] for name in face.lists if name not in _OWN_LISTS}
    strips = _strips(tables)
    if len(strips):
        polygons, corner_uvs = Polygons.concatenate([polygons, Polygons.of_triangles(len(strips))]), None
        vertices = np.concatenate([vertices, strips])
        face_columns = {name: np.pad(column, (0, len(strips))) for name, column in face_columns.items()}
        padded = {name: np.pad(entries.counts, (0, len(strips))) for name, entries in face_lists.items()}
        face_lists = {name: Lists(padded[name], entries.values) for name, entries in face_lists.items()}
    check_indices(path, vertices, len(positions))
    if names := uv_names(columns):
        corner_uvs = np.column_stack([columns[name] for name in names])[vertices]
    normals = None
    if all(name in columns for name in VERTEX_NORMALS):
        normals = np.column_stack([columns[name] for name in VERTEX_NORMALS])[vertices]

    uv_sets = () if corner_uvs is None else (corner_uvs,)
    others = tuple((e, tables[e.name]) for e in header.elements if e.name in tables and e.name not in _REWRITTEN)
    files = header.texture_files(path)
    textures = tuple(file for file in files if not is_baked(file))
    messages: list[str] = [*lost_faces(polygons.counts)]
    if len(textures) > 1 and len(np.unique(face_columns.get(_TEXTURE_NUMBER, ()))) > 1:
        messages.append(f"its faces have {len(textures)} textures: only {textures[0].name} reaches a GLB or a preview")
    shown = (
        {textures[0].stem: SourceMaterial(textures[0].stem, texture=ImageSource.of(textures[0]))}
        if textures and uv_sets
        else {}
    )
    document = PlyDocument(
        polygons,
        shown,
        columns,
        face_columns,
        others,
        header.comments,
        textures,
        next((file for file in files if file not in textures), None),
        tables["vertex"].lists,
        face_lists,
    )
    piece = MeshPiece("mesh", positions, vertices, normals, uv_sets, PartSource(next(iter(shown), None)))
    return build_scene(path, "ply", [piece], document, messages)


def uv_names(columns: Collection[str]) -> tuple[str, ...]:
    """Return the names of the UVs among the properties of vertices; empty if there are none."""
    return next((names for names in VERTEX_UVS if all(name in columns for name in names)), ())


def _faces(
    positions: Float64Array, tables: dict[str, Table]
) -> tuple[Polygons, NDArray[np.int64], Float64Array | None]:
    """Return polygons, the (f, 3) vertices of their triangles and, where faces carry UVs, (f, 3, 2) at the corners."""
    face = tables.get("face", Table({}, {}))
    lists = next((face.lists[name] for name in FACE_LISTS if name in face.lists), None)
    if lists is None:
        return Polygons.of_triangles(0), np.empty((0, 3), dtype=np.int64), None
    vertices = lists.values.astype(np.int64)
    known = (vertices >= 0) & (vertices < len(positions))
    # Wrong indices are reported later; until then they refer to vertex 0.
    polygons = Polygons(lists.counts, *polygon_triangles(lists.counts, np.where(known, vertices, 0), positions))
    texcoord = face.lists.get("texcoord")
    if texcoord is None or not np.array_equal(texcoord.counts, 2 * lists.counts):
        return polygons, vertices[polygons.triangles], None
    uvs = texcoord.values.astype(np.float64).reshape(-1, 2)
    return polygons, vertices[polygons.triangles], uvs[polygons.triangles]


def _strips(tables: dict[str, Table]) -> NDArray[np.int64]:
    """Return the (f, 3) vertices of the triangles of all strips; in a list, -1 starts a new strip."""
    lists = tables.get("tristrips", Table({}, {})).lists.get("vertex_indices")
    if lists is None:
        return np.empty((0, 3), dtype=np.int64)
    ends = np.cumsum(lists.counts)[:-1]
    return strip_triangles(np.insert(lists.values.astype(np.int64), ends, -1))


# Writing: binary, with one normal and one UV (s, t) for each vertex.

Columns = dict[str, NDArray[Any]]

_TYPE_NAMES = {code: name for name, code in TYPES.items() if not name[-1].isdigit()}
_UVS, _OCCLUSION = ("s", "t"), ("ao",)
_TEXTURE_NUMBER = "texnumber"  # the texture of each face, of several; the output has one
_MAX_UCHAR_COUNT = 255  # the longest list whose count is a uchar


def write_ply(outputs: Outputs, path: Path, mesh: MeshWithAo) -> tuple[Note, ...]:
    """Write a PLY whose vertices are split where UVs, normals or values differ.

    Everything else of a PLY source is kept: the vertices in their order (those that a split adds come after them), the
    properties of vertices and faces, other elements, comments. A polygon is cut into
    its triangles where a seam runs through it, or where other programs would cut it in other ways than the bake, as a
    note says. A `comment TextureFile` names the texture, as in MeshLab's files; where UVs were kept it comes after
    those of the source, which programs show, as faces have the first unless they say otherwise.
    """
    scene, texture = mesh.scene, mesh.only_texture(path)
    atlas = texture.atlas
    new_values: dict[tuple[str, ...], Float32Array] = {VERTEX_NORMALS: mesh.normals}
    if isinstance(scene.document, PlyDocument):
        document, origins = scene.document, np.concatenate([part.vertices for part in scene.parts])
    else:
        document, origins = _new_document(scene), scene.faces
    uvs = mesh.uvs.astype(np.float32)
    new = np.full(len(uvs), atlas.uv_set is None)
    mapping = NewUvs(scene.corners, uvs, new)
    faces = document.polygons.merge_triangles([uvs, mesh.normals], decisive=atlas.mapped | ~new, mapping=mapping)

    new_values |= {_UVS: uvs}
    if mesh.vertices is not None:
        new_values |= {_OCCLUSION: mesh.vertices.corners[:, :, None]}
    at_corners = [values.reshape(-1, values.shape[2])[faces.corners] for values in new_values.values()]
    count = len(document.vertices["x"])
    vertices, first, origin = _split(origins.reshape(-1)[faces.corners], count, *at_corners)
    old_uvs = set(uv_names(document.vertices)) - {*_UVS}
    columns = {name: values[origin] for name, values in document.vertices.items() if name not in old_uvs}
    for names, values in zip(new_values, at_corners, strict=True):
        for name, column in zip(names, values.T, strict=True):
            old = columns.get(name, np.zeros(len(origin))).astype(np.float32)
            columns[name] = np.where(first >= 0, column[first], old)

    kept, copies = document.textures if atlas.uv_set is not None else (), TextureCopies(outputs, path, scene.path)
    face_values = {
        name: values[faces.owners] for name, values in document.faces.items() if kept or name != _TEXTURE_NUMBER
    }
    face_lists = {name: _face_list(document.polygons, faces, entries) for name, entries in document.face_lists.items()}
    face_lists["vertex_indices"] = Lists(faces.counts, vertices)
    vertex_lists = {name: entries.take(origin) for name, entries in document.vertex_lists.items()}
    elements = [
        (_element("vertex", len(origin), columns, vertex_lists), Table(columns, vertex_lists)),
        (_element("face", len(faces.counts), face_values, face_lists), Table(face_values, face_lists)),
        *document.others,
    ]
    header = ["ply", "format binary_little_endian 1.0", *document.comments]
    header += [f"comment TextureFile {name}" for name in (*map(copies.name, kept), relative_path(texture.path, path))]
    header += [line for element, _ in elements for line in element.lines]
    head = "\n".join([*header, "end_header\n"]).encode("utf-8", "surrogateescape")
    outputs.path(path).write_bytes(b"".join([head, *(element_bytes(*element) for element in elements)]))
    stays = ", ".join(file.name for file in kept)
    note = (Note(f"{path}: {stays} stays its first TextureFile; the baked texture is the last"),) if kept else ()
    return (*note, *cut_note(faces))


def _face_list(polygons: Polygons, faces: OutputFaces, entries: Lists) -> Lists:
    """Return a list property of the faces to write: of each corner where its lists are as long as the polygons."""
    width = len(entries.values) // max(1, int(polygons.counts.sum()))
    if width < 1 or not np.array_equal(entries.counts, width * polygons.counts):
        return entries.take(faces.owners)
    corners = polygons.triangles.reshape(-1)[faces.corners]
    return Lists(width * faces.counts, entries.values.reshape(-1, width)[corners].reshape(-1))


def _new_document(scene: Scene) -> PlyDocument:
    """Make the PLY of a scene from another format; positions are float32 where that is exact, else float64."""
    vertices = dict(zip("xyz", _shortest(scene.positions).T, strict=True))
    return PlyDocument(source_polygons(scene), {}, vertices, {})


def _shortest(positions: Float64Array) -> NDArray[Any]:
    single = positions.astype(np.float32)
    return single if np.array_equal(single, positions) else positions


def _split(origins: Int64Array, count: int, *values: NDArray[Any]) -> tuple[Int64Array, Int64Array, Int64Array]:
    """Split vertices whose corners differ in their values.

    origins   (n,) the vertex of each corner, of `count` vertices
    values    each (n, c), at the corners

    The first copy of a vertex keeps its index, further copies are appended.

    Returns the (n,) new vertex of each corner; for each new vertex a corner with its values, -1 for none; and for each
    new vertex the original one.
    """
    corner, inverse = unique_rows(origins, *values)
    old_vertex = origins[corner]
    first_copy = np.empty(count, dtype=np.int64)
    first_copy[old_vertex[::-1]] = np.arange(len(corner))[::-1]  # the last assignment wins
    is_first = first_copy[old_vertex] == np.arange(len(corner))
    new_vertex = np.where(is_first, old_vertex, count - 1 + np.cumsum(~is_first))
    origin = np.concatenate([np.arange(count), old_vertex[~is_first]])
    first = np.full(len(origin), -1)
    first[new_vertex] = corner
    return new_vertex[inverse], first, origin


def _element(name: str, count: int, columns: Columns, lists: Mapping[str, Lists]) -> Element:
    properties = [Property(name, _TYPE_NAMES[values.dtype.str[1:]]) for name, values in columns.items()]
    for list_name, entries in lists.items():
        kind = "int" if list_name == "vertex_indices" else _TYPE_NAMES[entries.values.dtype.str[1:]]
        length = "uchar" if entries.counts.max(initial=0) <= _MAX_UCHAR_COUNT else "int"
        properties.insert(0 if list_name == "vertex_indices" else len(properties), Property(list_name, kind, length))
    return Element(name, count, properties)


class PlyFormat(MeshFormat):
    """Stanford PLY, ASCII or binary; written as binary."""

    name = "PLY"
    extensions = (".ply",)
    writes = holds_vertex_ao = True

    def sniff(self, data: bytes) -> bool:
        """Tell whether it begins with a PLY header."""
        return data.startswith(b"ply") and b"end_header" in data

    def read(self, path: Path, data: bytes) -> Scene:
        """Read the faces and strips as one part."""
        return read_ply(path, data)

    def referenced_files(self, path: Path, data: bytes) -> list[Path]:
        """Return the textures that it names."""
        return list(read_header(path, data).texture_files(path))

    def source_files(self, scene: Scene) -> list[Path]:
        """Return the PLY and its textures."""
        document = _document(scene)
        return [scene.path, *document.textures, *([] if document.occlusion is None else [document.occlusion])]

    def check_source(self, path: Path, scene: Scene) -> None:
        """Raise UsageError for a mesh of a ZIP, whose pictures it could not refer to."""
        check_pictures(path, scene)

    def write_with_ao(self, outputs: Outputs, path: Path, mesh: MeshWithAo) -> WrittenMesh:
        """Write a PLY; see `write_ply`."""
        notes = write_ply(outputs, path, mesh)
        return WrittenMesh((TextureReference("TextureFile", " and ".join(_UVS)),), (*self.losses(path, mesh), *notes))

    def losses(self, path: Path, mesh: MeshWithAo) -> tuple[str, ...]:
        """Warn about parts that do not receive, too: all vertices have UVs here."""
        others = sum(not part.receives for part in mesh.scene.parts)
        without = (
            f"{counted(others, 'part')} without ambient occlusion {one_or_many(others, 'shows', 'show')} it as well"
        )
        lost = [f"{path}: PLY holds one texture; {without}; write a .glb"] if others else []
        document = mesh.scene.document
        if isinstance(document, PlyDocument) and document.textures and mesh.textures[0].atlas.uv_set is None:
            names = ", ".join(map(str, document.textures))
            lost.append(f"{path}: names no longer {names}, as the baked texture lies on new UVs; write a .glb for both")
        return (*lost, *super().losses(path, mesh))

    def occlusion_of(self, scene: Scene, part: Part) -> PartOcclusion:
        """Return the texture that was baked, else the last one of the PLY."""
        document = _document(scene)
        path = document.occlusion or next(reversed(document.textures), None)
        image = None if path is None else ImageSource.of(path)
        return PartOcclusion(image, first_uvs(scene, part), stated=False)

    def base_colors(self, scene: Scene, images: ColorImages, occlusion: Path | None) -> tuple[BaseColor, ...]:
        """Return the texture and the colours of the vertices, which count as sRGB."""
        document, colors = _document(scene), source_colors(scene)
        file, texture = next(iter(document.textures), None), None
        if file is not None and scene.uvs is not None and not same_file(file, occlusion):
            texture = images.get(ImageSource.of(file))
        return tuple(
            BaseColor(
                texture=texture,
                uvs=None if texture is None else first_uvs(scene, part),
                corners=None if colors is None else colors[part.faces, :, :3],
            )
            for part in scene.parts
        )


def _colors(columns: Columns) -> Float32Array | None:
    """Return the linear colours of vertices or faces, (n, 3) float32, with alpha where one is not 1; None without."""
    for names, alpha in COLORS.items():
        if all(name in columns for name in names):
            values = [_fractions(columns[name]) for name in names]
            linear = linear_from_srgb(np.column_stack(values))
            opacity = _fractions(columns[alpha])[:, None] if alpha in columns else np.ones((0, 1))
            return linear if np.all(opacity == 1) else np.concatenate([linear, opacity], axis=1, dtype=np.float32)
    return None


def _fractions(values: NDArray[Any]) -> Float64Array:
    """Return values in [0, 1]: integers are divided by their maximum."""
    if values.dtype.kind in "iu":
        return np.clip(values / np.float64(np.iinfo(values.dtype).max), 0, 1)
    return np.clip(np.nan_to_num(values.astype(np.float64)), 0, 1)


def _document(scene: Scene) -> PlyDocument:
    assert isinstance(scene.document, PlyDocument)  # the reader made it
    return scene.document
