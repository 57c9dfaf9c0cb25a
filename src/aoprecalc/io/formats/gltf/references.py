"""Remove and add textures, images, samplers and buffer views in a glTF document, keeping all references valid.

A removed entry becomes None, so that no other index changes. New entries reuse such slots first; `compact` finally
renumbers what is left.
"""

import re
from collections.abc import Iterable, Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any

from aoprecalc.io.formats.builder import damaged_file
from aoprecalc.io.formats.gltf.buffers import GltfBuffer
from aoprecalc.io.formats.gltf.document import Json

# Entries refer to later kinds only.
KINDS = ("textures", "images", "samplers", "bufferViews")

# Extensions whose references `_kind` knows, or that have none to these kinds; others may use any index.
_KNOWN_EXTENSIONS = re.compile(
    "KHR_(materials_|texture_|mesh_quantization|lights_punctual|node_|animation_pointer|xmp).*"
    "|EXT_(texture_|mesh_gpu_instancing|mesh_features|structural_metadata|lights_image_based|instance_features).*"
    "|MSFT_texture_dds|MSFT_lod"
)

Reference = tuple[Any, Any]  # a dictionary or list, and the key or index under which it holds the index of an entry


def release_references(document: Json, buffer: GltfBuffer, references: Iterable[Reference]) -> None:
    """Set references to None, and with them every entry that only they needed, directly or indirectly.

    Entries that were unreferenced before stay; so does everything in a document with unknown extensions.
    """
    before = _used(document)
    for holder, key in references:
        holder[key] = None
    if not _has_known_extensions(document):
        return
    for kind in KINDS:
        entries = document.get(kind, [])
        unused = (before[kind] - _used(document)[kind]) & set(range(len(entries)))
        if kind == "bufferViews":
            buffer.free_views(unused)
        for index in unused:
            entries[index] = None


def add_entry(document: Json, kind: str, entry: Json) -> int:
    """Add an entry in a removed one's slot, or at the end; return its index."""
    entries: list[Json | None] = document.setdefault(kind, [])
    if None not in entries:
        entries.append(entry)
        return len(entries) - 1
    index = entries.index(None)
    entries[index] = entry
    return index


def compact(document: Json) -> None:
    """Delete the slots of removed entries, and renumber the references to later ones."""
    if not _has_known_extensions(document):
        views = document.get("bufferViews", [])
        views[:] = [{"buffer": 0, "byteLength": 1} if view is None else view for view in views]
        return
    references = _references(document)
    for kind in KINDS:
        entries = document.get(kind, [])
        kept = [index for index, entry in enumerate(entries) if entry is not None]
        if len(kept) == len(entries):
            continue
        new_index = {index: number for number, index in enumerate(kept)}
        for holder, key in references[kind]:
            holder[key] = new_index.get(holder[key], holder[key])  # a damaged document may have invalid ones
        document[kind] = [entries[index] for index in kept]
        if not kept:  # the schema forbids empty lists
            del document[kind]


def check_references(path: Path, document: Json) -> None:
    """Raise InputError for a reference to a texture, image, sampler or buffer view that does not exist.

    An entry that the bake adds would otherwise get that index. So does one that is not a whole number, unless it is in
    an extension that is not known.
    """
    for names, holder, key in _scalars(document, ()):
        kind, value = _kind(names), holder[key]
        if kind is not None and type(value) is not int and not unknown_extensions(_extensions_in(names)):
            raise damaged_file(path, f"it refers to entry {str(value)[:20]!r} of {kind}, a whole number was expected")
    for kind, found in _references(document).items():
        count = len(document.get(kind, []))
        for holder, key in found:
            if not 0 <= holder[key] < count:
                raise damaged_file(path, f"it refers to entry {holder[key]} of {kind}, but there are {count}")


def unknown_extensions(names: Iterable[str]) -> list[str]:
    """Return the names of extensions that are not known here, sorted."""
    return sorted({name for name in names if not _KNOWN_EXTENSIONS.fullmatch(name)})


def _has_known_extensions(document: Json) -> bool:
    return not unknown_extensions(document.get("extensionsUsed", []))


def _used(document: Json) -> dict[str, set[int]]:
    """Return the referenced indices of each kind."""
    return {kind: {holder[key] for holder, key in found} for kind, found in _references(document).items()}


def _references(document: Json) -> dict[str, list[Reference]]:
    """Return all references to entries of each kind."""
    found: dict[str, list[Reference]] = {kind: [] for kind in KINDS}
    for names, holder, key in _scalars(document, ()):
        kind = _kind(names)
        if kind is not None and type(holder[key]) is int:  # not a boolean
            found[kind].append((holder, key))
    return found


def _kind(names: tuple[str, ...]) -> str | None:
    """Return the kind of entry that the integer at a path of names is the index of; None if of none of KINDS."""
    last, owner = names[-1], names[-2] if len(names) > 1 else ""
    # Any textureInfo, in extensions as well; EXT_structural_metadata has some under arbitrary names.
    if last == "index" and (owner.lower().endswith("texture") or "propertyTextures" in names):
        return "textures"
    # Extensions of a texture have a source; specularImages belongs to EXT_lights_image_based.
    if (last == "source" and names[0] == "textures") or last == "specularImages":
        return "images"
    if names == ("textures", "sampler"):
        return "samplers"
    # EXT_structural_metadata again.
    if last == "bufferView" or ("propertyTables" in names and last in ("values", "arrayOffsets", "stringOffsets")):
        return "bufferViews"
    return None


def _extensions_in(names: tuple[str, ...]) -> list[str]:
    """Return the extensions that a path of names leads through."""
    return [name for before, name in pairwise(names) if before == "extensions"]


def _scalars(value: Any, names: tuple[str, ...]) -> Iterator[tuple[tuple[str, ...], Any, Any]]:
    """Yield (names, holder, key) for every number or text in a JSON value: the path of names to it, and its place.

    What is in extras is left out: its meaning is unknown.
    """
    for key, member in list(value.items() if isinstance(value, dict) else enumerate(value)):
        path = (*names, key) if isinstance(value, dict) else names
        if not isinstance(member, dict | list):
            if path:
                yield path, value, key
        elif key != "extras":
            yield from _scalars(member, path)
