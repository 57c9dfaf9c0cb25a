"""Find the meshes that patterns match, and name their assets in the output folder."""

import glob
import os
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from difflib import get_close_matches
from fnmatch import fnmatchcase
from pathlib import Path

from aoprecalc.errors import InputError, UsageError
from aoprecalc.io import MESH_EXTENSIONS
from aoprecalc.system import path_from

_MAX_SUGGESTIONS = 3  # for a pattern that matches nothing


def is_pattern(text: str, root: str | Path = "") -> bool:
    """Tell whether a text has wildcards and is not itself the name of a file or folder, relative to `root`."""
    return glob.has_magic(text) and not os.path.exists(os.path.join(root, text))


def find_meshes(patterns: Sequence[str], is_output: Callable[[Path], bool], root: str | Path = "") -> list[Path]:
    """Return the mesh files that patterns match, each once, without the outputs of batches.

    A pattern is the name of a file, which may have the wildcards *, ? and ** (any folders), or a folder, which stands
    for all files below it. Wildcards and folders match files with the extension of a mesh only, sorted.
    root   the folder that patterns are relative to; empty: the current one
    Raises InputError for patterns that match no mesh; it names them all.
    """
    found: dict[str, Path] = {}
    missed: list[str] = []
    for pattern in patterns:
        path = os.path.join(root, pattern)
        if os.path.isdir(path):
            matches = _meshes(Path(path), "**/*")
        elif is_pattern(pattern, root):
            matches = _meshes(*_split(Path(root), pattern))
        else:
            matches = [Path(path)] if _is_mesh(path) else []  # if it is missing, that asset fails
        if not matches:
            others = [other for other in neighbours(path) if other != os.path.join(path, "*")]
            missed.append(f"{path}: matches no mesh{suggest(path, others)}")
        for mesh in matches:
            if not is_output(mesh):
                found.setdefault(os.path.abspath(mesh), mesh)
    if missed:
        expected = (
            f"one of {', '.join(MESH_EXTENSIONS)} was expected; check the pattern{'s' if len(missed) > 1 else ''}"
        )
        raise InputError(f"{'; '.join(missed)}; {expected}")
    if patterns and not found:
        raise InputError(
            f"{', '.join(patterns)}: matches only outputs of batches, meshes were expected; check the pattern"
        )
    return list(found.values())


def path_matches(path: str, pattern: str) -> bool:
    """Tell whether a relative path matches a pattern, both with forward slashes.

    A pattern without a slash is compared with the name of the file. * and ? match slashes as well; **/ is any number
    of folders, or none.
    """
    if "/" not in pattern:
        return fnmatchcase(path.rpartition("/")[2], pattern)
    return any(fnmatchcase(path, expanded) for expanded in _without_double_stars(pattern))


def _without_double_stars(pattern: str) -> list[str]:
    """Return a pattern once with folders, and once with none, in the place of each **/ in it."""
    head, deep, rest = pattern.partition("**/")
    return [head + folders + tail for folders in ("", "*/") for tail in _without_double_stars(rest)] if deep else [head]


def suggest(pattern: str, candidates: Iterable[str]) -> str:
    """Return the candidates that are the most like a pattern, as the end of a message; empty where none is."""
    folded: dict[str, str] = {}
    for candidate in candidates:
        folded.setdefault(candidate.casefold(), candidate)
    near = get_close_matches(pattern.casefold(), folded, _MAX_SUGGESTIONS, cutoff=0.5)
    return f" (nearest: {', '.join(repr(folded[name]) for name in near)})" if near else ""


def with_folders(paths: Iterable[str]) -> list[str]:
    """Return relative paths with what else could be meant: their names, and all files of their folders."""
    found: dict[str, None] = {}
    for path in paths:
        parts = path.split("/")
        folders = ["/".join([*parts[:depth], "*"]) for depth in range(1, len(parts))]
        found |= dict.fromkeys([path, parts[-1], *folders])
    return list(found)


def neighbours(path: str) -> list[str]:
    """Return the meshes and folders, with /*, in the deepest folder of a path or pattern that exists."""
    folder = next((parent for parent in Path(path).parents if os.path.isdir(parent)), None)
    if folder is None:
        return []  # a drive of Windows that is not there
    try:
        entries = sorted(folder.iterdir())
    except OSError:
        return []
    shown = [entry for entry in entries if not entry.name.startswith(".") and (_is_mesh(entry.name) or entry.is_dir())]
    return [f"{entry}/*" if entry.is_dir() else str(entry) for entry in shown]


def base_folder(patterns: Iterable[str], root: str | Path = "") -> Path:
    """Return the deepest folder that contains all patterns, up to their first wildcards: names are relative to it."""
    folders = []
    for pattern in patterns:
        path = Path(os.path.abspath(os.path.join(root, pattern)))
        if path.is_dir():
            folders.append(path)
            continue
        while path != path.parent and is_pattern(str(path)):
            path = path.parent
        folders.append(path if path.is_dir() else path.parent)
    try:
        return Path(os.path.commonpath(folders))
    except ValueError as error:  # on several drives of Windows
        drives = ", ".join(sorted({folder.drive for folder in folders}))
        raise UsageError(f"the inputs are on the drives {drives}; run a batch for each") from error


def name_assets(meshes: Sequence[Path], base: Path) -> list[str]:
    """Return each mesh's path relative to the base folder without its extension, such as props/rock.

    Where that is the same for several meshes, upper and lower case alike, the names keep the extension, such as
    rock_obj and rock_glb. Raises UsageError if two names are still the same.
    """
    paths = [Path(path_from(Path(os.path.abspath(mesh)), base)) for mesh in meshes]
    plain = [_asset_name(path.with_suffix("")) for path in paths]
    count = Counter(name.casefold() for name in plain)
    names = [
        f"{name}_{path.suffix.lower().removeprefix('.')}" if count[name.casefold()] > 1 else name
        for name, path in zip(plain, paths, strict=True)
    ]
    check_distinct(names, meshes)
    return names


def check_distinct(names: Sequence[str], meshes: Sequence[Path]) -> None:
    """Raise UsageError if two meshes have the same name, upper and lower case alike."""
    seen: dict[str, Path] = {}
    for name, mesh in zip(names, meshes, strict=True):
        other = seen.setdefault(name.casefold(), mesh)
        if other is not mesh:
            raise UsageError(
                f"{mesh} and {other} would both be written as {name}; rename one, or name them in a manifest"
            )


def _split(root: Path, pattern: str) -> tuple[Path, str]:
    """Split a pattern into the folder before its first wildcard and the rest."""
    parts = Path(pattern).parts
    first = next(number for number in range(len(parts)) if is_pattern(os.path.join(*parts[: number + 1]), root))
    rest = [*parts[first:], *(["*"] if parts[-1] == "**" else [])]
    return root.joinpath(*parts[:first]), "/".join(rest)


def _meshes(folder: Path, pattern: str) -> list[Path]:
    """Return the mesh files below a folder that a pattern matches, sorted, without hidden ones (.name).

    ** does not follow links to folders, which may form cycles.
    """
    found = [path for path in folder.glob(pattern) if _is_mesh(path.name) and path.is_file()]
    return sorted(path for path in found if not any(part.startswith(".") for part in path.relative_to(folder).parts))


def _is_mesh(path: str) -> bool:
    return path.lower().endswith(MESH_EXTENSIONS)


def _asset_name(path: Path) -> str:
    """Return a relative path as the name of an asset, which never leads out of the output folder."""
    return "/".join(part for part in path.parts if part not in ("..", path.anchor))
