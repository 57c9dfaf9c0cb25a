"""Textures, images, samplers and buffer views that come and go in a glTF document that is being written.

What nothing needs any more leaves None in its place, so that no other number changes. New entries take such places
first, and at the end the numbers close up over those that are left.
"""

import re
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

from aoprecalc.io.formats.builder import damaged_file
from aoprecalc.io.formats.gltf.buffers import GltfBuffer
from aoprecalc.io.formats.gltf.document import Json

# None refers to one of a kind before its own.
KINDS = ("textures", "images", "samplers", "bufferViews")

# Extensions whose references are found here, or that have none to these kinds; others may count on any number.
_UNDERSTOOD = re.compile(
    "KHR_(materials_|texture_|mesh_quantization|lights_punctual|node_|animation_pointer|xmp).*"
    "|EXT_(texture_|mesh_gpu_instancing|mesh_features|structural_metadata|lights_image_based|instance_features).*"
    "|MSFT_texture_dds|MSFT_lod"
)

Reference = tuple[Any, Any]  # a dictionary or list, and the key under which it has a number


def release(document: Json, buffer: GltfBuffer, references: Iterable[Reference]) -> None:
    """Put None in the place of some references, and of every entry that only they needed, at second hand as well.

    What nothing referred to before stays; so does everything in a document with extensions that are not known here.
    """
    before = _used(document)
    for holder, key in references:
        holder[key] = None
    if not _is_understood(document):
        return
    for kind in KINDS:
        entries = document.get(kind, [])
        gone = (before[kind] - _used(document)[kind]) & set(range(len(entries)))
        if kind == "bufferViews":
            buffer.free_views(gone)
        for index in gone:
            entries[index] = None


def place(document: Json, kind: str, entry: Json) -> int:
    """Add an entry where one was released, or at the end; return its number."""
    entries: list[Json | None] = document.setdefault(kind, [])
    if None not in entries:
        entries.append(entry)
        return len(entries) - 1
    index = entries.index(None)
    entries[index] = entry
    return index


def close_gaps(document: Json) -> None:
    """Remove what was released and not taken again; what comes after it gets lower numbers."""
    if not _is_understood(document):
        views = document.get("bufferViews", [])
        views[:] = [{"buffer": 0, "byteLength": 1} if view is None else view for view in views]
        return
    references = _references(document)
    for kind in KINDS:
        entries = document.get(kind, [])
        left = [index for index, entry in enumerate(entries) if entry is not None]
        if len(left) == len(entries):
            continue
        numbers = {index: number for number, index in enumerate(left)}
        for holder, key in references[kind]:
            holder[key] = numbers.get(holder[key], holder[key])  # a damaged document may refer to what is not there
        document[kind] = [entries[index] for index in left]
        if not left:  # the schema has no empty lists
            del document[kind]


def check_references(path: Path, document: Json) -> None:
    """Raise InputError where something refers to a texture, image, sampler or buffer view that is not there.

    What the bake adds would take its place.
    """
    for kind, found in _references(document).items():
        count = len(document.get(kind, []))
        for holder, key in found:
            if not 0 <= holder[key] < count:
                raise damaged_file(path, f"it refers to entry {holder[key]} of {kind}, but there are {count}")


def unknown_extensions(names: Iterable[str]) -> list[str]:
    """Return those of the names of extensions whose meaning is not known here."""
    return sorted({name for name in names if not _UNDERSTOOD.fullmatch(name)})


def _is_understood(document: Json) -> bool:
    return not unknown_extensions(document.get("extensionsUsed", []))


def _used(document: Json) -> dict[str, set[int]]:
    """Return the numbers, of each kind, that something refers to."""
    return {kind: {holder[key] for holder, key in found} for kind, found in _references(document).items()}


def _references(document: Json) -> dict[str, list[Reference]]:
    """Return every reference to an entry of each kind."""
    found: dict[str, list[Reference]] = {kind: [] for kind in KINDS}
    for names, holder, key in _integers(document, ()):
        kind = _kind(names)
        if kind is not None:
            found[kind].append((holder, key))
    return found


def _kind(names: tuple[str, ...]) -> str | None:
    """Return of what kind of entry an integer at the end of these names is the number; None if of none of KINDS."""
    last, owner = names[-1], names[-2] if len(names) > 1 else ""
    # Any textureInfo, of extensions too; EXT_structural_metadata has some under names of its user's.
    if last == "index" and (owner.lower().endswith("texture") or "propertyTextures" in names):
        return "textures"
    # Extensions of a texture have a source each; the other name is of EXT_lights_image_based.
    if (last == "source" and names[0] == "textures") or last == "specularImages":
        return "images"
    if names == ("textures", "sampler"):
        return "samplers"
    # EXT_structural_metadata again.
    if last == "bufferView" or ("propertyTables" in names and last in ("values", "arrayOffsets", "stringOffsets")):
        return "bufferViews"
    return None


def _integers(value: Any, names: tuple[str, ...]) -> Iterator[tuple[tuple[str, ...], Any, Any]]:
    """Yield every integer in a JSON value as the names that lead to it, and what has it under which key or index.

    Those in extras are left out: their meaning is not known.
    """
    for key, member in list(value.items() if isinstance(value, dict) else enumerate(value)):
        path = (*names, key) if isinstance(value, dict) else names
        if type(member) is int:  # booleans are none
            yield path, value, key
        elif isinstance(member, dict | list) and key != "extras":
            yield from _integers(member, path)
