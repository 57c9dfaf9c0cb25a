"""The doors through which meshes come in and go out, whatever the kind of file."""

from collections.abc import Callable
from os import PathLike
from pathlib import Path

import numpy as np

from aoprecalc.errors import AoprecalcError, InputError, OutputError, UsageError
from aoprecalc.io.formats.gltf.document import GltfDocument, gltf_files
from aoprecalc.io.formats.gltf.reader import read_gltf
from aoprecalc.io.formats.gltf.writer import write_gltf
from aoprecalc.io.formats.obj.materials import material_files
from aoprecalc.io.formats.obj.reader import ObjDocument, obj_files, read_obj
from aoprecalc.io.formats.obj.writer import material_use, write_obj
from aoprecalc.io.formats.off import read_off
from aoprecalc.io.formats.ply import PlyDocument, ply_files, read_ply, write_ply
from aoprecalc.io.formats.stl import read_stl
from aoprecalc.io.outputs import Outputs
from aoprecalc.options import Pack
from aoprecalc.types import Atlas, Float32Array, Scene

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


def mesh_suffix(scene: Scene, atlas: Atlas | None = None) -> tuple[str, str]:
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


def check_mesh_suffix(path: str | PathLike[str], pack: Pack = "none") -> None:
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
    check_mesh_suffix(mesh_path, pack)
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
