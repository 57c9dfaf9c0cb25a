"""The doors through which meshes come in and go out, whatever the kind of file."""

import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from os import PathLike
from pathlib import Path

import numpy as np

from aoprecalc.errors import AoprecalcError, InputError, OutputError, UsageError
from aoprecalc.io.formats.base import Picture, Pictured
from aoprecalc.io.formats.builder import damaged
from aoprecalc.io.formats.gltf.document import GltfDocument, gltf_files
from aoprecalc.io.formats.gltf.occlusion_textures import gltf_occlusion
from aoprecalc.io.formats.gltf.reader import read_gltf
from aoprecalc.io.formats.gltf.writer import write_gltf
from aoprecalc.io.formats.obj.materials import material_files
from aoprecalc.io.formats.obj.reader import ObjDocument, Section, obj_files, read_obj
from aoprecalc.io.formats.obj.writer import material_use, write_obj
from aoprecalc.io.formats.off import read_off
from aoprecalc.io.formats.ply import PlyDocument, ply_files, read_ply, write_ply
from aoprecalc.io.formats.stl import read_stl
from aoprecalc.io.outputs import Outputs
from aoprecalc.options import Pack
from aoprecalc.types import Atlas, BoolArray, Float32Array, Float64Array, Part, Scene

READERS: dict[str, Callable[[Path, bytes], Scene]] = {
    "obj": read_obj,
    "ply": read_ply,
    "stl": read_stl,
    "off": read_off,
    "gltf": read_gltf,
    "glb": read_gltf,
}

# What finds the files that one refers to; the other kinds of file refer to none.
REFERENCES: dict[str, Callable[[Path, bytes], list[Path]]] = {
    "obj": obj_files,
    "ply": ply_files,
    "gltf": gltf_files,
    "glb": gltf_files,
}

WRITERS: dict[str, Callable[[Outputs, Path, Scene, Atlas, Float32Array, Path, Pack], tuple[str, ...]]] = {
    "obj": write_obj,
    "ply": write_ply,
    "gltf": write_gltf,
    "glb": write_gltf,
}

MESH_EXTENSIONS = tuple(f".{kind}" for kind in READERS)
OUTPUT_MESH_EXTENSIONS = tuple(f".{kind}" for kind in WRITERS)


def load_scene(path: str | PathLike[str]) -> Scene:
    """Read all triangles of an OBJ, PLY, STL, OFF, glTF or GLB file.

    Polygons, strips and fans come as triangles, points and lines are left out. What a user should know about the
    input is in Scene.warnings.

    Raises UsageError for another extension, and InputError if the file is missing, cannot be understood, is not
    finite, refers to what is not there or has no faces with area.
    """
    path = Path(path)
    if path.is_dir():
        raise InputError(f"{path}: is a folder, a mesh file was expected; name a file inside it")
    kind = path.suffix.lower().removeprefix(".")
    if kind not in READERS:
        known = ", ".join(f".{known}" for known in READERS)
        raise UsageError(f"{path}: the extension {path.suffix or '(none)'} is not one of {known}; convert the model")
    data = _read(path)
    try:
        with np.errstate(all="ignore"):  # numbers that are not finite are looked for, so they need no second word
            return READERS[kind](path, data)
    except AoprecalcError:
        raise
    except MemoryError as error:
        raise InputError(f"{path}: does not fit into memory; use a smaller model") from error
    except Exception as error:  # whatever a damaged file provokes in a reader
        reason = " ".join(str(error).split())[:120] or type(error).__name__
        if isinstance(error, KeyError):
            reason = f"{reason} is missing or unknown"
        raise InputError(
            f"{path}: cannot be understood as {kind.upper()} ({reason}); the file is damaged, export it again"
        ) from error


def source_files(scene: Scene) -> list[Path]:
    """Return the files that a scene was read from or that its document refers to; no output may replace them."""
    if isinstance(scene.document, GltfDocument):
        return [scene.path, *scene.document.files()]
    if isinstance(scene.document, ObjDocument):
        return [scene.path, *scene.document.libraries, *material_files(scene.document.materials.values())]
    if isinstance(scene.document, PlyDocument) and scene.document.picture is not None:
        return [scene.path, scene.document.picture]
    return [scene.path] if scene.format else []


def input_files(path: Path, data: bytes) -> list[Path]:
    """Return the same, whether they are there or not, of a mesh file of the given bytes, without reading its mesh."""
    kind = path.suffix.lower().removeprefix(".")
    try:
        return [path, *dict.fromkeys(REFERENCES[kind](path, data) if kind in REFERENCES else ())]
    except Exception:  # a damaged file refers to nothing that could be used
        return [path]


def output_mesh_extension(scene: Scene, atlas: Atlas | None = None) -> tuple[str, str]:
    """Return the extension (with its dot) that a baked copy of the scene gets, and why if it is another than before.

    atlas   the UVs of the bake; None where they are not known yet and may be new ones

    An OBJ stays one unless its set of UVs is needed by the pictures (map_Kd) of parts that receive, and for new UVs.
    """
    if not scene.format:  # from arrays
        return ".glb", ""
    if scene.format not in WRITERS:
        return ".glb", f"{scene.format.upper()} holds no UVs, so the mesh becomes a GLB"
    if isinstance(scene.document, ObjDocument) and (atlas is None or atlas.uv_set is None):
        used = dict.fromkeys(material for material, receives in map(material_use, scene.parts) if receives)
        known = scene.document.materials
        pictured = [name for name in used if name in known and known[name].picture is not None]
        if pictured:
            names = ", ".join(pictured[:3]) + (", ..." if len(pictured) > 3 else "")
            found = f"OBJ holds one set of UVs, which the textures of its materials ({names}) need"
            return ".glb", f"{found}, so the mesh becomes a GLB with both"
    return f".{scene.format}", ""


def check_mesh_extension(path: str | PathLike[str], pack: Pack = "none") -> None:
    """Raise UsageError unless a mesh with UVs, packed as asked for, can be written under that name."""
    suffix = Path(path).suffix.lower()
    if suffix.removeprefix(".") not in WRITERS:
        known = ", ".join(f".{known}" for known in WRITERS)
        found = f"the extension {suffix or '(none)'} is of no mesh that holds UVs"
        raise UsageError(f"{path}: {found}, one of {known} was expected; choose one of these")
    if pack == "orm" and suffix not in (".gltf", ".glb"):
        raise UsageError(f"{path}: --pack orm is for .gltf and .glb alone; omit it, or write one of these")


def write_baked_mesh(
    outputs: Outputs,
    mesh_path: str | PathLike[str],
    scene: Scene,
    atlas: Atlas,
    normals: Float32Array,
    texture_path: str | PathLike[str],
    *,
    pack: Pack = "none",
) -> tuple[str, ...]:
    """Write a mesh with the UVs and normals of its bake, its kind by the extension of `mesh_path`.

    outputs        receives all files: the mesh and what goes with it (.mtl, .bin, copies of images)
    atlas          of the scene
    normals        (f, 3, 3) float32, unit length: the shading normals that were used
    texture_path   of the baked texture, already written: to `outputs`, or as a file
    pack           orm: glTF has the texture in one picture with roughness and metalness where these have the same UVs

    A glTF document keeps everything else, and has the texture as occlusion texture; OBJ and PLY refer to it by
    map_Kd or map_Ka and a TextureFile comment. A GLB holds the texture in itself.

    Returns lines that the user should see. Raises UsageError for another extension, OutputError where a file cannot be
    written.
    """
    check_mesh_extension(mesh_path, pack)
    path = Path(mesh_path)
    write = WRITERS[path.suffix.lower().removeprefix(".")]
    try:
        return write(outputs, path, scene, atlas, normals, Path(texture_path), pack)
    except OSError as error:
        raise OutputError(f"{path}: cannot be written ({error.strerror}); choose another output") from error


def _read(path: Path) -> bytes:
    if not path.exists():
        raise InputError(f"{path}: there is no such file, a mesh was expected; check the path")
    if not path.is_file():
        raise InputError(f"{path}: is a device or a pipe, a mesh file was expected; save it as a file first")
    try:
        data = path.read_bytes()
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror}); check its permissions") from error
    if not data:
        raise InputError(f"{path}: is empty (0 bytes), a mesh was expected; export it again")
    if data.startswith(b"version https://git-lfs"):
        raise InputError(f"{path}: is a Git LFS pointer, not the mesh itself; run `git lfs pull` to fetch the mesh")
    return data


# The occlusion texture of a mesh.


class NoOcclusionError(InputError):
    """A mesh refers to no picture of its ambient occlusion, or has no UVs by which one lies on it."""


@dataclass(frozen=True, eq=False)
class OcclusionTexture:
    """A picture of ambient occlusion and how it lies on a scene.

    name      what to call it: the path of its file, where it has one of its own
    path      of that file; None where it is within the mesh's
    values    (height, width) float32, row 0 at v = 1
    uvs       (f, 3, 2) float64, v upwards, NaN where a face has none
    shown     (f,) bool: the faces that show this picture
    warnings  what the user should know
    """

    name: str
    path: Path | None
    values: Float32Array
    uvs: Float64Array
    shown: BoolArray
    warnings: tuple[str, ...]


def find_occlusion(scene: Scene, texture: Path | None = None) -> OcclusionTexture:
    """Return the ambient occlusion of a scene: of a `texture` where one is given, else of what the file refers to.

    That is the occlusionTexture of glTF, map_Ka or map_Kd of an OBJ's materials, and the TextureFile of a PLY; where
    there is none, `<stem>.png` beside the mesh. Where materials have different pictures, it is the first, or that of
    them which is `texture`, and its faces only. UVs are those of the occlusionTexture, else the file's first.

    Raises NoOcclusionError where there are no UVs or no picture is found, InputError where it cannot be read.
    """
    parts = [_part(scene, part) for part in scene.parts]
    if all(part.uvs is None for part in parts):
        found = "has no UVs, by which a texture lies on a mesh"
        raise NoOcclusionError(f"{scene.path}: {found}; bake it, or export it with UVs")
    pictures = list(dict.fromkeys(part.picture for part in parts if part.picture is not None))
    chosen = _choose(scene.path, pictures, texture)
    sizes = [part.stop - part.start for part in scene.parts]
    shown = np.repeat([chosen not in pictures or part.picture == chosen for part in parts], sizes)
    uvs = [np.full((n, 3, 2), np.nan) if part.uvs is None else part.uvs for n, part in zip(sizes, parts, strict=True)]

    said = dict.fromkeys(part.note for part in parts if part.note and part.picture == chosen)
    if not shown.all():
        others = ", ".join(picture.name for picture in pictures if picture != chosen)
        left_out = f"{np.count_nonzero(~shown)} of {len(shown)} faces are left out: their materials have"
        said[f"{left_out} {f'other pictures ({others})' if others else 'no such picture'}"] = None
    values = chosen.read()
    if not np.isfinite(values).all():
        raise InputError(f"{chosen.name}: holds values that are not finite, 0 to 1 were expected; bake it again")
    return OcclusionTexture(chosen.name, chosen.path, values, np.concatenate(uvs), shown, tuple(said))


def _part(scene: Scene, part: Part) -> Pictured:
    """Return what the scene's document says about one part."""
    if isinstance(scene.document, GltfDocument):
        try:
            return gltf_occlusion(scene.document, part)
        except AoprecalcError:
            raise
        except Exception as error:  # whatever a damaged document provokes
            reason = f"its materials cannot be understood ({type(error).__name__}: {error})"
            raise damaged(scene.path, reason) from error
    path = None
    if isinstance(scene.document, ObjDocument) and isinstance(part.source, Section):
        material = scene.document.materials.get(part.source.material or "")
        path = None if material is None else material.ambient or material.picture
    elif isinstance(scene.document, PlyDocument):
        path = scene.document.picture
    uvs = None if scene.uvs is None else scene.uvs[part.start : part.stop]
    return Pictured(None if path is None else Picture(str(path), path), uvs)


def _choose(mesh: Path, pictures: Sequence[Picture], texture: Path | None) -> Picture:
    beside = mesh.with_suffix(".png")
    if texture is None and not pictures and beside.is_file():
        texture = beside
    if texture is not None:
        same = (p for p in pictures if p.path is not None and os.path.realpath(p.path) == os.path.realpath(texture))
        return next(same, Picture(str(texture), texture))
    if not pictures:
        raise NoOcclusionError(
            f"{mesh}: refers to no picture of its ambient occlusion, and there is no {beside.name} beside it; "
            "pass the picture with --texture"
        )
    return pictures[0]
