"""What is to be made of an asset, and the tables of options in which people say so."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields, replace
from typing import Any, TypeVar, get_args, get_type_hints

from aoprecalc.errors import UsageError
from aoprecalc.options import BakeOptions, SphereOptions
from aoprecalc.quantities import read_bytes, read_levels, read_shadow_size, read_size

Table = Mapping[str, Any]
Options = TypeVar("Options", BakeOptions, SphereOptions)

TEXTURES, MESHES = (".png", ".exr", ".tif", ".tiff", ".jpg", ".tga", ".bmp"), ("", ".obj", ".ply", ".gltf", ".glb")
SPHERE_SETS = (".json", ".csv", ".npz", ".ply", ".obj", ".glb", ".yml", ".yaml", ".urdf", ".usda")


@dataclass(frozen=True)
class Order:
    """What is made of one asset: a texture, spheres, or both.

    bake      how the texture is baked; None: no texture
    spheres   how spheres are fitted; None: none
    texture   extension of the texture
    mesh      extension of the mesh that goes with it; empty: as `aoprecalc bake` chooses
    verify    measure the texture against ray tracing, for the report
    set       extension of the sphere set
    """

    bake: BakeOptions | None = None
    spheres: SphereOptions | None = None
    texture: str = ".png"
    mesh: str = ""
    verify: bool = False
    set: str = ".json"

    def with_threads(self, threads: int) -> "Order":
        """Return the same with this many threads where it says nothing about them."""
        if self.bake is None or self.bake.threads:
            return self
        return replace(self, bake=replace(self.bake, threads=threads))


def read_order(bake: Table | None, spheres: Table | None) -> Order:
    """Return the order that two tables stand for; None: nothing of the kind.

    bake      fields of BakeOptions, but `size` as in "2048x1024"; and `texture`, `mesh`, `verify` of Order
    spheres   fields of SphereOptions; and `format`, the extension of the set
    Keys may be written with - or _. Raises UsageError for a key, a type or a value that is wrong.
    """
    if bake is None and spheres is None:
        raise UsageError("neither bake nor spheres is asked for, so there is nothing to do; ask for one of them")
    made: dict[str, Any] = {}
    if bake is not None:
        rest = _plain_keys(bake)
        if "size" in rest:
            rest["width"], rest["height"] = _size(rest.pop("size"))
        made["verify"] = _typed("verify", rest.pop("verify", False), bool)
        made["texture"] = _extension("texture", rest.pop("texture", ".png"), TEXTURES)
        made["mesh"] = _extension("mesh", rest.pop("mesh", ""), MESHES)
        made["bake"] = _options(BakeOptions, rest, "size", "texture", "mesh", "verify")
    if spheres is not None:
        rest = _plain_keys(spheres)
        made["set"] = _extension("format", rest.pop("format", ".json"), SPHERE_SETS)
        made["spheres"] = _options(SphereOptions, rest, "format")
    return Order(**made)


def as_words(options: BakeOptions | SphereOptions) -> list[str]:
    """Return the words of a command line that stand for options, those that are not the default."""
    words: list[str] = []
    given = {field.name: getattr(options, field.name) for field in fields(options)}
    if isinstance(options, BakeOptions):
        width, height = given.pop("width"), given.pop("height")
        if (width, height) != (BakeOptions.width, BakeOptions.height):
            words += ["--size", str(width) if width == height else f"{width}x{height}"]
        if given["memory_limit"] is not None:
            given["memory_limit"] = f"{given['memory_limit'] >> 10}K"
    for name, value in given.items():
        if value == getattr(type(options), name):
            continue
        option = f"--{name.replace('_', '-')}"
        if value is True:
            words.append(option)
        elif name == "levels":
            words += [option, ",".join(map(str, value))]
        elif isinstance(value, tuple):
            words += [word for entry in value for word in (option, entry)]
        else:
            words += [option, str(value)]
    return words


# Options that people may also write as a text.
_READ: dict[str, Callable[[str], Any]] = {
    "memory_limit": read_bytes,
    "shadow_size": read_shadow_size,
    "levels": read_levels,
}


def _options(kind: type[Options], table: dict[str, Any], *others: str) -> Options:
    """Return the options of a table whose keys are fields; `others`: what else may be in such a table."""
    hints: dict[str, Any] = get_type_hints(kind)
    values = {}
    for key, value in table.items():
        if key not in hints:
            known = sorted({*others, *hints} - {"width", "height"})
            raise UsageError(f"{key!r} is no option, one of {', '.join(known)} was expected".replace("_", "-"))
        read = _READ.get(key)
        values[key] = read(value) if read and isinstance(value, str) else _typed(key, value, hints[key])
    return kind(**values)


def _plain_keys(table: Table) -> dict[str, Any]:
    return {key.replace("-", "_"): value for key, value in table.items()}


def _size(value: Any) -> tuple[int, int]:
    if isinstance(value, str):
        return read_size(value)
    if isinstance(value, tuple):
        return value
    return (value, value)


def _extension(key: str, value: Any, known: tuple[str, ...]) -> str:
    if value not in known:
        raise UsageError(f"{key} is {value!r}; expected one of {', '.join(filter(None, known))}")
    return str(value)


def _typed(key: str, value: Any, hint: Any) -> Any:
    """Return a value that is as its hint says; what ranges and choices say is checked by the options themselves."""
    if hint is bool and not isinstance(value, bool):
        raise UsageError(f"{key.replace('_', '-')} is {value!r}; expected true or false")
    if getattr(hint, "__origin__", None) is tuple:
        entries = [value] if isinstance(value, str) else value
        kind = get_args(hint)[0]
        if not isinstance(entries, list | tuple) or not all(isinstance(entry, kind) for entry in entries):
            raise UsageError(f"{key.replace('_', '-')} is {value!r}; expected a list")
        return tuple(entries)
    return value
