"""What decides an asset's results, and the records of how they were made: nothing is made twice without need.

`spec_key` and `InputFiles` together give the key of a result: options, version and the bytes of every file that the
mesh refers to. `<output>/.aoprecalc` (StateFolder) holds a record for each asset, files that are being written, and a
lock. It may be deleted: then every asset is made again, or taken from the cache.
"""

import hashlib
import json
import os
import shutil
import time
from collections import Counter
from collections.abc import Iterable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import asdict, dataclass
from functools import cache
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path
from stat import S_ISREG
from typing import Any, Self

from aoprecalc import __version__
from aoprecalc.errors import OutputError
from aoprecalc.io import input_files
from aoprecalc.io.outputs import SCHEMAS
from aoprecalc.options import BakeOptions, SphereOptions
from aoprecalc.pipeline.jobs import Asset
from aoprecalc.system import lock_file, path_from

STATE_FOLDER = ".aoprecalc"

_RECORD_SUFFIX = ".asset.json"  # unlike the names of folders with assets in them
_RESULT_NEUTRAL = ("threads", "memory_limit", "unwrap_timeout")  # options that change a job's duration only
_TIMESTAMP_RESOLUTION = 2_000_000_000  # nanoseconds; no file system is coarser


@dataclass(frozen=True)
class FileStamp:
    """The state of a file at one moment.

    size     in bytes; -1: there was no file
    times    modification and status-change time in nanoseconds; None: too recent to be trusted
    digest   SHA-256 of the contents, hexadecimal; empty if there was no file
    """

    size: int
    times: tuple[int, int] | None
    digest: str

    @classmethod
    def of(cls, path: Path, data: bytes | None = None, *, is_final: bool = False) -> Self:
        """Stamp a file.

        data       its contents, if they have been read already
        is_final   nobody else writes it at this moment, so that recent times can be trusted
        """
        try:
            stat = path.stat()
            if not S_ISREG(stat.st_mode):  # a device may have no end
                return cls(-1, None, "")
            data = path.read_bytes() if data is None else data
        except OSError:
            return cls(-1, None, "")
        # A change within the resolution of the clock may leave size and times as they are.
        is_old = max(_times(stat)) < time.time_ns() - _TIMESTAMP_RESOLUTION
        return cls(len(data), _times(stat) if is_final or is_old else None, hashlib.sha256(data).hexdigest())

    def matches(self, path: Path) -> bool:
        """Tell by size and times, without reading it, whether a file is certainly unchanged."""
        try:
            stat = path.stat()
        except OSError:
            return self.size == -1
        return (stat.st_size, _times(stat)) == (self.size, self.times)


def file_digest(path: Path) -> str:
    """Return the SHA-256 of a file's contents, in hexadecimal."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


@dataclass(frozen=True)
class InputFiles:
    """The files that an asset is made from, the mesh first: path from the mesh's folder -> stamp."""

    files: dict[str, FileStamp]

    @classmethod
    def of(cls, mesh: Path, others: Iterable[Path] = ()) -> Self:
        """Stamp a mesh, the files that the options name, and all files that these refer to."""
        stamps: dict[str, FileStamp] = {}
        for path in (mesh, *others):
            try:
                data = path.read_bytes()
            except OSError:
                stamps[_relative(path, mesh)] = FileStamp(-1, None, "")
                continue
            stamps[_relative(path, mesh)] = FileStamp.of(path, data)
            stamps |= {_relative(file, mesh): FileStamp.of(file) for file in input_files(path, data)[1:]}
        return cls(stamps)

    def match(self, mesh: Path) -> bool:
        """Tell by sizes and times whether all files are certainly unchanged."""
        return all(stamp.matches(mesh.parent / path) for path, stamp in self.files.items())

    def same_contents(self, other: "InputFiles") -> bool:
        """Tell whether both are the same files with the same contents."""
        return self.digests() == other.digests()

    def digests(self) -> dict[str, str]:
        """Return the digest of each file."""
        return {path: stamp.digest for path, stamp in self.files.items()}


def spec_key(asset: Asset, output: Path) -> str:
    """Return a digest of everything but the input files that decides an asset's results."""
    spec = asset.spec.with_files(lambda path: _relative(Path(path), asset.mesh))
    return _digest(
        {
            "version": __version__,
            "unwrappers": _unwrappers(),
            "mesh": asset.mesh.name,
            "stem": asset.stem,
            "bake": _relevant_options(spec.bake),
            "spheres": _relevant_options(spec.spheres),
            "others": [
                spec.bake_output,
                spec.verify,
                spec.spheres_output,
                spec.bent_normals,
                spec.sh,
            ],
            # results refer to the mesh and to files beside it by paths relative to their own folder
            "way": path_from(asset.mesh.parent, output / asset.folder),
        }
    )


def result_key(key: str, inputs: InputFiles) -> str:
    """Return a digest of a spec key and the input files: of everything but the machine that decides the results."""
    return _digest({"order": key, "inputs": inputs.digests()})


def _relevant_options(options: BakeOptions | SphereOptions | None) -> dict[str, Any] | None:
    if options is None:
        return None
    return {name: value for name, value in asdict(options).items() if name not in _RESULT_NEUTRAL}


def _digest(value: Any) -> str:
    return hashlib.sha256(json.dumps(value, sort_keys=True, ensure_ascii=True).encode()).hexdigest()


def _times(stat: os.stat_result) -> tuple[int, int]:
    # Both, as some tools give all files one modification time.
    return stat.st_mtime_ns, stat.st_ctime_ns


@cache
def _unwrappers() -> list[str]:
    """Return the versions of the installed unwrappers: installing one changes what `--unwrap auto` chooses."""
    return [f"{name} {version(name)}" for name in ("xatlas", "uvunwrap") if find_spec(name) is not None]


def _relative(path: Path, mesh: Path) -> str:
    return path_from(path, mesh.parent)


@dataclass(frozen=True)
class AssetRecord:
    """How an asset was made.

    spec_key   see the function of that name
    inputs     the files that it was made from
    outputs    its files: name in the asset's folder -> stamp when it was written
    summary    of the results, for tables and reports
    """

    spec_key: str
    inputs: InputFiles
    outputs: dict[str, FileStamp]
    summary: dict[str, Any]


class StateFolder:
    """The records of an output folder."""

    def __init__(self, output: Path) -> None:
        """Name the output folder, which need not exist."""
        self._output = output
        self._folder = output / STATE_FOLDER
        self._assets = self._folder / "assets"
        self.staging = self._folder / "staging"
        self._owner_counts: Counter[Path] | None = None  # file -> number of assets that it belongs to; None: unknown

    @contextmanager
    def locked(self) -> Iterator[None]:
        """Create the folder, keep other batches out during a `with` block, and remove what a killed one left.

        Raises OutputError if that is not possible.
        """
        with ExitStack() as stack:
            try:
                self._folder.mkdir(parents=True, exist_ok=True)
                stack.enter_context(_file_lock(self._folder / "lock"))
                shutil.rmtree(self.staging, ignore_errors=True)
                self.staging.mkdir()
            except BlockingIOError as error:
                reason = f"{self._output}: another batch writes there"
                raise OutputError(f"{reason}; wait for it, or choose another -o") from error
            except OSError as error:
                reason = error.strerror or str(error)
                raise OutputError(f"{self._output}: cannot be written ({reason}); choose another output") from error
            stack.callback(shutil.rmtree, self.staging, ignore_errors=True)
            yield

    def get(self, name: str) -> AssetRecord | None:
        """Return the record of an asset; None if there is none that can be read."""
        return _read(self._file(name))

    def put(self, name: str, record: AssetRecord) -> None:
        """Write the record of an asset."""
        self._count_outputs(name, self.get(name), -1)
        self._count_outputs(name, record, 1)
        file = self._file(name)
        file.parent.mkdir(parents=True, exist_ok=True)
        temporary = self.staging / f"record-{os.getpid()}"
        document = {
            "schema": SCHEMAS["batch record"],
            "order": record.spec_key,
            "inputs": asdict(record.inputs),
            "outputs": {output: asdict(stamp) for output, stamp in record.outputs.items()},
            "summary": record.summary,
        }
        temporary.write_text(json.dumps(document), encoding="utf-8")
        os.replace(temporary, file)

    def names(self) -> list[str]:
        """Return the names of all recorded assets, sorted."""
        files = self._assets.rglob(f"*{_RECORD_SUFFIX}")
        return sorted(file.relative_to(self._assets).as_posix().removesuffix(_RECORD_SUFFIX) for file in files)

    def drop(self, name: str) -> None:
        """Remove the record of an asset."""
        self._count_outputs(name, self.get(name), -1)
        self._file(name).unlink(missing_ok=True)

    def asset_folder(self, name: str) -> Path:
        """Return the folder that an asset's files are in."""
        return (self._output / name).parent

    def outputs(self) -> set[Path]:
        """Return the files of all recorded assets, with links resolved."""
        return {Path(os.path.realpath(file)) for file in self._recorded_outputs()}

    def is_output(self, file: Path) -> bool:
        """Tell whether a file, given as `asset_folder(name) / file name`, belongs to a recorded asset."""
        if self._owner_counts is None:
            self._owner_counts = self._recorded_outputs()
        return self._owner_counts[file] > 0

    def _recorded_outputs(self) -> Counter[Path]:
        counts: Counter[Path] = Counter()
        for name in self.names():
            if record := self.get(name):
                counts.update(self.asset_folder(name) / output for output in record.outputs)
        return counts

    def _count_outputs(self, name: str, record: AssetRecord | None, change: int) -> None:
        if self._owner_counts is not None and record is not None:
            for output in record.outputs:
                self._owner_counts[self.asset_folder(name) / output] += change

    def _file(self, name: str) -> Path:
        return self._assets / f"{name}{_RECORD_SUFFIX}"


def _read(file: Path) -> AssetRecord | None:
    try:
        document = json.loads(file.read_bytes())
        if document["schema"] != SCHEMAS["batch record"]:
            return None
        inputs, outputs = InputFiles(_read_stamps(document["inputs"]["files"])), _read_stamps(document["outputs"])
        if any(
            name != Path(name).name or name in ("", "..") for name in outputs
        ):  # these may be removed, so none may be elsewhere
            return None
        return AssetRecord(document["order"], inputs, outputs, document["summary"])
    except (OSError, ValueError, KeyError, TypeError, AttributeError):  # missing, damaged, or of another version
        return None


def _read_stamps(table: dict[str, Any]) -> dict[str, FileStamp]:
    return {
        path: FileStamp(
            stamp["size"], stamp["times"] and (int(stamp["times"][0]), int(stamp["times"][1])), stamp["digest"]
        )
        for path, stamp in table.items()
    }


@contextmanager
def _file_lock(file: Path) -> Iterator[None]:
    """Hold a lock that ends with this process; raises BlockingIOError if another process holds it."""
    with file.open("w") as handle:
        lock_file(handle)
        yield
