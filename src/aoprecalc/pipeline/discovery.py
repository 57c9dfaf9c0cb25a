"""Which meshes a batch works on, and what each of them is called in the output folder."""

import glob
import os
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path

from aoprecalc.errors import InputError, UsageError
from aoprecalc.io import MESH_EXTENSIONS


def is_pattern(text: str, root: str | Path = "") -> bool:
    """Tell whether a text has a wildcard, and is not the name of a file or folder, counted from `root`."""
    return glob.has_magic(text) and not os.path.exists(os.path.join(root, text))


def find_meshes(patterns: Sequence[str], made: Callable[[Path], bool], root: str | Path = "") -> list[Path]:
    """Return the mesh files that patterns stand for, each once, but for those that a batch has `made`.

    A pattern is a file's name, perhaps with *, ? and ** (any folders), or a folder, which stands for all in it.
    What has wildcards or is a folder takes files of known kinds only, sorted.
    root   the folder from which the patterns count; empty: the present one
    Raises InputError for a pattern that fits no mesh.
    """
    found: dict[str, Path] = {}
    for pattern in patterns:
        path = os.path.join(root, pattern)
        if os.path.isdir(path):
            fitting = _meshes(Path(path), "**/*")
        elif is_pattern(pattern, root):
            fitting = _meshes(*_split(Path(root), pattern))
        else:
            fitting = [Path(path)] if _is_mesh(path) else []  # a missing mesh fails by itself
        if not fitting:
            raise InputError(
                f"{path}: fits no mesh, one of {', '.join(MESH_EXTENSIONS)} was expected; check the pattern"
            )
        for mesh in fitting:
            if not made(mesh):
                found.setdefault(os.path.abspath(mesh), mesh)
    if patterns and not found:
        raise InputError(f"{', '.join(patterns)}: made by a batch, or in its output folder; name what is to be made")
    return list(found.values())


def base_folder(patterns: Iterable[str], root: str | Path = "") -> Path:
    """Return the folder that all patterns lie in, up to their first wildcard: names count from there."""
    fixed = []
    for pattern in patterns:
        path = Path(os.path.abspath(os.path.join(root, pattern)))
        if path.is_dir():
            fixed.append(path)
            continue
        while path != path.parent and is_pattern(str(path)):
            path = path.parent
        fixed.append(path if path.is_dir() else path.parent)
    return Path(os.path.commonpath(fixed))


def name_assets(meshes: Sequence[Path], base: Path) -> list[str]:
    """Return each mesh's way from the base folder without its extension, such as props/rock.

    Meshes that would have one name keep their extensions in it, such as rock_obj and rock_glb, whatever capitals a file
    system tells apart. Raises UsageError where that does not part them.
    """
    ways = [Path(os.path.relpath(os.path.abspath(mesh), base)) for mesh in meshes]
    plain = [_inside(way.with_suffix("")) for way in ways]
    count: dict[str, int] = {}
    for name in plain:
        count[name.casefold()] = count.get(name.casefold(), 0) + 1
    names = [
        f"{name}_{way.suffix.lower().removeprefix('.')}" if count[name.casefold()] > 1 else name
        for name, way in zip(plain, ways, strict=True)
    ]
    check_distinct(names, meshes)
    return names


def check_distinct(names: Sequence[str], meshes: Sequence[Path]) -> None:
    """Raise UsageError where two meshes have one name."""
    seen: dict[str, Path] = {}
    for name, mesh in zip(names, meshes, strict=True):
        other = seen.setdefault(name.casefold(), mesh)
        if other is not mesh:
            raise UsageError(
                f"{mesh} and {other} would both be written as {name}; rename one, or name them in a manifest"
            )


def _split(root: Path, pattern: str) -> tuple[Path, str]:
    """Return the folder of a pattern up to its first wildcard, and the rest of the pattern."""
    parts = Path(pattern).parts
    first = next(number for number in range(len(parts)) if is_pattern(os.path.join(*parts[: number + 1]), root))
    rest = [*parts[first:], *(["*"] if parts[-1] == "**" else [])]
    return root.joinpath(*parts[:first]), "/".join(rest)


def _meshes(folder: Path, pattern: str) -> list[Path]:
    """Return the mesh files below a folder that a pattern fits, sorted; ** follows no links, which may lead in circles.

    What begins with a dot is hidden.
    """
    found = [path for path in folder.glob(pattern) if _is_mesh(path.name) and path.is_file()]
    return sorted(path for path in found if not any(part.startswith(".") for part in path.relative_to(folder).parts))


def _is_mesh(path: str) -> bool:
    return path.lower().endswith(MESH_EXTENSIONS)


def _inside(way: Path) -> str:
    """Return a way as a name below the output folder, which it never leaves."""
    return "/".join(part for part in way.parts if part not in ("..", "/"))
