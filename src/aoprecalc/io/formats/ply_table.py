"""The header of a PLY file, and its body: rows of numbers and lists, read and written."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from aoprecalc.io.formats.builder import damaged_file
from aoprecalc.io.formats.files import FileSearch
from aoprecalc.types import Int64Array

TYPES = {
    "char": "i1", "int8": "i1", "uchar": "u1", "uint8": "u1",
    "short": "i2", "int16": "i2", "ushort": "u2", "uint16": "u2",
    "int": "i4", "int32": "i4", "uint": "u4", "uint32": "u4",
    "float": "f4", "float32": "f4", "double": "f8", "float64": "f8",
}  # fmt: skip


@dataclass(frozen=True)
class Property:
    """One property of an element: a number of type `kind` or, where `count` names a type, a list of them."""

    name: str
    kind: str
    count: str | None = None

    def __post_init__(self) -> None:
        """Raise KeyError for an unknown type."""
        for kind in (self.kind, self.count or self.kind):
            TYPES[kind]

    @property
    def line(self) -> str:
        """Its line in the header."""
        kinds = self.kind if self.count is None else f"list {self.count} {self.kind}"
        return f"property {kinds} {self.name}"


@dataclass(frozen=True)
class Element:
    """An element of the header: `count` rows of the properties."""

    name: str
    count: int
    properties: list[Property]

    @property
    def lines(self) -> list[str]:
        """Its lines in the header."""
        return [f"element {self.name} {self.count}", *(prop.line for prop in self.properties)]


@dataclass(frozen=True)
class Header:
    """A header and the bytes after it.

    order     the byte order of `body`, < or >; or ascii
    comments  its lines `comment` and `obj_info`, except those that name textures
    textures  what each `comment TextureFile` names, as MeshLab writes it
    """

    elements: list[Element]
    order: str
    body: bytes
    comments: tuple[str, ...]
    textures: tuple[str, ...]

    def texture_files(self, path: Path) -> tuple[Path, ...]:
        """Return the files of the textures of the PLY at `path`, existing or not."""
        search = FileSearch(path.parent)
        return tuple(dict.fromkeys(file for name in self.textures if (file := search.place(name)) is not None))


_END = re.compile(rb"end_header[ \t]*(\r\n|\n|\r)")


def read_header(path: Path, data: bytes) -> Header:
    """Return the header of a PLY file of the given bytes; raises InputError where it is damaged."""
    end = _END.search(data)
    if not data.startswith(b"ply") or end is None:
        raise damaged_file(path, "a PLY header from 'ply' to 'end_header' was expected and is not there")
    order = ""
    elements: list[Element] = []
    comments: list[str] = []
    textures: list[str] = []
    for line in re.split("[\r\n]+", data[: end.start()].decode("utf-8", "surrogateescape")):
        words = line.split()
        if words[:1] == ["format"] and len(words) >= 2:
            order = {"ascii": "ascii", "binary_little_endian": "<", "binary_big_endian": ">"}.get(words[1], "")
        elif words[:1] == ["element"]:
            elements.append(Element(words[1], int(words[2]), []))
        elif words[:1] == ["property"]:
            elements[-1].properties.append(_property(path, words))
        elif words[:2] == ["comment", "TextureFile"] and len(words) > 2:
            textures.append(line.split(None, 2)[2].rstrip())
        elif words[:1] in (["comment"], ["obj_info"]):
            comments.append(line)
    if not order:
        raise damaged_file(path, "its PLY header names no known format, ascii or binary was expected")
    return Header(elements, order, data[end.end() :], tuple(comments), tuple(textures))


def _property(path: Path, words: Sequence[str]) -> Property:
    try:
        if words[1] == "list":
            return Property(words[4], words[3], words[2])
        return Property(words[2], words[1])
    except (IndexError, KeyError):
        raise damaged_file(path, f"its PLY header says {' '.join(words)!a}, a property was expected") from None


@dataclass(frozen=True, eq=False)
class Lists:
    """A list for every row: concatenated `values`, and the length of each list, `counts` (rows,)."""

    counts: Int64Array
    values: NDArray[Any]

    def take(self, rows: Int64Array) -> Self:
        """Return the lists of some rows."""
        counts = self.counts[rows]
        starts = np.cumsum(self.counts) - self.counts
        within = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)
        return type(self)(counts, self.values[np.repeat(starts[rows], counts) + within])


@dataclass(frozen=True, eq=False)
class Table:
    """The rows of one element: (rows,) numbers by name, and lists by name."""

    columns: dict[str, NDArray[Any]]
    lists: dict[str, Lists]


def read_table(path: Path, elements: list[Element], body: bytes, order: str) -> dict[str, Table]:
    """Read all elements from the bytes after the header.

    order   ascii, or the byte order < or > of a binary file

    Raises InputError where there are fewer bytes than the elements need; nothing is allocated before that is known.
    """
    source = _AsciiValues(body) if order == "ascii" else _BinaryValues(body, order)
    tables, offset = {}, 0
    for element in elements:
        if not element.properties:
            continue
        min_row = sum(source.size(prop.count or prop.kind) for prop in element.properties)
        if element.count < 0 or offset + element.count * min_row > len(source):
            raise damaged_file(
                path, f"its header promises {element.count} of {element.name!a}, but it ends before that"
            )
        try:
            tables[element.name], offset = _read_element(source, element, offset)
        except OverflowError as error:
            raise damaged_file(path, f"{element.name!a} has a number that {error}") from None
        except (IndexError, ValueError):
            raise damaged_file(
                path, f"not all of the {element.count} expected rows of {element.name!a} are there"
            ) from None
    return tables


def element_bytes(element: Element, table: Table) -> bytes:
    """Return the rows of an element for a little-endian binary file."""
    lists = [table.lists[prop.name].counts for prop in element.properties if prop.count]
    lengths = np.column_stack([np.zeros(element.count, dtype=np.int64), *lists])
    if (lengths == lengths[:1]).all():
        return _block(element, table, np.arange(element.count)).tobytes()
    layouts, layout = np.unique(lengths, axis=0, return_inverse=True)
    chosen = [np.flatnonzero(layout.reshape(-1) == index) for index in range(len(layouts))]
    blocks = [_block(element, table, rows) for rows in chosen]
    sizes = np.array([block.dtype.itemsize for block in blocks], dtype=np.int64)[layout.reshape(-1)]
    starts = np.cumsum(sizes) - sizes
    result = np.empty(sizes.sum(), dtype=np.uint8)
    for rows, block in zip(chosen, blocks, strict=True):
        size = block.dtype.itemsize
        result[starts[rows][:, None] + np.arange(size)] = block.view(np.uint8).reshape(-1, size)
    return result.tobytes()


def _block(element: Element, table: Table, rows: Int64Array) -> NDArray[Any]:
    """Return rows of an element, whose lists have equal lengths, as a structured array."""
    fields: list[tuple[Any, ...]] = []
    values: dict[str, NDArray[Any]] = {}
    for prop in element.properties:
        if prop.count is None:
            fields.append((prop.name, "<" + TYPES[prop.kind]))
            values[prop.name] = table.columns[prop.name][rows]
            continue
        entries = table.lists[prop.name]
        length = int(entries.counts[rows[0]]) if len(rows) else 0
        starts = (np.cumsum(entries.counts) - entries.counts)[rows]
        fields += [(f"count of {prop.name}", "<" + TYPES[prop.count]), (prop.name, "<" + TYPES[prop.kind], (length,))]
        values[f"count of {prop.name}"] = entries.counts[rows]
        values[prop.name] = entries.values[starts[:, None] + np.arange(length)]
    block = np.empty(len(rows), dtype=fields)
    for name, column in values.items():
        block[name] = column
    return block


class _BinaryValues:
    """The values of a binary file; offsets count bytes."""

    def __init__(self, body: bytes, order: str) -> None:
        self._bytes = np.frombuffer(body, dtype=np.uint8)
        self._body = body
        self._order = order

    def __len__(self) -> int:
        return len(self._bytes)

    def size(self, kind: str) -> int:
        """Return the size of a value in units of offsets."""
        return np.dtype(TYPES[kind]).itemsize

    def count(self, kind: str, offset: int) -> int:
        """Return the integer at an offset; raises IndexError past the end."""
        size = self.size(kind)
        if offset + size > len(self._body):
            raise IndexError
        return int.from_bytes(self._body[offset : offset + size], "little" if self._order == "<" else "big")

    def take(self, kind: str, offsets: Int64Array) -> NDArray[Any]:
        """Return the values at (n,) offsets; raises IndexError past the end."""
        size = self.size(kind)
        picked = self._bytes[offsets[:, None] + np.arange(size)]
        numbers: NDArray[Any] = picked.view(np.dtype(self._order + TYPES[kind]))[:, 0]
        return numbers.astype(TYPES[kind])


class _AsciiValues:
    """The values of an ASCII file; offsets count words."""

    def __init__(self, body: bytes) -> None:
        self._numbers = np.array(body.split(), dtype=np.float64)

    def __len__(self) -> int:
        return len(self._numbers)

    def size(self, kind: str) -> int:
        return 1

    def count(self, kind: str, offset: int) -> int:
        return int(self._numbers[offset])

    def take(self, kind: str, offsets: Int64Array) -> NDArray[Any]:
        """Return the values at (n,) offsets; raises OverflowError for those that an integer type does not hold."""
        numbers, dtype = self._numbers[offsets], np.dtype(TYPES[kind])
        if dtype.kind in "iu" and len(numbers):
            limits = np.iinfo(dtype)
            if not (numbers.min() >= limits.min and numbers.max() <= limits.max):  # NaN is neither
                raise OverflowError(f"is no {kind}")
        return numbers.astype(dtype)


def _read_element(source: _BinaryValues | _AsciiValues, element: Element, offset: int) -> tuple[Table, int]:
    """Read one element whose rows start at an offset; also return the offset after it."""
    starts, counts, end = _locate(source, element, offset)
    columns, lists = {}, {}
    for index, prop in enumerate(element.properties):
        if prop.count is None:
            columns[prop.name] = source.take(prop.kind, starts[:, index])
            continue
        first = starts[:, index] + source.size(prop.count)
        length = counts[:, index]
        within = np.arange(length.sum()) - np.repeat(np.cumsum(length) - length, length)
        offsets = np.repeat(first, length) + within * source.size(prop.kind)
        lists[prop.name] = Lists(length, source.take(prop.kind, offsets))
    return Table(columns, lists), end


def _locate(source: _BinaryValues | _AsciiValues, element: Element, offset: int) -> tuple[Int64Array, Int64Array, int]:
    """Return the offset of each property and the length of each list, (rows, properties), and the end of the rows."""
    starts, counts, end = _locate_each_row(source, element, offset, min(element.count, 1))

    # Usually all rows have the layout of the first; if not, they have to be read one after another.
    row = end - offset
    all_end = offset + row * element.count
    if all_end > len(source):
        return _locate_each_row(source, element, offset, element.count)
    all_starts = starts + row * np.arange(element.count)[:, None]
    for index, prop in enumerate(element.properties):
        if prop.count and np.any(source.take(prop.count, all_starts[:, index]) != counts[:, index]):
            return _locate_each_row(source, element, offset, element.count)
    return all_starts, np.broadcast_to(counts, all_starts.shape), all_end


def _locate_each_row(
    source: _BinaryValues | _AsciiValues, element: Element, offset: int, rows: int
) -> tuple[Int64Array, Int64Array, int]:
    """Do the same one row after another; raises IndexError or ValueError past the end of the file."""
    steps = [(prop.count, source.size(prop.count or prop.kind), source.size(prop.kind)) for prop in element.properties]
    starts: list[int] = []
    counts: list[int] = []
    for _ in range(rows):
        for count_kind, head, size in steps:
            starts.append(offset)
            length = source.count(count_kind, offset) if count_kind else 0
            if length < 0:
                raise ValueError
            counts.append(length)
            offset += head + length * size
    if offset > len(source):
        raise IndexError
    shape = (rows, len(steps))
    return np.array(starts, dtype=np.int64).reshape(shape), np.array(counts, dtype=np.int64).reshape(shape), offset
