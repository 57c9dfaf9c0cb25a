"""From what a user names to the assets of a batch and the folder that they go to."""

import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from aoprecalc.errors import UsageError
from aoprecalc.options import BakeOptions
from aoprecalc.pipeline.cache import CACHE_TAG
from aoprecalc.pipeline.discovery import base_folder, find_meshes, name_assets
from aoprecalc.pipeline.jobs import Asset, JobSpec
from aoprecalc.pipeline.manifest import read_manifest
from aoprecalc.pipeline.state import STATE_FOLDER, StateFolder

_ENDS = ("report.json", "spheres.json")  # of names of what is made


@dataclass(frozen=True)
class Plan:
    """What a batch is to do.

    assets     with distinct names
    output     the folder for the results
    warnings   what the user should know about it
    manifest   the file that says so; None: none
    """

    assets: tuple[Asset, ...]
    output: Path
    warnings: tuple[str, ...] = ()
    manifest: Path | None = None

    def files(self) -> list[Path]:
        """Return the files that nothing else may replace: meshes, the manifest, and what is made under known names."""
        made = [self.output / f"{asset.name}_{end}" for asset in self.assets for end in _ENDS]
        return [*made, *(asset.mesh for asset in self.assets), *([self.manifest] if self.manifest else [])]


def plan_batch(patterns: Sequence[str], output: str | os.PathLike[str] | None, spec: JobSpec | None) -> Plan:
    """Plan a batch over what patterns fit, or over what a single manifest says.

    spec    what is made of each; None: a bake with its defaults, or what the manifest says
    What a batch has made, or what lies in the output folder, is no asset, unless the assets are there themselves.
    Raises InputError, UsageError.
    """
    manifests = [pattern for pattern in patterns if pattern.lower().endswith(".toml")]
    if not manifests:
        if output is None:
            raise UsageError("no output folder was given; name one with -o")
        base = base_folder(patterns)
        meshes = find_meshes(patterns, _made_by_batches(Path(output), base))
        named = zip(name_assets(meshes, base), meshes, strict=True)
        return Plan(tuple(Asset(name, mesh, spec or JobSpec(BakeOptions())) for name, mesh in named), Path(output))
    if len(patterns) > 1:
        raise UsageError(f"{manifests[0]} is a manifest, but other inputs were given as well; put them into it")
    if spec is not None:
        raise UsageError(f"{manifests[0]} is a manifest and says itself what is made; put --bake, --spheres into it")
    manifest = read_manifest(Path(manifests[0]))
    folder = output or manifest.output
    if folder is None:
        raise UsageError(f'{manifests[0]} names no output folder; add output = "build", or give -o')
    assets = manifest.assets_of(_made_by_batches(Path(folder), manifest.base))
    return Plan(tuple(assets), Path(folder), manifest.idle(assets), manifest.path)


def _made_by_batches(output: Path, base: Path) -> Callable[[Path], bool]:
    """Return what tells whether a file was made by a batch, this one or another."""
    home = Path(os.path.realpath(output))
    apart = not Path(os.path.realpath(base)).is_relative_to(home)

    @cache
    def is_cache(folder: Path) -> bool:
        """Tell whether a folder is one of a cache, or below it."""
        return (folder / CACHE_TAG).exists() or (folder != folder.parent and is_cache(folder.parent))

    @cache
    def outputs(folder: Path) -> frozenset[Path]:
        """Return what batches have made into a folder, and into those above it."""
        above = outputs(folder.parent) if folder != folder.parent else frozenset()
        return above | StateFolder(folder).outputs() if (folder / STATE_FOLDER).is_dir() else above

    def made(path: Path) -> bool:
        real = Path(os.path.realpath(path))
        return real in outputs(real.parent) or is_cache(real.parent) or (apart and real.is_relative_to(home))

    return made
