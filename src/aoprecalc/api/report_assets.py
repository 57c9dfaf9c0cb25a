"""The assets of a report page: which of the files that `bake`, `spheres`, `verify` and `batch` wrote belong together.

Files belong together where they are in one folder and have one stem, but for the endings of SUFFIXES (`car_ao.glb`,
`car_ao.png`, `car_spheres.json`), or where a report names them.
"""

import os
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from os import PathLike
from pathlib import Path
from typing import Any, Literal, TypeVar

import msgspec

from aoprecalc.api.documents import Document
from aoprecalc.api.reports import BakeReport
from aoprecalc.api.verify_report import VerifyReport
from aoprecalc.errors import ArgumentError, InputError, counted
from aoprecalc.io import IMAGE_EXTENSIONS, MESH_EXTENSIONS, OUTPUT_MESH_EXTENSIONS
from aoprecalc.io.occlusion import mesh_beside
from aoprecalc.io.outputs import SCHEMAS, read_json_object
from aoprecalc.io.sphere_files import SPHERE_EXTENSIONS

SUFFIXES = ("_ao", "_spheres", "_report", "_verify", "_heat_map")
EXPECTED = (
    "a mesh that bake wrote, its texture, a sphere set, a report of bake, verify or batch, or a folder of them was "
    "expected"
)

Result = str | PathLike[str] | Document
Role = Literal["mesh", "texture", "spheres", "heat_map"]
Key = tuple[str, str]  # real path of the folder, and the stem
_Report = TypeVar("_Report")


@dataclass(frozen=True)
class BatchedSummary:
    """What the report of a batch says about the bake of an asset."""

    warnings: tuple[str, ...] = ()


@dataclass(frozen=True)
class BatchedError:
    """Why a batch could not make an asset."""

    message: str = ""


@dataclass(frozen=True)
class BatchedAsset:
    """What the report of a batch says about one asset; see `pipeline.report.AssetReport`."""

    name: str
    path: str
    status: Literal["made", "unchanged", "cached", "failed", "stopped"]
    outputs: tuple[str, ...]
    summary: BatchedSummary | None
    error: BatchedError | None
    commands: tuple[str, ...]
    seconds: float


@dataclass(frozen=True)
class _BatchDocument:
    output: str
    assets: tuple[BatchedAsset, ...]


@dataclass(frozen=True)
class AssetFiles:
    """The files of one asset, and what reports say about it.

    name      as the batch calls it, else its path below the folder of results without extension
    mesh      with its ambient occlusion, or else the mesh that was read
    spheres   a sphere set
    certain   it is a result: named by the user or a report, or by its ending; else a mesh that may have a texture
    others    files of the same stem that are not shown
    damage    why one of its reports cannot be read; empty where all can
    """

    name: str
    mesh: Path | None = None
    texture: Path | None = None
    spheres: Path | None = None
    heat_map: Path | None = None
    bake: BakeReport | None = None
    verify: VerifyReport | None = None
    batched: BatchedAsset | None = None
    certain: bool = False
    given: bool = False
    others: tuple[Path, ...] = ()
    damage: str = ""

    @property
    def failed(self) -> bool:
        """Tell whether a batch could not make it."""
        return self.batched is not None and self.batched.status == "failed"


def collect_assets(results: Result | Sequence[Result], argument: str = "results") -> tuple[AssetFiles, ...]:
    """Return the assets of files, folders and reports, in the order of their names.

    Raises InputError where one is missing, is no result or cannot be read; ArgumentError for values of other types.
    """
    several = results if isinstance(results, list | tuple) else [results]
    if not several:
        raise ArgumentError(argument, f"is empty; {EXPECTED}")
    found = _Collection()
    for result in several:
        if isinstance(result, Document):
            found.add_document(result.to_dict(), Path(), f"a {type(result).__name__}", given=True)
        elif not isinstance(result, str | PathLike) or not os.fspath(result):
            raise ArgumentError(argument, f"has a value of type {type(result).__name__}; {EXPECTED}")
        elif Path(result).is_dir():
            found.add_folder(Path(result))
        else:
            found.add_file(Path(result))
    return found.assets()


@dataclass
class _Entry:
    """An asset as it is found."""

    name: str
    files: dict[Role, list[Path]] = field(default_factory=dict)
    bake: BakeReport | None = None
    verify: VerifyReport | None = None
    batched: BatchedAsset | None = None
    certain: bool = False
    given: bool = False
    damage: str = ""


class _Collection:
    """Files by asset; what is added later completes what is there."""

    def __init__(self) -> None:
        self._entries: dict[Key, _Entry] = {}
        self._root: Path | None = None

    def assets(self) -> tuple[AssetFiles, ...]:
        """Return what was found, with distinct names."""
        finished = [_finished(entry) for entry in self._entries.values()]
        count = Counter(asset.name for asset in finished)
        distinct = [
            replace(asset, name=f"{folder}/{stem}") if count[asset.name] > 1 else asset
            for asset, (folder, stem) in zip(finished, self._entries, strict=True)
        ]
        return tuple(sorted(distinct, key=lambda asset: asset.name))

    def add_folder(self, folder: Path) -> None:
        """Add the results below a folder; raises InputError where there are none."""
        files = sorted(_files_below(folder))
        self._root, found = folder, False
        for path in files:
            role = _role_by_name(path)
            if role is not None:
                certain = path.stem.lower().endswith(SUFFIXES)
                self._add(role, path, certain=certain)
                found = True
            elif path.suffix.lower() == ".json":
                found |= self._add_json(path, given=False)
        self._root = None
        if not found:
            raise InputError(f"{folder}: has no results among {counted(len(files), 'file')}; {EXPECTED}")

    def add_file(self, path: Path) -> None:
        """Add a file that the user has named."""
        if not path.exists():
            raise InputError(f"{path}: there is no such file or folder; {EXPECTED}; check the path")
        suffix = path.suffix.lower()
        if suffix == ".json":
            self._add_json(path, given=True)
        elif suffix in MESH_EXTENSIONS and not (suffix in SPHERE_EXTENSIONS and _ends(path, "_spheres")):
            self._add("mesh", path, given=True)
        elif suffix in IMAGE_EXTENSIONS:
            beside = mesh_beside(path)
            one_of_several = beside is not None and _key(beside) != _key(path)  # to which the mesh refers
            if beside is not None:
                self._add("mesh", beside, given=one_of_several)
            if not one_of_several:
                self._add("texture", path, given=True)
        elif suffix in SPHERE_EXTENSIONS:
            self._add("spheres", path, given=True)
        else:
            raise InputError(f"{path}: has the extension {suffix or '(none)'}; {EXPECTED}")

    def _add(self, role: Role, path: Path, *, certain: bool = True, given: bool = False) -> _Entry:
        entry = self._entry(_key(path))
        known = entry.files.setdefault(role, [])
        if path not in known:
            known.append(path)
        entry.certain |= certain
        entry.given |= given
        return entry

    def _entry(self, key: Key) -> _Entry:
        if key not in self._entries:
            folder, stem = key
            below = "." if self._root is None else os.path.relpath(folder, os.path.realpath(self._root))
            self._entries[key] = _Entry(stem if below == "." else f"{below.replace(os.sep, '/')}/{stem}")
        return self._entries[key]

    def _add_json(self, path: Path, *, given: bool) -> bool:
        """Add a report or a sphere set; tell whether it is one. A damaged one is raised where `given`, else noted."""
        document: dict[str, Any] | None = None
        try:
            document = read_json_object(path)
            if isinstance(document.get("spheres"), list):
                self._add("spheres", path, given=given)
                return True
            return self.add_document(document, path, str(path), given=given)
        except InputError as error:
            if path.stem.lower().endswith(SUFFIXES) and not given:
                entry = self._entry(_key(path))
                entry.certain, entry.damage = True, str(error)
                return True
            if given or document is not None:
                raise
            return False

    def add_document(self, document: dict[str, Any], path: Path, label: str, *, given: bool) -> bool:
        """Add a report; tell whether the document is one.

        path    its file; Path() for one in memory, whose paths are relative to the current folder
        label   what messages call it
        """
        kind = _kind_of(document)
        if kind is None:
            if given:
                raise InputError(f"{label}: is a JSON document of another kind; {EXPECTED}")
            return False
        if document.get("schema") != SCHEMAS[kind]:
            raise InputError(
                f"{label}: has the schema {document.get('schema')!r}, {SCHEMAS[kind]} was expected; "
                f"write it again by this version of aoprecalc"
            )
        if kind == "batch":
            self._add_batch(_typed(document, _BatchDocument, label), path.parent)
        elif kind == "bake":
            self._add_bake(_typed(document, BakeReport, label), path, given=given)
        else:
            self._add_verify(_typed(document, VerifyReport, label), path, given=given)
        return True

    def _add_bake(self, report: BakeReport, path: Path, *, given: bool) -> None:
        outputs = report.outputs
        mesh, texture = (_located(name, path.parent) for name in (outputs.mesh, outputs.texture))
        anchor = mesh or texture or (path if path.name else Path(report.input.path))
        entry = self._entry(_key(anchor))
        entry.bake, entry.certain, entry.given = report, True, entry.given or given
        if mesh is not None:
            self._add("mesh", mesh)
        if texture is not None and len(outputs.textures) <= 1:  # the mesh refers to several
            self._add("texture", texture)

    def _add_verify(self, report: VerifyReport, path: Path, *, given: bool) -> None:
        mesh = _located(report.input.path, path.parent)
        heat_map = _located(report.outputs.heat_map, path.parent)
        entry = self._entry(_key(mesh or (path if path.name else Path(report.input.path))))
        entry.verify, entry.certain, entry.given = report, True, entry.given or given
        if mesh is not None:
            self._add("mesh", mesh)
        if heat_map is not None and heat_map not in entry.files.setdefault("heat_map", []):
            entry.files["heat_map"].append(heat_map)

    def _add_batch(self, report: _BatchDocument, folder: Path) -> None:
        root = _batch_root(report, folder)
        for asset in report.assets:
            entry = self._entry((_real((root / asset.name).parent), Path(asset.name).name))
            entry.name, entry.batched, entry.certain = asset.name, asset, True
            for output in asset.outputs:
                path = root / _below(output, report.output)
                role = _role_by_name(path)
                if not _is_file(path):
                    continue
                if role is not None:
                    known = entry.files.setdefault(role, [])
                    known.extend([] if path in known else [path])
                elif _ends(path, "_report") and path.suffix.lower() == ".json":
                    try:
                        entry.bake = _typed(read_json_object(path), BakeReport, str(path))
                    except InputError as error:
                        entry.damage = str(error)


def _finished(entry: _Entry) -> AssetFiles:
    """Return an asset with one file of each role: of several, the one that a report names or the richest format."""
    named = [path for path in (entry.bake.outputs.mesh, entry.bake.outputs.texture) if path] if entry.bake else []
    names = {Path(path).name for path in named}
    order = (*OUTPUT_MESH_EXTENSIONS, *SPHERE_EXTENSIONS, *IMAGE_EXTENSIONS)

    def rank(path: Path) -> tuple[bool, bool, int]:
        suffix = path.suffix.lower()
        position = order.index(suffix) if suffix in order else len(order)
        return path.name not in names, not _ends(path, "_ao"), position

    chosen, others = dict[Role, Path](), list[Path]()
    for role, paths in entry.files.items():
        chosen[role], *rest = sorted(paths, key=rank)
        others += [path for path in rest if role == "spheres" or _ends(path, "_ao")]
    if "mesh" not in chosen:
        given = entry.batched.path if entry.batched else entry.bake.input.path if entry.bake else ""
        source = _located(given or None, Path())
        if source is not None and "spheres" in chosen:
            chosen["mesh"] = source
    same = {name: getattr(entry, name) for name in ("bake", "verify", "batched", "certain", "given", "damage")}
    files: dict[str, Any] = {str(role): path for role, path in chosen.items()}
    return AssetFiles(entry.name, **files, **same, others=tuple(others))


def _kind_of(document: dict[str, Any]) -> Literal["bake", "verify", "batch"] | None:
    """Return the kind of a report by its keys; None for others."""
    if {"counts", "assets"} <= document.keys():
        return "batch"
    if {"unwrap", "texels"} <= document.keys():
        return "bake"
    return "verify" if {"levels", "tolerance"} <= document.keys() else None


def _typed(document: dict[str, Any], kind: type[_Report], label: str) -> _Report:
    """Return a document as its class; raises InputError where keys are missing or have values of other types."""
    try:
        return msgspec.convert(document, kind)
    except (msgspec.ValidationError, ArgumentError, UnicodeError) as error:
        raise InputError(f"{label}: is no whole report ({error}); write it again") from error


def _role_by_name(path: Path) -> Role | None:
    """Return what a file of a folder of results is, by its name; None for others, and for reports."""
    suffix = path.suffix.lower()
    if suffix in SPHERE_EXTENSIONS and _ends(path, "_spheres"):
        return "spheres"
    if suffix in OUTPUT_MESH_EXTENSIONS:
        return "mesh"
    if suffix in IMAGE_EXTENSIONS:
        return "texture" if _ends(path, "_ao") else "heat_map" if _ends(path, "_heat_map") else None
    return None


def _ends(path: Path, ending: str) -> bool:
    return path.stem.lower().endswith(ending)


def _key(path: Path) -> Key:
    """Return the folder of a file and its stem without the endings of SUFFIXES."""
    stem = path.stem
    while (ending := next((e for e in SUFFIXES if stem.lower().endswith(e) and len(stem) > len(e)), "")) != "":
        stem = stem[: -len(ending)]
    return _real(path.parent), stem


def _real(folder: Path) -> str:
    """Return the real path of a folder; as it is where no file system can have it, as a damaged report may say."""
    try:
        return os.path.realpath(folder)
    except ValueError:
        return str(folder)


def _is_file(path: Path) -> bool:
    """Tell whether there is such a file; a damaged report may have any text as its name."""
    try:
        return path.is_file()
    except (OSError, ValueError):
        return False


def _files_below(folder: Path) -> Iterator[Path]:
    """Yield the files below a folder, but not those of folders whose names begin with a dot."""
    for parent, folders, files in os.walk(folder):
        folders[:] = sorted(name for name in folders if not name.startswith("."))
        yield from (Path(parent) / name for name in files if not name.startswith("."))


def _located(name: str | None, folder: Path) -> Path | None:
    """Return the file that a report in a folder names; None where it is not there (any more)."""
    if not name:
        return None
    return next((path for path in _candidates(name, folder) if _is_file(path)), None)


def _candidates(name: str, folder: Path) -> Iterable[Path]:
    return folder / Path(name).name, folder / name, Path(name)  # a folder may have been moved, or copied


def _batch_root(report: _BatchDocument, folder: Path) -> Path:
    """Return the folder that has the outputs of a batch: that of its report, or the one that it names."""
    below = [_below(output, report.output) for asset in report.assets for output in asset.outputs]
    roots = (folder, Path(report.output), folder / report.output)
    return next((root for root in roots if any(_is_file(root / path) for path in below)), Path(report.output))


def _below(path: str, folder: str) -> Path:
    """Return the path of an output relative to the folder of the batch."""
    return Path(path).relative_to(folder) if Path(path).is_relative_to(folder) else Path(path)
