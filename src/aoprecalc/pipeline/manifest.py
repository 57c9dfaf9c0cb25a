"""Manifests: a batch described in TOML."""

import os
import tomllib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any

from aoprecalc.errors import AoprecalcError, InputError, UsageError
from aoprecalc.pipeline.discovery import base_folder, check_distinct, find_meshes, is_pattern, name_assets
from aoprecalc.pipeline.jobs import Asset, JobSpec
from aoprecalc.pipeline.option_tables import COUNTS, Table, plain_keys, read_job_spec
from aoprecalc.pipeline.state import STATE_FOLDER

_TOP = ("inputs", "exclude", "output", "bake", "spheres", "override", "asset")
_OVERRIDE, _ASSET = ("match", "bake", "spheres"), ("mesh", "name", "bake", "spheres")

Choice = Table | bool | None  # a table; true: with the defaults; false: none of it; None: as said before
Single = tuple[str, str | None, Choice, Choice]  # mesh, name, bake, spheres of an asset


@dataclass(frozen=True)
class Manifest:
    """What a manifest says; see the README for its keys.

    path      of the file; all others count from its folder
    inputs    patterns of meshes
    exclude   patterns of those to leave out
    output    the output folder, unless another is asked for; None: not said
    bake, spheres   the choices for all assets
    overrides  (pattern, bake, spheres), of which later ones win
    assets     (mesh, name or None, bake, spheres) for single ones
    """

    path: Path
    inputs: tuple[str, ...]
    exclude: tuple[str, ...]
    output: Path | None
    bake: Choice
    spheres: Choice
    overrides: tuple[tuple[str, Choice, Choice], ...]
    assets: tuple[Single, ...]

    @property
    def base(self) -> Path:
        """The folder from which names count: that of the inputs, whatever single assets lie elsewhere."""
        return base_folder(self.inputs or [entry[0] for entry in self.assets], self.path.parent)

    def assets_of(self, made: Callable[[Path], bool]) -> list[Asset]:
        """Find its meshes, but for those that a batch has made, and say what is made of each.

        Raises InputError for a pattern that fits nothing, UsageError where it asks for what cannot be.
        """
        root = self.path.parent
        single = self._single()
        found = find_meshes(self.inputs, made, root) if self.inputs else []
        meshes = [
            mesh for mesh in found if not self._excluded(mesh) and os.path.abspath(mesh) not in single
        ] + find_meshes([entry[0] for entry in self.assets], made, root)
        if not meshes:
            raise InputError(f"{self.path}: leaves out all meshes that it names; correct exclude")
        names = [
            single.get(os.path.abspath(mesh), ("", None))[1] or name
            for mesh, name in zip(meshes, name_assets(meshes, self.base), strict=True)
        ]
        check_distinct(names, meshes)
        return [Asset(name, mesh, self._spec(mesh, single)) for name, mesh in zip(names, meshes, strict=True)]

    def idle(self, assets: Sequence[Asset]) -> tuple[str, ...]:
        """Return a line for each override that fits none of its assets: a slip, or left from meshes that are gone."""
        unused = [entry[0] for entry in self.overrides if not any(self._fits(asset.mesh, entry[0]) for asset in assets)]
        return tuple(f"{self.path}: the [[override]] of {pattern!r} fits none of its meshes" for pattern in unused)

    def _single(self) -> dict[str, Single]:
        """Return the single assets by the paths of their meshes; raises UsageError where these are not single."""
        single: dict[str, Single] = {}
        for entry in self.assets:
            path = os.path.abspath(self.path.parent / entry[0])
            if os.path.isdir(path) or is_pattern(entry[0], self.path.parent):
                found = f"{self.path}: an [[asset]] has the mesh {entry[0]!r}, one file was expected"
                raise UsageError(f"{found}; name folders and patterns in inputs, with an [[override]]")
            if path in single:
                raise UsageError(f"{self.path}: {entry[0]!r} is the mesh of two [[asset]]; omit one of them")
            single[path] = entry
        return single

    def _excluded(self, mesh: Path) -> bool:
        return any(self._fits(mesh, pattern) for pattern in self.exclude)

    def _fits(self, mesh: Path, pattern: str) -> bool:
        """Tell whether a mesh's way from the manifest fits a pattern, in which * stands for folders, too."""
        return fnmatchcase(Path(os.path.relpath(mesh, self.path.parent)).as_posix(), pattern)

    def _spec(self, mesh: Path, single: dict[str, Single]) -> JobSpec:
        bake, spheres = self.bake, self.spheres
        fitting = [entry[1:] for entry in self.overrides if self._fits(mesh, entry[0])]
        if own := single.get(os.path.abspath(mesh)):
            fitting.append(own[2:])
        try:
            for over_bake, over_spheres in fitting:
                bake, spheres = _over(bake, over_bake, self.bake), _over(spheres, over_spheres, self.spheres)
            return read_job_spec(_table(bake), _table(spheres))
        except UsageError as error:
            raise UsageError(f"{self.path}, for {mesh}: {error}") from error


def read_manifest(path: Path) -> Manifest:
    """Read a manifest; raises InputError where it is missing or no TOML, UsageError where it says what it cannot."""
    try:
        document = tomllib.loads(path.read_text(encoding="utf-8-sig"))
    except OSError as error:
        raise InputError(
            f"{path}: cannot be read ({error.strerror}), a manifest was expected; check the path"
        ) from error
    except ValueError as error:
        raise InputError(f"{path}: is no TOML ({error}); correct it") from error
    try:
        _known(document, _TOP, "at the top")
        for entry in _tables(document, "override"):
            _known(entry, _OVERRIDE, "in [[override]]")
        for entry in _tables(document, "asset"):
            _known(entry, _ASSET, "in [[asset]]")
        manifest = Manifest(
            path=path,
            inputs=_texts(document, "inputs"),
            exclude=_texts(document, "exclude"),
            output=path.parent / output if (output := _text(document, "output", None)) else None,
            bake=_choice(document, "bake"),
            spheres=_choice(document, "spheres"),
            overrides=tuple(
                (_text(entry, "match"), _choice(entry, "bake"), _choice(entry, "spheres"))
                for entry in _tables(document, "override")
            ),
            assets=tuple(
                (_text(entry, "mesh"), _name(entry), _choice(entry, "bake"), _choice(entry, "spheres"))
                for entry in _tables(document, "asset")
            ),
        )
        if manifest.bake is None and manifest.spheres is None and not (manifest.overrides or manifest.assets):
            raise UsageError("says nothing about bake or spheres; give it a table [bake], [spheres] or both")
        if not [*manifest.inputs, *manifest.assets]:
            raise InputError("names no meshes; give it inputs, or an [[asset]]")
    except AoprecalcError as error:
        raise type(error)(f"{path}: {error}") from error
    return manifest


def _over(before: Choice, choice: Choice, default: Choice) -> Choice:
    """Return a choice after another: a table adds to what was said, or to the default where that was switched off."""
    if choice is None:
        return before
    if isinstance(choice, bool):
        return choice and (before or default or True)
    kept, new = plain_keys(_table(before or default) or {}), plain_keys(choice)
    replaced = COUNTS if COUNTS & new.keys() else frozenset[str]()
    return {key: value for key, value in kept.items() if key not in replaced} | new


def _table(choice: Choice) -> Table | None:
    """Return the table that a choice stands for; None for none of it."""
    if isinstance(choice, bool | None):
        return {} if choice else None
    return choice


def _known(table: Table, known: tuple[str, ...], where: str) -> None:
    for key in table:
        if key not in known:
            raise UsageError(f"{key!r} {where} is not known, one of {', '.join(known)} was expected")


def _tables(document: Table, key: str) -> list[dict[str, Any]]:
    value = document.get(key, [])
    if not isinstance(value, list) or not all(isinstance(entry, dict) for entry in value):
        raise UsageError(f"{key} is no list of tables; write [[{key}]] above each")
    return value


def _texts(document: Table, key: str) -> tuple[str, ...]:
    value = document.get(key, [])
    entries = [value] if isinstance(value, str) else value
    if not isinstance(entries, list) or not all(isinstance(entry, str) for entry in entries):
        raise UsageError(f"{key} is {value!r}; expected a list of patterns")
    return tuple(entries)


def _text(table: Table, key: str, default: Any = ...) -> Any:
    value = table.get(key, default)
    if value is ...:
        raise UsageError(f"{key} is missing in {dict(table)!r}")
    if value is not default and not isinstance(value, str):
        raise UsageError(f"{key} is {value!r}; expected a text in quotes")
    return value


def _name(table: Table) -> str | None:
    name: str | None = _text(table, "name", None)
    if name is not None and not _is_name(name):
        raise UsageError(f"name is {name!r}; expected one below the output folder, such as props/rock")
    return name


def _is_name(text: str) -> bool:
    """Tell whether a text is the way to a file below a folder, in its plainest form."""
    parts = text.split("/")
    plain = all(part.strip(". ") for part in parts) and parts[0] != STATE_FOLDER
    return plain and not any(char < " " for char in text)


def _choice(table: Table, key: str) -> Choice:
    value: Choice = table.get(key)
    if value is not None and not isinstance(value, bool | dict):
        raise UsageError(f"{key} is {value!r}; expected a table of its options, true or false")
    return value
