"""What an asset is made from: its files and what they hold, in one key for what comes of it."""

import hashlib
import json
import os
import time
from dataclasses import asdict, dataclass
from functools import cache
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Self

from aoprecalc import __version__
from aoprecalc.files import input_files
from aoprecalc.options import BakeOptions, SphereOptions
from aoprecalc.pipeline.asset import Asset

# Options that change how long a job takes and not what comes of it.
_NO_MATTER = ("threads", "memory_limit", "unwrap_timeout")

_TICK = 2_000_000_000  # nanoseconds: some file systems tell times no finer than this


@dataclass(frozen=True)
class Stamp:
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
class Inputs:
    """The files that an asset is made from, the mesh first: its way from the mesh's folder -> how it was."""

    files: dict[str, Stamp]

    @classmethod
    def of(cls, mesh: Path) -> Self:
        """Look at a mesh and all that it refers to."""
        try:
            data = mesh.read_bytes()
        except OSError:
            return cls({mesh.name: Stamp(-1, None, "")})
        paths = input_files(mesh, data)
        stamps = {_way(path, mesh): Stamp.of(path) for path in paths[1:]}
        return cls({mesh.name: Stamp.of(mesh, data), **stamps})

    def are_now(self, mesh: Path) -> bool:
        """Tell by size and times whether all files are certainly the same."""
        return all(stamp.is_now(mesh.parent / way) for way, stamp in self.files.items())

    def same_as(self, other: "Inputs") -> bool:
        """Tell whether both hold the same."""
        return self.digests() == other.digests()

    def digests(self) -> dict[str, str]:
        """Return what each file holds."""
        return {way: stamp.digest for way, stamp in self.files.items()}


def order_key(asset: Asset, output: Path) -> str:
    """Return a digest of all but the inputs that decides what comes of an asset: its order, its name, the version."""
    return _digest(
        {
            "version": __version__,
            "unwrappers": _unwrappers(),
            "mesh": asset.mesh.name,
            "stem": asset.stem,
            "bake": _that_matter(asset.order.bake),
            "spheres": _that_matter(asset.order.spheres),
            "others": [asset.order.texture, asset.order.mesh, asset.order.verify, asset.order.set],
            # results refer to the mesh, and to what lies beside it, by the way from their own folder
            "way": Path(os.path.relpath(asset.mesh.parent, output / asset.folder)).as_posix(),
        }
    )


def result_key(order: str, inputs: Inputs) -> str:
    """Return the digest of everything but the machine that decides what comes of an asset."""
    return _digest({"order": order, "inputs": inputs.digests()})


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
