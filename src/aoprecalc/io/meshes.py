"""Mesh files of every format: reading, writing with the results of a bake, and finding a mesh's occlusion texture.

`FORMATS` lists the formats; everything else here looks them up by the extension of a path or by Scene.format.
"""

import os
from collections.abc import Hashable, Sequence
from dataclasses import replace
from os import PathLike
from pathlib import Path
from typing import Literal

import numpy as np

from aoprecalc.errors import AoprecalcError, ArgumentError, InputError, OutputError, UsageError, nearest
from aoprecalc.io.formats.archives import ThreeMfFormat, UnpackedFormat, ZipFormat, as_packed, is_archive
from aoprecalc.io.formats.base import MeshFormat, MeshWithAo, PartOcclusion, PartSpaces, WrittenMesh
from aoprecalc.io.formats.builder import ArraysFormat
from aoprecalc.io.formats.collada import ColladaFormat
from aoprecalc.io.formats.fbx import FbxFormat
from aoprecalc.io.formats.files import ColorImages, text_as_utf8
from aoprecalc.io.formats.geometry_formats import OffFormat, StlFormat
from aoprecalc.io.formats.gltf import GltfFormat
from aoprecalc.io.formats.obj import ObjFormat
from aoprecalc.io.formats.ply import PlyFormat
from aoprecalc.io.formats.recognition import foreign_file, unreadable_file
from aoprecalc.io.formats.usd import UsdFormat
from aoprecalc.io.outputs import Outputs
from aoprecalc.options import Pack, Textures, VertexAo
from aoprecalc.types import Atlas, BaseColor, Part, Scene

_UNPACKED: tuple[MeshFormat, ...] = (
    ObjFormat(),
    PlyFormat(),
    StlFormat(),
    OffFormat(),
    GltfFormat(),
    ColladaFormat(),
    ThreeMfFormat(),
    UsdFormat(),
    FbxFormat(),
)
FORMATS = (*_UNPACKED, ZipFormat(_UNPACKED, lambda file: load_scene(file)))

_BY_EXTENSION = {extension: mesh_format for mesh_format in FORMATS for extension in mesh_format.extensions}
MESH_EXTENSIONS = tuple(_BY_EXTENSION)
OUTPUT_MESH_EXTENSIONS = tuple(extension for extension, mesh_format in _BY_EXTENSION.items() if mesh_format.writes)

_ARRAYS = ArraysFormat()


def format_of(path: str | PathLike[str]) -> MeshFormat:
    """Return the format that a path's extension names; raises UsageError for an unknown extension."""
    suffix = Path(path).suffix.lower()
    if suffix not in _BY_EXTENSION:
        known = ", ".join(MESH_EXTENSIONS)
        raise UsageError(f"{path}: the extension {suffix or '(none)'} is not one of {known}; convert the model")
    return _BY_EXTENSION[suffix]


def sniff_format(data: bytes) -> MeshFormat | None:
    """Return the format that the bytes of a file look like; None for no known one."""
    return next((mesh_format for mesh_format in FORMATS if mesh_format.sniff(data)), None)


def _scene_format(scene: Scene) -> MeshFormat:
    mesh_format = _BY_EXTENSION.get(f".{scene.format}", _ARRAYS)
    return UnpackedFormat(mesh_format) if is_archive(scene.path) else mesh_format


# Reading.


def load_scene(path: str | PathLike[str]) -> Scene:
    """Read all triangles of a mesh file: OBJ, PLY, STL, OFF, glTF, USD, FBX, COLLADA, 3MF, or one of these in a ZIP.

    Polygons, strips and fans are cut into triangles; points and lines are left out. Warnings are in Scene.warnings.

    Raises UsageError for an unknown extension, and InputError where the file is missing or damaged, has values that are
    not finite, refers to missing data or has no faces with area.
    """
    path = Path(path)
    if os.path.isdir(path):  # not of Path, which raises for names that are too long
        raise InputError(f"{path}: is a folder, a mesh file was expected; name a file inside it")
    format_of(path)
    return read_scene(path, _read_bytes(path))


def read_scene(path: Path, data: bytes) -> Scene:
    """Read a mesh file of the given bytes, as `load_scene` does.

    path   its extension names the format, and its folder has the files that the mesh refers to; need not exist, but for
           USD, which opens it again
    """
    mesh_format, data = format_of(path), text_as_utf8(data)
    try:
        with np.errstate(all="ignore"):  # values that are not finite are looked for afterwards
            return _with_numbers(mesh_format, mesh_format.read(path, data))
    except MemoryError as error:
        raise InputError(f"{path}: does not fit into memory; use a smaller model") from error
    except Exception as error:  # a damaged file may raise anything in a reader
        name = mesh_format.name
        if not mesh_format.sniff(data) and (foreign := foreign_file(path, data, name, sniff_format(data))) is not None:
            raise foreign from error
        if isinstance(error, AoprecalcError):
            raise
        raise unreadable_file(path, name, error) from error


def _with_numbers(mesh_format: MeshFormat, scene: Scene) -> Scene:
    """Return a scene that was just read, whose parts know the numbers of their objects and materials."""
    objects: dict[Hashable, int] = {}
    materials: dict[Hashable, int] = {}
    parts = []
    for part in scene.parts:
        material, _ = mesh_format.grouped(scene, part, "material")
        number = objects.setdefault(mesh_format.object_of(part), len(objects))
        parts.append(replace(part, file_object=number, file_material=materials.setdefault(material, len(materials))))
    return replace(scene, parts=tuple(parts))


def source_files(scene: Scene) -> list[Path]:
    """Return the files that a scene was read from or that its document refers to; no output may replace them."""
    return _scene_format(scene).source_files(scene)


def input_files(path: Path, data: bytes) -> list[Path]:
    """Return a mesh file of the given bytes and the files it refers to, existing or not, without reading the mesh."""
    mesh_format = _BY_EXTENSION.get(path.suffix.lower(), _ARRAYS)
    try:
        return [path, *dict.fromkeys(mesh_format.referenced_files(path, text_as_utf8(data)))]
    except Exception:  # a damaged file refers to nothing that could be used
        return [path]


def _read_bytes(path: Path) -> bytes:
    if not os.path.exists(path):
        meant = nearest(path.name, _meshes_in(path.parent))
        hint = f" (did you mean {path.with_name(meant)}?)" if meant else ""
        raise InputError(f"{path}: there is no such file{hint}, a mesh was expected; check the path")
    if not path.is_file():
        raise InputError(f"{path}: is a device or a pipe, a mesh file was expected; save it as a file first")
    try:
        data = path.read_bytes()
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror}); check its permissions") from error
    if not data:
        raise InputError(f"{path}: is empty (0 bytes), a mesh was expected; export it again")
    return data


def _meshes_in(folder: Path) -> list[str]:
    """Return the names of the mesh files in a folder, sorted; none where it cannot be read."""
    try:
        return sorted(entry.name for entry in folder.iterdir() if entry.name.lower().endswith(MESH_EXTENSIONS))
    except OSError:
        return []


def scene_in_pose(scene: Scene, pose: str) -> Scene:
    """Return a scene where an animation stands at a time; see `MeshFormat.in_pose`."""
    return _scene_format(scene).in_pose(scene, pose)


# Writing.


def output_mesh_extension(scene: Scene, atlases: Sequence[Atlas] = ()) -> tuple[str, str]:
    """Return the extension (with its dot) of the baked copy of a scene, and why it differs from the input's, if so.

    atlases   of the textures of the bake; none before they are known, when new UVs have to be expected
    """
    return _scene_format(scene).output_extension(scene, atlases)


def grouped(scene: Scene, part: Part, by: Literal["material", "mesh"]) -> tuple[Hashable, str]:
    """Return what tells the material, or the mesh, of a part from others, and its name; empty where it has none."""
    return _scene_format(scene).grouped(scene, part, by)


def part_occlusion(scene: Scene, part: Part) -> PartOcclusion:
    """Return the occlusion texture of a part, and its UVs; raises InputError where the document is damaged."""
    return _scene_format(scene).occlusion_of(scene, part)


def part_spaces(scene: Scene, part: Part) -> PartSpaces:
    """Return how the spaces of a part lie in that of the scene; raises InputError where the document is damaged."""
    return _scene_format(scene).spaces(scene, part)


def check_mesh_extension(
    path: str | PathLike[str], pack: Pack = "none", vertex_ao: VertexAo = "none", textures: Textures = "one"
) -> None:
    """Raise UsageError unless a mesh with UVs, textures and values as asked for can be written under that name."""
    suffix = Path(path).suffix.lower()
    if suffix not in OUTPUT_MESH_EXTENSIONS:
        known = ", ".join(OUTPUT_MESH_EXTENSIONS)
        found = f"the extension {suffix or '(none)'} is not that of a mesh with UVs"
        raise UsageError(f"{path}: {found}, one of {known} was expected; choose one of these")
    if pack == "orm" and not _BY_EXTENSION[suffix].packs_orm:
        found = f"is orm, which needs .gltf or .glb, but the mesh is {path}"
        raise ArgumentError("pack", f"{found}; omit it, or write one of these")
    if vertex_ao != "none" and not _BY_EXTENSION[suffix].holds_vertex_ao:
        found = f"is {vertex_ao}, which needs .gltf, .glb or .ply, but the mesh is {path}"
        raise ArgumentError("vertex_ao", f"{found}; omit it, or write one of these")
    if textures != "one" and not _BY_EXTENSION[suffix].holds_textures:
        known = ", ".join(extension for extension, kind in _BY_EXTENSION.items() if kind.holds_textures)
        found = f"is {textures}, but {path} refers to one texture; {known} were expected"
        raise ArgumentError("textures", f"{found}; omit it, or write one of these")


def write_baked_mesh(outputs: Outputs, mesh_path: str | PathLike[str], mesh: MeshWithAo) -> WrittenMesh:
    """Write a mesh with the UVs and normals of its bake in the format of `mesh_path`'s extension.

    outputs   receives all files: the mesh and what belongs to it (.mtl, .bin, copies of images)
    mesh      its textures are written already: to `outputs`, or as files

    A glTF source stays as it is except for the occlusion texture; OBJ and PLY refer to the texture by map_Kd or map_Ka
    and by a TextureFile comment. A GLB embeds the texture.

    Raises UsageError for another extension, OutputError where a file cannot be written.
    """
    check_mesh_extension(mesh_path, mesh.pack)
    path, scene = Path(mesh_path), mesh.scene
    try:
        format_of(path).check_source(path, scene)
        written = format_of(path).write_with_ao(outputs, path, mesh)
    except OSError as error:
        raise OutputError(f"{path}: cannot be written ({error.strerror}); choose another output") from error
    return replace(written, messages=as_packed(written.messages, scene.path))


def base_colors(scene: Scene, occlusion: Path | None = None) -> tuple[tuple[BaseColor, ...], tuple[str, ...]]:
    """Decode the base colours of a scene's parts, none where its format has none; return them and warnings.

    occlusion   the ambient-occlusion texture, which is no base colour wherever the file refers to it
    Textures that are missing or damaged are left out, with a warning. Raises InputError where the document is damaged.
    """
    images = ColorImages()
    colors = _scene_format(scene).base_colors(scene, images, occlusion)
    return colors, as_packed(tuple(dict.fromkeys(images.warnings)), scene.path)
