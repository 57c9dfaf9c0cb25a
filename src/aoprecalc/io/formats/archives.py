"""Formats whose files are or may be ZIPs: one mesh with its files, as shops hand them out, COLLADA and 3MF.

A mesh with its files is unpacked into a temporary folder, which is removed when nothing refers to its document.
"""

import re
import shutil
import tempfile
import weakref
import zlib
from collections.abc import Callable, Hashable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from io import BytesIO
from pathlib import Path, PurePosixPath
from typing import Any, Literal
from zipfile import BadZipFile, ZipFile, ZipInfo, is_zipfile

import numpy as np

from aoprecalc.errors import InputError, UsageError, counted
from aoprecalc.io.formats.base import MeshFormat, PartOcclusion, PartSpaces
from aoprecalc.io.formats.builder import MeshPiece, build_scene, damaged_file
from aoprecalc.io.formats.files import ColorImages
from aoprecalc.progress import Note
from aoprecalc.types import REVERSED_WINDING, Atlas, BaseColor, Part, Scene

EXTENSION = ".zip"

_MAX_UNPACKED = 1 << 30  # bytes of all files together
_MAX_FILES = 10_000
_MAX_NAMES = 8  # of meshes in a message
_OF_PROGRAMS = (".blend", ".c4d", ".ma", ".mb", ".max", ".3ds", ".lwo", ".skp", ".step", ".stp", ".iges", ".abc")
_SIGNATURES = b"PK\3\4", b"PK\5\6"  # of a file in a ZIP, and of an empty ZIP
_ENCRYPTED = 1  # a flag of an entry
_FOLDER = "aoprecalc-zip-"


def is_archive(path: Path) -> bool:
    """Tell whether a path is that of a ZIP."""
    return path.suffix.lower() == EXTENSION


def inner_path(path: Path) -> Path:
    """Return the path of a scene; of one that was in a ZIP a path in it, which is in no folder of an output."""
    return path / "mesh" if is_archive(path) else path


def as_packed(messages: tuple[str, ...], path: Path) -> tuple[str, ...]:
    """Return messages about a scene at `path` in which unpacked files have the path that they have in their ZIP."""
    if not is_archive(path):
        return messages
    unpacked = re.compile(re.escape(str(Path(tempfile.gettempdir()) / _FOLDER)) + r"\w+")
    return tuple(type(line)(unpacked.sub(lambda _: str(path), line)) for line in messages)


def check_pictures(path: Path, scene: Scene) -> None:
    """Raise UsageError for a mesh at `path` that cannot refer to the pictures of a scene, as they are in a ZIP."""
    if is_archive(scene.path):
        raise UsageError(f"{path}: cannot refer to pictures in {scene.path}; write a .glb or .gltf")


def check_unpacked_size(path: Path, archive: ZipFile) -> None:
    """Raise InputError for a ZIP that would fill the memory or the disk, as a few megabytes of it may."""
    entries = archive.infolist()
    size = sum(entry.file_size for entry in entries)
    if size > _MAX_UNPACKED:
        expected = f"at most {_MAX_UNPACKED >> 30} GiB were expected; use a smaller model"
        raise InputError(f"{path}: is a ZIP of {size / (1 << 30):.1f} GiB when unpacked, {expected}")
    if len(entries) > _MAX_FILES:
        raise InputError(f"{path}: is a ZIP of {len(entries)} files, at most {_MAX_FILES} were expected; unpack it")


class ZipFormat(MeshFormat):
    """A ZIP that holds one mesh of another format, with its files."""

    name = "ZIP"
    extensions = (EXTENSION,)

    def __init__(self, formats: Iterable[MeshFormat], load: Callable[[Path], Scene]) -> None:
        """Read meshes of the given formats by `load`."""
        self._known = tuple(extension for one in formats for extension in one.extensions)
        self._load = load

    def sniff(self, data: bytes) -> bool:
        """Tell whether it begins as a ZIP does, and is no 3MF."""
        return data.startswith(_SIGNATURES) and b"3dmodel.model" not in data.lower()

    def read(self, path: Path, data: bytes) -> Scene:
        """Read its mesh as one of its own format, at the path of the ZIP."""
        if not is_zipfile(BytesIO(data)) and not self.sniff(data):
            found = f"it starts with {data[:24].decode('latin-1')!a}, a ZIP was expected"
            raise InputError(f"{path}: {found}; pack the mesh with its files, or rename it")
        folder = Path(tempfile.mkdtemp(prefix=_FOLDER))
        document: object = None
        try:
            with _damage_told(path), ZipFile(BytesIO(data)) as archive:
                if not archive.namelist():
                    raise InputError(f"{path}: is an empty ZIP, one mesh with its files was expected; pack it again")
                check_unpacked_size(path, archive)
                files = dict(_safe_files(path, archive))
                mesh = self._only_mesh(path, list(files))
                for name, entry in files.items():
                    target = folder / name
                    target.parent.mkdir(parents=True, exist_ok=True)
                    target.write_bytes(archive.read(entry))
            try:
                scene = self._load(folder / mesh)
            except InputError as error:
                raise InputError(*as_packed((str(error),), path)) from error
            document = scene.document
            warnings, notes = as_packed(scene.warnings, path), as_packed(scene.notes, path)
            return replace(scene, path=path, warnings=warnings, notes=notes)
        finally:
            if document is None:
                shutil.rmtree(folder, ignore_errors=True)
            else:  # it refers to pictures
                weakref.finalize(document, shutil.rmtree, folder, ignore_errors=True)

    def _only_mesh(self, path: Path, names: list[str]) -> str:
        """Return the name of the one mesh; raises InputError where there are more or none."""
        found = [name for name in names if name.lower().endswith(self._known)]
        if len(found) == 1:
            return found[0]
        if not found:
            nested = next((name for name in names if name.lower().endswith(EXTENSION)), None)
            other = next((name for name in names if name.lower().endswith(_OF_PROGRAMS)), None)
            hint = f"unpack it and use {nested}" if nested else "pack the mesh with its files"
            hint = f"export {other} as glTF" if other and not nested else hint
            kinds = ", ".join(self._known)
            raise InputError(f"{path}: {counted(len(names), 'file')} and no mesh, one of {kinds} was expected; {hint}")
        listed = ", ".join(found[:_MAX_NAMES]) + (", ..." if len(found) > _MAX_NAMES else "")
        raise InputError(f"{path}: holds {len(found)} meshes ({listed}), one was expected; unpack it and name one")


@contextmanager
def _damage_told(path: Path) -> Iterator[None]:
    try:
        yield
    except (BadZipFile, zlib.error, EOFError, NotImplementedError, RuntimeError) as error:
        reason = " ".join(str(error).split())[:100] or type(error).__name__
        raise damaged_file(path, f"a ZIP was expected, but it cannot be unpacked ({reason})") from error
    except OSError as error:
        raise InputError(f"{path}: cannot be unpacked ({error.strerror}); unpack it yourself") from error


def _safe_files(path: Path, archive: ZipFile) -> Iterator[tuple[str, ZipInfo]]:
    """Yield the relative path of each file, with forward slashes; raises InputError for one that leaves the folder.

    Hidden files are left out, and those that macOS adds. A link becomes a file with the text of its target.
    """
    for entry in archive.infolist():
        name = PurePosixPath(entry.filename.replace("\\", "/"))
        if entry.is_dir() or "__MACOSX" in name.parts or name.name.startswith("."):
            continue
        if name.is_absolute() or ".." in name.parts or re.search(r'[:*?"<>|\x00-\x1f]', str(name)):
            raise InputError(f"{path}: a file in it is named {str(name)[:80]!a}, a path inside it was expected")
        if entry.flag_bits & _ENCRYPTED:
            raise InputError(f"{path}: is protected by a password; unpack it and use the mesh inside")
        yield str(name), entry


class UnpackedFormat(MeshFormat):
    """The format of a mesh that was in a ZIP: its copy is a GLB, which holds its pictures.

    inner   the format of the mesh
    """

    def __init__(self, inner: MeshFormat) -> None:
        """Behave as the inner format."""
        self._inner = inner
        self.name = inner.name  # type: ignore[misc]  # others state it once for the class

    def sniff(self, data: bytes) -> bool:
        """Ask the inner format."""
        return self._inner.sniff(data)

    def read(self, path: Path, data: bytes) -> Scene:
        """Ask the inner format."""
        return self._inner.read(path, data)

    def in_pose(self, scene: Scene, pose: str) -> Scene:
        """Ask the inner format."""
        return self._inner.in_pose(scene, pose)

    def source_files(self, scene: Scene) -> list[Path]:
        """Return the ZIP."""
        return [scene.path]

    def output_extension(self, scene: Scene, atlases: Sequence[Atlas]) -> tuple[str, str]:
        """Return .glb."""
        return ".glb", f"the {self.name} of a ZIP becomes a GLB with its pictures"

    def grouped(self, scene: Scene, part: Part, by: Literal["material", "mesh"]) -> tuple[Hashable, str]:
        """Ask the inner format."""
        return self._inner.grouped(scene, part, by)

    def spaces(self, scene: Scene, part: Part) -> PartSpaces:
        """Ask the inner format."""
        return self._inner.spaces(scene, part)

    def object_of(self, part: Part) -> Hashable:
        """Ask the inner format."""
        return self._inner.object_of(part)

    def occlusion_of(self, scene: Scene, part: Part) -> PartOcclusion:
        """Ask the inner format."""
        return self._inner.occlusion_of(scene, part)

    def base_colors(self, scene: Scene, images: ColorImages, occlusion: Path | None) -> tuple[BaseColor, ...]:
        """Ask the inner format."""
        return self._inner.base_colors(scene, images, occlusion)


# 3MF, through trimesh: triangles, and the placement of each instance.

_LEFT_OUT = {  # what is not read: words for it -> how it begins in the XML
    "materials and colours": rb"(?:basematerials|colorgroup|compositematerials|multiproperties)\b",
    "textures": rb"texture2d",
    "beams": rb"beamlattice\b",
    "slices": rb"slicestack\b",
}


class ThreeMfFormat(MeshFormat):
    """3D Manufacturing Format."""

    name = "3MF"
    extensions = (".3mf",)

    def sniff(self, data: bytes) -> bool:
        """Tell whether it is a ZIP with a 3D model in it."""
        return data.startswith(b"PK") and b"3dmodel.model" in data.lower()

    def read(self, path: Path, data: bytes) -> Scene:
        """Read every instance of every mesh as a part; raises InputError where a package is missing."""
        from trimesh import available_formats  # takes half a second, which other formats should not pay
        from trimesh.exchange.load import mesh_loaders

        if "3mf" not in available_formats():
            needed = "the package networkx and lxml"
            raise InputError(f"{path}: {self.name} needs {needed}; `pip install 'aoprecalc[formats]'`")
        with ZipFile(BytesIO(data)) as archive:
            check_unpacked_size(path, archive)
            text = b"".join(archive.read(name) for name in archive.namelist() if name.lower().endswith(".model"))
        load: Any = mesh_loaders["3mf"]
        loaded = load(file_obj=BytesIO(data), file_type="3mf", resolver=None)
        unit = re.search(rb'<(?:\w+:)?model\b[^>]*\bunit="(\w+)"', text)
        name, messages = unit[1].decode() if unit else "millimeter", list[str]()
        if name != "meter":
            kept = "its numbers are kept, and a GLB has metres and Y"
            messages.append(Note(f"its unit is the {name}, and Z points up; {kept}"))
        if lost := [words for words, start in _LEFT_OUT.items() if re.search(rb"<(?:\w+:)?" + start, text)]:
            messages.append(f"{path}: {self.name} is read without {', '.join(lost)}, which it has; export it as glTF")
        return build_scene(path, "3mf", list(_pieces(loaded)), messages=messages)

    def output_extension(self, scene: Scene, atlases: Sequence[Atlas]) -> tuple[str, str]:
        """Return .glb."""
        return ".glb", f"{self.name} is not written, so the mesh becomes a GLB"


def _pieces(loaded: dict[str, Any]) -> Iterator[MeshPiece]:
    """Yield each instance of a geometry, placed in the world, from what the loader of trimesh returns."""
    from trimesh.scene.transforms import SceneGraph

    graph: Any = SceneGraph(base_frame=loaded.get("base_frame", "world"))
    for edge in loaded["graph"]:
        graph.update(**edge)
    for node in graph.nodes_geometry:
        matrix, name = graph.get(node)
        mesh, linear = loaded["geometry"][name], matrix[:3, :3]
        faces = np.asarray(mesh["faces"], np.int64).reshape(-1, 3)
        if np.linalg.det(linear) < 0:
            faces = faces[:, REVERSED_WINDING]
        positions = np.asarray(mesh["vertices"], np.float64).reshape(-1, 3) @ linear.T + matrix[:3, 3]
        yield MeshPiece(str(node), positions, faces, names=(str(name),))
