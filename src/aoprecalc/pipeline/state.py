"""What an asset is made from: its files and what they hold, in one key for what comes of it."""

import hashlib
import json
import os
import shutil
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import asdict, dataclass
from functools import cache
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Self

from aoprecalc import __version__
from aoprecalc.errors import OutputError
from aoprecalc.io import input_files
from aoprecalc.io.outputs import SCHEMAS
from aoprecalc.options import BakeOptions, SphereOptions
from aoprecalc.pipeline.jobs import Asset

# Options that change how long a job takes and not what comes of it.
_NO_MATTER = ("threads", "memory_limit", "unwrap_timeout")

_TICK = 2_000_000_000  # nanoseconds: some file systems tell times no finer than this


@dataclass(frozen=True)
class FileStamp:
    """A file as it was looked at.

    size    in bytes; -1: there was none
    times   of the last change of what it holds and of the file itself, in nanoseconds; None: too recent to be trusted
    digest  SHA-256 of what it holds, in hexadecimal; empty where there was no file
    """

    size: int
    times: tuple[int, int] | None
    digest: str

    @classmethod
    def of(cls, path: Path, data: bytes | None = None, *, certain: bool = False) -> Self:
        """Look at a file, whose bytes may be known already; `certain`: nobody changes it at this moment."""
        try:
            found = path.stat()
            data = path.read_bytes() if data is None else data
        except OSError:
            return cls(-1, None, "")
        # What changes within a tick of being looked at might have the same size and times afterwards.
        trusted = certain or max(_times(found)) < time.time_ns() - _TICK
        return cls(len(data), _times(found) if trusted else None, hashlib.sha256(data).hexdigest())

    def is_now(self, path: Path) -> bool:
        """Tell by size and times whether a file is certainly the same."""
        try:
            found = path.stat()
        except OSError:
            return self.size == -1
        return (found.st_size, _times(found)) == (self.size, self.times)


def file_digest(path: Path) -> str:
    """Return the SHA-256 of what a file holds, in hexadecimal."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


@dataclass(frozen=True)
class InputFiles:
    """The files that an asset is made from, the mesh first: its way from the mesh's folder -> how it was."""

    files: dict[str, FileStamp]

    @classmethod
    def of(cls, mesh: Path) -> Self:
        """Look at a mesh and all that it refers to."""
        try:
            data = mesh.read_bytes()
        except OSError:
            return cls({mesh.name: FileStamp(-1, None, "")})
        paths = input_files(mesh, data)
        stamps = {_way(path, mesh): FileStamp.of(path) for path in paths[1:]}
        return cls({mesh.name: FileStamp.of(mesh, data), **stamps})

    def are_now(self, mesh: Path) -> bool:
        """Tell by size and times whether all files are certainly the same."""
        return all(stamp.is_now(mesh.parent / way) for way, stamp in self.files.items())

    def same_as(self, other: "InputFiles") -> bool:
        """Tell whether both hold the same."""
        return self.digests() == other.digests()

    def digests(self) -> dict[str, str]:
        """Return what each file holds."""
        return {way: stamp.digest for way, stamp in self.files.items()}


def spec_key(asset: Asset, output: Path) -> str:
    """Return a digest of all but the inputs that decides what comes of an asset: its order, its name, the version."""
    return _digest(
        {
            "version": __version__,
            "unwrappers": _unwrappers(),
            "mesh": asset.mesh.name,
            "stem": asset.stem,
            "bake": _that_matter(asset.spec.bake),
            "spheres": _that_matter(asset.spec.spheres),
            "others": [asset.spec.texture_suffix, asset.spec.mesh_suffix, asset.spec.verify, asset.spec.spheres_suffix],
            # results refer to the mesh, and to what lies beside it, by the way from their own folder
            "way": Path(os.path.relpath(asset.mesh.parent, output / asset.folder)).as_posix(),
        }
    )


def result_key(key: str, inputs: InputFiles) -> str:
    """Return the digest of everything but the machine that decides what comes of an asset."""
    return _digest({"order": key, "inputs": inputs.digests()})


def _that_matter(options: BakeOptions | SphereOptions | None) -> dict[str, Any] | None:
    if options is None:
        return None
    return {name: value for name, value in asdict(options).items() if name not in _NO_MATTER}


def _digest(value: Any) -> str:
    return hashlib.sha256(json.dumps(value, sort_keys=True, ensure_ascii=True).encode()).hexdigest()


def _times(found: os.stat_result) -> tuple[int, int]:
    # The second tells apart what the first does not: some tools set it to one time for all files.
    return found.st_mtime_ns, found.st_ctime_ns


@cache
def _unwrappers() -> list[str]:
    """Return the versions of what makes UVs; one that comes or goes changes what `--unwrap auto` chooses."""
    return [f"{name} {version(name)}" for name in ("xatlas", "uvunwrap") if find_spec(name) is not None]


def _way(path: Path, mesh: Path) -> str:
    return Path(os.path.relpath(path, mesh.parent)).as_posix()


# What a batch remembers in its output folder: how each asset was made, so that it need not be made again.
#
# `<output>/.aoprecalc` holds a record for each asset, what is being written (`staging`), and a lock. It may be deleted:
# then everything is made again, or taken from the cache.

STATE_FOLDER = ".aoprecalc"

_SUFFIX = ".asset.json"  # as no folder is called that assets lie in


@dataclass(frozen=True)
class AssetRecord:
    """How an asset was made.

    order     the key of its order
    inputs    what it was made from
    outputs   its files: name in the asset's folder -> how it was written
    summary   of what was made, for tables and reports
    """

    spec_key: str
    inputs: InputFiles
    outputs: dict[str, FileStamp]
    summary: dict[str, Any]


class StateFolder:
    """The records of an output folder."""

    def __init__(self, output: Path) -> None:
        """Look into a folder, which need not exist."""
        self._output = output
        self._home = output / STATE_FOLDER
        self._assets = self._home / "assets"
        self.staging = self._home / "staging"
        self._holders: Counter[Path] | None = None  # a file -> how many assets have it; None: nobody has asked

    @contextmanager
    def held(self) -> Iterator[None]:
        """Make the folder and keep it from other batches for a `with` block; what a killed one left is removed.

        Raises OutputError where that is not possible.
        """
        with ExitStack() as stack:
            try:
                self._home.mkdir(parents=True, exist_ok=True)
                stack.enter_context(_locked(self._home / "lock"))
                shutil.rmtree(self.staging, ignore_errors=True)
                self.staging.mkdir()
            except BlockingIOError as error:
                found = f"{self._output}: another batch writes there"
                raise OutputError(f"{found}; wait for it, or choose another -o") from error
            except OSError as error:
                reason = error.strerror or str(error)
                raise OutputError(f"{self._output}: cannot be written ({reason}); choose another output") from error
            stack.callback(shutil.rmtree, self.staging, ignore_errors=True)
            yield

    def get(self, name: str) -> AssetRecord | None:
        """Return the record of an asset; None where there is none that can be understood."""
        return _read(self._file(name))

    def put(self, name: str, record: AssetRecord) -> None:
        """Write the record of an asset."""
        self._count(name, self.get(name), -1)
        self._count(name, record, 1)
        file = self._file(name)
        file.parent.mkdir(parents=True, exist_ok=True)
        written = self.staging / f"record-{os.getpid()}"
        document = {
            "schema": SCHEMAS["batch record"],
            "order": record.spec_key,
            "inputs": asdict(record.inputs),
            "outputs": {file: asdict(stamp) for file, stamp in record.outputs.items()},
            "summary": record.summary,
        }
        written.write_text(json.dumps(document), encoding="utf-8")
        os.replace(written, file)

    def names(self) -> list[str]:
        """Return the names of all recorded assets, sorted."""
        files = self._assets.rglob(f"*{_SUFFIX}")
        return sorted(file.relative_to(self._assets).as_posix().removesuffix(_SUFFIX) for file in files)

    def drop(self, name: str) -> None:
        """Forget an asset."""
        self._count(name, self.get(name), -1)
        self._file(name).unlink(missing_ok=True)

    def folder(self, name: str) -> Path:
        """Return the folder that an asset's files lie in."""
        return (self._output / name).parent

    def outputs(self) -> set[Path]:
        """Return the files that recorded assets have, with links followed."""
        return {Path(os.path.realpath(file)) for file in self._held()}

    def has(self, file: Path) -> bool:
        """Tell whether a file, named by its asset's folder, is one that a recorded asset has."""
        if self._holders is None:
            self._holders = self._held()
        return self._holders[file] > 0

    def _held(self) -> Counter[Path]:
        found: Counter[Path] = Counter()
        for name in self.names():
            if record := self.get(name):
                found.update(self.folder(name) / output for output in record.outputs)
        return found

    def _count(self, name: str, record: AssetRecord | None, by: int) -> None:
        """Keep the number of holders, where it is known."""
        if self._holders is not None and record is not None:
            for output in record.outputs:
                self._holders[self.folder(name) / output] += by

    def _file(self, name: str) -> Path:
        return self._assets / f"{name}{_SUFFIX}"


def _read(file: Path) -> AssetRecord | None:
    try:
        document = json.loads(file.read_bytes())
        if document["schema"] != SCHEMAS["batch record"]:
            return None
        inputs = InputFiles(_stamps(document["inputs"]["files"]))
        return AssetRecord(document["order"], inputs, _stamps(document["outputs"]), document["summary"])
    except (OSError, ValueError, KeyError, TypeError, AttributeError):  # missing, damaged, or of another version
        return None


def _stamps(table: dict[str, Any]) -> dict[str, FileStamp]:
    return {
        way: FileStamp(
            stamp["size"], stamp["times"] and (int(stamp["times"][0]), int(stamp["times"][1])), stamp["digest"]
        )
        for way, stamp in table.items()
    }


@contextmanager
def _locked(file: Path) -> Iterator[None]:
    """Hold a lock that ends with this process, however that ends; raises BlockingIOError where another holds it."""
    try:
        import fcntl
    except ModuleNotFoundError:  # Windows
        yield
        return
    with file.open("w") as held:
        fcntl.flock(held, fcntl.LOCK_EX | fcntl.LOCK_NB)
        yield
