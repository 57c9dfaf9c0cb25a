"""Writes binary PLY with one normal and one UV (s, t) for each vertex."""

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aoprecalc.files.atomic import Outputs
from aoprecalc.files.distinct import distinct_rows
from aoprecalc.files.obj.reader import ObjDocument
from aoprecalc.files.one_set import placed_uvs, what_is_lost
from aoprecalc.files.ply.reader import VERTEX_NORMALS, PlyDocument, uv_names
from aoprecalc.files.ply.table import TYPES, Element, Lists, Property, Table, element_bytes
from aoprecalc.files.polygons import Indices, Polygons
from aoprecalc.files.references import relative_path
from aoprecalc.model import Atlas, Doubles, Floats, Scene
from aoprecalc.options import Pack

Columns = dict[str, NDArray[Any]]

_NAMES = {code: name for name, code in TYPES.items() if not name[-1].isdigit()}
_UVS = ("s", "t")
_TEXTURE_NUMBER = "texnumber"  # which of several textures a face shows; now there is one
_LONGEST_LIST = 255  # that a count of one byte can tell


def write_ply(
    outputs: Outputs, path: Path, scene: Scene, atlas: Atlas, normals: Floats, texture: Path, pack: Pack = "none"
) -> tuple[str, ...]:
    """Write a PLY whose vertices are split where UVs or normals differ; return what the user should know.

    What else a PLY source has is kept, lists of numbers excepted: the vertices with their numbers (those that a split
    makes follow them), their properties, those of the faces, other elements, comments. A polygon is cut into its
    triangles where a seam runs through it. The texture is named by a `comment TextureFile`, as MeshLab does.
    """
    if isinstance(scene.document, PlyDocument):
        document, origins = scene.document, np.concatenate([part.vertices for part in scene.parts])
    else:
        document, origins = _fresh_document(scene), scene.faces
    uvs = placed_uvs(scene, atlas).astype(np.float32)
    faces = document.polygons.rejoin([uvs, normals], decides=atlas.covers | (atlas.uv_set is not None))

    at_corners = [values.reshape(-1, values.shape[2])[faces.corners] for values in (normals, uvs)]
    count = len(document.vertices["x"])
    numbers, first, origin = _split(origins.reshape(-1)[faces.corners], count, *at_corners)
    old_uvs = set(uv_names(document.vertices)) - {*_UVS}
    columns = {name: values[origin] for name, values in document.vertices.items() if name not in old_uvs}
    for names, values in zip((VERTEX_NORMALS, _UVS), at_corners, strict=True):
        for name, column in zip(names, values.T, strict=True):
            before = columns.get(name, np.zeros(len(origin))).astype(np.float32)
            columns[name] = np.where(first >= 0, column[first], before)

    of_faces = {name: values[faces.owners] for name, values in document.faces.items() if name != _TEXTURE_NUMBER}
    length = "uchar" if faces.counts.max() <= _LONGEST_LIST else "int"
    elements = [
        (_element("vertex", len(origin), columns), Table(columns, {})),
        (
            _element("face", len(faces.counts), of_faces, Property("vertex_indices", "int", length)),
            Table(of_faces, {"vertex_indices": Lists(faces.counts, numbers)}),
        ),
        *document.others,
    ]
    header = ["ply", "format binary_little_endian 1.0", *document.comments]
    header += [f"comment TextureFile {relative_path(texture, path)}"]
    header += [line for element, _ in elements for line in element.lines]
    head = "\n".join([*header, "end_header\n"]).encode("utf-8", "surrogateescape")
    outputs.path(path).write_bytes(b"".join([head, *(element_bytes(*element) for element in elements)]))
    return (*_about_others(path, scene), *what_is_lost(path, scene, atlas))


def _fresh_document(scene: Scene) -> PlyDocument:
    """Say a scene from another kind of file as a PLY; positions are float32 where that is exact, else float64."""
    polygons = scene.document.polygons if isinstance(scene.document, ObjDocument) else None
    vertices = dict(zip("xyz", _shortest(scene.positions).T, strict=True))
    return PlyDocument(vertices, polygons or Polygons.of_triangles(len(scene.faces)), {})


def _shortest(positions: Doubles) -> NDArray[Any]:
    single = positions.astype(np.float32)
    return single if np.array_equal(single, positions) else positions


def _split(origins: Indices, count: int, *values: NDArray[Any]) -> tuple[Indices, Indices, Indices]:
    """Make vertices of corners that have some (n, c) values and come from one of `count` vertices, (n,).

    The first that is made of each keeps its number, the others come after all of them.

    Returns the (n,) vertex of each corner; for each vertex a corner that has its values, -1 for none; and which of the
    vertices it was.
    """
    corner, which = distinct_rows(origins, *values)
    of_corner = origins[corner]
    made_first = np.empty(count, dtype=np.int64)
    made_first[of_corner[::-1]] = np.arange(len(corner))[::-1]  # the last assignment stays
    earliest = made_first[of_corner] == np.arange(len(corner))
    number = np.where(earliest, of_corner, count - 1 + np.cumsum(~earliest))
    origin = np.concatenate([np.arange(count), of_corner[~earliest]])
    first = np.full(len(origin), -1)
    first[number] = corner
    return number[which], first, origin


def _element(name: str, count: int, columns: Columns, *lists: Property) -> Element:
    scalars = [Property(name, _NAMES[values.dtype.str[1:]]) for name, values in columns.items()]
    return Element(name, count, [*lists, *scalars])


def _about_others(path: Path, scene: Scene) -> tuple[str, ...]:
    """Return what the user should know about parts that do not receive: all vertices have UVs here."""
    others = sum(not part.receives for part in scene.parts)
    if not others:
        return ()
    return (
        f"{path}: PLY holds one texture, which {others} parts without ambient occlusion show as well; write a .glb",
    )
