"""From what a user names to the assets of a batch and the folder that they go to."""

import os
from collections.abc import Callable, Sequence
from functools import cache
from pathlib import Path

from aoprecalc.errors import UsageError
from aoprecalc.options import BakeOptions
from aoprecalc.pipeline.assets import Asset, base_folder, find_meshes, name_assets
from aoprecalc.pipeline.manifest import read_manifest
from aoprecalc.pipeline.orders import Order
from aoprecalc.pipeline.records import HOME, Records


def plan(
    patterns: Sequence[str], output: str | os.PathLike[str] | None, order: Order | None
) -> tuple[list[Asset], Path]:
    """Return the assets of patterns, or of a single manifest, with distinct names, and the output folder.

    order   what is made of each; None: a bake with its defaults, or what the manifest says
    What a batch has made, or what lies in the output folder, is no asset, unless the assets are there themselves.
    Raises InputError, UsageError.
    """
    manifests = [pattern for pattern in patterns if pattern.lower().endswith(".toml")]
    if manifests:
        if len(patterns) > 1:
            raise UsageError(f"{manifests[0]} is a manifest, but other inputs were given as well; put them into it")
        if order is not None:
            raise UsageError(
                f"{manifests[0]} is a manifest and says itself what is made; put --bake, --spheres into it"
            )
        manifest = read_manifest(Path(manifests[0]))
        if output is None and manifest.output is None:
            raise UsageError(f'{manifests[0]} names no output folder; add output = "build", or give -o')
        folder = Path(output or manifest.output or "")
        patterns, root = manifest.patterns, manifest.path.parent
        return manifest.assets_of(_made(folder, base_folder(patterns, root))), folder
    if output is None:
        raise UsageError("no output folder was given; name one with -o")
    base = base_folder(patterns)
    meshes = find_meshes(patterns, _made(Path(output), base))
    order = order or Order(bake=BakeOptions())
    return [Asset(name, mesh, order) for name, mesh in zip(name_assets(meshes, base), meshes, strict=True)], Path(
        output
    )


def _made(output: Path, base: Path) -> Callable[[Path], bool]:
    """Return what tells whether a file was made by a batch."""
    home, top, outputs = Path(os.path.realpath(output)), Path(os.path.realpath(base)), Records(output).outputs()
    apart = not top.is_relative_to(home)

    @cache
    def is_output(folder: Path) -> bool:
        """Tell whether a folder below the base is one for outputs, of any batch."""
        if folder == top or not folder.is_relative_to(top):
            return False
        return (apart and folder == home) or (folder / HOME).is_dir() or is_output(folder.parent)

    def made(path: Path) -> bool:
        real = Path(os.path.realpath(path))
        return real in outputs or is_output(real.parent)

    return made
