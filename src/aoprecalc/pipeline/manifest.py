"""Manifests: a batch described in TOML. The structs below are the format; msgspec validates a file against them."""

import os
import tomllib
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import cache as memoize
from functools import cached_property
from itertools import takewhile
from pathlib import Path
from typing import Annotated

from msgspec import Meta

from aoprecalc.errors import AoprecalcError, ArgumentError, InputError, UsageError
from aoprecalc.options.fields import named_files
from aoprecalc.pipeline.discovery import (
    base_folder,
    check_distinct,
    find_meshes,
    is_pattern,
    name_assets,
    neighbours,
    path_matches,
    suggest,
    with_folders,
)
from aoprecalc.pipeline.jobs import Asset, JobSpec
from aoprecalc.pipeline.option_tables import COUNTS, Choice, Tables, arguments_of, convert, key_name, make_job_spec
from aoprecalc.pipeline.state import STATE_FOLDER
from aoprecalc.system import may_name_a_file, path_from

_Text = Annotated[str, Meta(description="a text in quotes")]
_Patterns = Annotated[tuple[str, ...] | str, Meta(description="a list of patterns")]


class Override(Tables, forbid_unknown_fields=True, kw_only=True):
    """`[[override]]`: options of the meshes that match a pattern, by path or, without a slash, by name."""

    match: _Text


class SingleAsset(Tables, forbid_unknown_fields=True, kw_only=True):
    """`[[asset]]`: one mesh, its name below the output folder (None: as usual), and options."""

    mesh: _Text
    name: _Text | None = None


_Overrides = Annotated[tuple[Override, ...], Meta(description="a list of tables; write [[override]] above each")]
_SingleAssets = Annotated[tuple[SingleAsset, ...], Meta(description="a list of tables; write [[asset]] above each")]


class ManifestFile(Tables, forbid_unknown_fields=True, kw_only=True):
    """The whole file: patterns of meshes, patterns to leave out, the output folder, options of all and of some."""

    inputs: _Patterns = ()
    exclude: _Patterns = ()
    output: _Text | None = None
    override: _Overrides = ()
    asset: _SingleAssets = ()


@dataclass(frozen=True)
class Manifest:
    """A manifest.

    path   of the file; the paths in it are relative to its folder
    file   what it says
    """

    path: Path
    file: ManifestFile

    @property
    def output(self) -> Path | None:
        """The output folder, unless another is asked for; None where the manifest names none."""
        return self.path.parent / self.file.output if self.file.output else None

    @property
    def base(self) -> Path:
        """The folder that assets are named from: that of the inputs, else that of the single assets."""
        return base_folder(_listed(self.file.inputs) or [entry.mesh for entry in self.file.asset], self.path.parent)

    def assets_of(self, made: Callable[[Path], bool], note: Callable[[str], None] = lambda _: None) -> list[Asset]:
        """Find the meshes, except for those that a batch has made, and return each with its job spec.

        note   receives a line about each `exclude` that matches nothing
        Raises InputError for inputs that match nothing, UsageError for an override or single asset that does, for
        options that contradict each other, and for files of options that are not there.
        """
        root, inputs = self.path.parent, _listed(self.file.inputs)
        found = find_meshes(inputs, made, root) if inputs else []
        named = [*found, *(Path(path) for path in self._single if os.path.lexists(path))]
        self._refuse_misses(named)
        for miss in self._misses("exclude", _listed(self.file.exclude), named):
            note(f"{self.path}: {miss}")
        single_meshes = find_meshes([entry.mesh for entry in self.file.asset], made, root)
        meshes = [
            mesh
            for mesh in found
            if not self._matches_any(mesh, _listed(self.file.exclude)) and os.path.abspath(mesh) not in self._single
        ]
        meshes += single_meshes
        if not meshes:
            raise InputError(f"{self.path}: leaves out all meshes that it names; correct exclude")
        names = [
            (single.name if (single := self._single.get(os.path.abspath(mesh))) else None) or name
            for mesh, name in zip(meshes, name_assets(meshes, self.base), strict=True)
        ]
        check_distinct(names, meshes)
        specs = [self._spec(mesh) for mesh in meshes]
        self._refuse_missing_files(specs)
        placed = [spec.with_files(self._placed) for spec in specs]
        return [Asset(name, mesh, spec) for name, mesh, spec in zip(names, meshes, placed, strict=True)]

    def _placed(self, path: str) -> str:
        """Return a path of the manifest, from its folder."""
        return os.path.join(self.path.parent, path)

    def _refuse_missing_files(self, specs: Sequence[JobSpec]) -> None:
        """Raise UsageError where options name files that are not there; it names them all."""
        named = {entry for spec in specs if spec.bake for entry in named_files(spec.bake).items()}
        missed = list[str]()
        for option, path in sorted({(option, path) for option, paths in named for path in paths}):
            if not os.path.isfile(placed := self._placed(path)):
                beside = [path_from(Path(other), self.path.parent) for other in neighbours(placed)]
                missed.append(f"{key_name(option)} = {path!r} is not a file{suggest(path, beside)}")
        if missed:
            advice = "paths are relative to the manifest's folder"
            raise UsageError(f"{self.path}: {'; '.join(missed)}; correct this: {advice}")

    def _misses(self, key: str, patterns: Iterable[str], meshes: Sequence[Path]) -> list[str]:
        """Return a text about each pattern of a key that matches none of the meshes."""
        missed = [pattern for pattern in patterns if not any(self._matches_any(mesh, [pattern]) for mesh in meshes)]
        choices = self._choices(meshes) if missed else []
        return [f"{key} = {pattern!r} matches none of its meshes{suggest(pattern, choices)}" for pattern in missed]

    def _choices(self, meshes: Sequence[Path]) -> list[str]:
        """Return what a pattern could have meant: paths from the manifest's folder, names, all files of a folder."""
        return with_folders(dict.fromkeys(path for mesh in meshes for path in self._paths(mesh)[:1]))

    def _refuse_misses(self, meshes: Sequence[Path]) -> None:
        """Raise UsageError where overrides or single assets name none of the meshes; it names them all."""
        missed = self._misses("[[override]] match", (entry.match for entry in self.file.override), meshes)
        for path, entry in self._single.items():
            if not os.path.lexists(path):
                beside = [path_from(Path(other), self.path.parent) for other in neighbours(path)]
                nearest = suggest(entry.mesh, [*beside, *self._choices(meshes)])
                missed.append(f"[[asset]] mesh = {entry.mesh!r} is not a file{nearest}")
        if missed:
            advice = "patterns are relative to the manifest's folder, and match by name if they have no slash"
            raise UsageError(f"{self.path}: {'; '.join(missed)}; correct this: {advice}")

    @cached_property
    def _single(self) -> dict[str, SingleAsset]:
        """The single assets by the absolute paths of their meshes; raises UsageError where two have the same mesh."""
        single: dict[str, SingleAsset] = {}
        for entry in self.file.asset:
            path = os.path.abspath(self.path.parent / entry.mesh)
            if os.path.isdir(path) or is_pattern(entry.mesh, self.path.parent):
                found = f"{self.path}: an [[asset]] has the mesh {entry.mesh!r}, one file was expected"
                raise UsageError(f"{found}; name folders and patterns in inputs, with an [[override]]")
            if path in single:
                raise UsageError(f"{self.path}: {entry.mesh!r} is the mesh of two [[asset]]; omit one of them")
            single[path] = entry
        return single

    def _matches_any(self, mesh: Path, patterns: Sequence[str]) -> bool:
        """Tell whether a mesh matches a pattern: by its name if the pattern has no slash, else by its path."""
        wanted = [form for pattern in patterns for form in self._forms(pattern)]
        return any(path_matches(path, form) for path in self._paths(mesh) for form in wanted)

    @cached_property
    def _paths(self) -> Callable[[Path], tuple[str, ...]]:
        """Return the paths of a mesh from the manifest's folder: as it was given, and with links resolved."""
        return memoize(lambda mesh: self._both(mesh.parent, mesh.name))

    @cached_property
    def _forms(self) -> Callable[[str], tuple[str, ...]]:
        """Return a pattern as patterns of both kinds of paths; itself where it has no slash."""

        def forms(pattern: str) -> tuple[str, ...]:
            if "/" not in pattern:
                return (pattern,)
            parts = Path(pattern).parts
            plain = list(takewhile(lambda part: not is_pattern(part), parts[:-1]))
            return self._both(self.path.parent.joinpath(*plain), "/".join(parts[len(plain) :]))

        return memoize(forms)

    def _both(self, folder: Path, rest: str) -> tuple[str, ...]:
        root = self.path.parent
        real = [Path(os.path.realpath(path)) for path in (folder, root)]
        return tuple(dict.fromkeys([path_from(folder / rest, root), path_from(real[0] / rest, real[1])]))

    def _spec(self, mesh: Path) -> JobSpec:
        """Return the job spec of a mesh: the options of all, changed by the overrides and the asset in their order.

        Paths of files are as the manifest has them.
        """
        matching: list[Tables] = [entry for entry in self.file.override if self._matches_any(mesh, [entry.match])]
        if single := self._single.get(os.path.abspath(mesh)):
            matching.append(single)
        try:
            first = bake, spheres = self.file.choices()
            for entry in matching:
                over_bake, over_spheres = entry.choices()
                bake, spheres = _over(bake, over_bake, first[0]), _over(spheres, over_spheres, first[1])
            return make_job_spec(arguments_of(bake), arguments_of(spheres))
        except UsageError as error:
            message = error.worded(key_name) if isinstance(error, ArgumentError) else str(error)
            raise UsageError(f"{self.path}, for {mesh}: {message}") from error


def read_manifest(path: Path) -> Manifest:
    """Read a manifest; raises InputError where it is missing, UsageError where it is not valid TOML or not right."""
    try:
        document = tomllib.loads(path.read_text(encoding="utf-8-sig"))
    except OSError as error:
        raise InputError(
            f"{path}: cannot be read ({error.strerror}), a manifest was expected; check the path"
        ) from error
    except ValueError as error:
        raise UsageError(f"{path}: is not valid TOML: {error}") from error
    try:
        file = convert(document, ManifestFile)
        for entry in file.asset:
            if entry.name is not None and not _is_name(entry.name):
                raise UsageError(f"name is {entry.name!r}; expected one below the output folder, such as props/rock")
        if file.bake is None and file.spheres is None and not (file.override or file.asset):
            raise UsageError("says nothing about bake or spheres; give it a table [bake], [spheres] or both")
        if not (file.inputs or file.asset):
            raise InputError("names no meshes; give it inputs, or an [[asset]]")
    except AoprecalcError as error:
        raise type(error)(f"{path}: {error}") from error
    return Manifest(path, file)


def _over(before: Choice, choice: Choice, default: Choice) -> Choice:
    """Return a choice changed by a later one: a table adds to what holds, or to the default where that is off."""
    if choice is None:
        return before
    if isinstance(choice, bool):
        return choice and (before or default or True)
    kept = arguments_of(before or default) or {}
    replaced = COUNTS if COUNTS & choice.keys() else frozenset[str]()
    return {key: value for key, value in kept.items() if key not in replaced} | choice


def _listed(patterns: tuple[str, ...] | str) -> tuple[str, ...]:
    return (patterns,) if isinstance(patterns, str) else patterns


def _is_name(text: str) -> bool:
    """Tell whether a text is a relative path of plain names, outside the state folder."""
    parts = text.split("/")
    plain = all(part.strip(". ") and may_name_a_file(part) for part in parts) and parts[0] != STATE_FOLDER
    return plain and not any(char < " " for char in text)
