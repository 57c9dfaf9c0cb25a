"""The body of a PLY file: rows of numbers and lists, as its header announces them, read and written."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aoprecalc.io.formats.builder import damaged_file

Places = NDArray[np.int64]

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
        """Raise KeyError for a type that PLY does not have."""
        for kind in (self.kind, self.count or self.kind):
            TYPES[kind]

    @property
    def line(self) -> str:
        """The line that announces it."""
        kinds = self.kind if self.count is None else f"list {self.count} {self.kind}"
        return f"property {kinds} {self.name}"


@dataclass(frozen=True)
class Element:
    """What a header announces: `count` rows of the properties."""

    name: str
    count: int
    properties: list[Property]

    @property
    def lines(self) -> list[str]:
        """The lines that announce it."""
        return [f"element {self.name} {self.count}", *(prop.line for prop in self.properties)]


@dataclass(frozen=True, eq=False)
class Lists:
    """A list for every row: `values` end to end, `counts` (rows,) of them each."""

    counts: Places
    values: NDArray[Any]


@dataclass(frozen=True, eq=False)
class Table:
    """The rows of one element: (rows,) numbers by name, and lists by name."""

    columns: dict[str, NDArray[Any]]
    lists: dict[str, Lists]


def read_table(path: Path, elements: list[Element], body: bytes, order: str) -> dict[str, Table]:
    """Read all elements from the bytes that follow the header.

    order   ascii, or the byte order < or > of a binary file

    Raises InputError where there are fewer bytes than the elements need; nothing of the size that the header
    promises is made before that is known.
    """
    cells = _Words(body) if order == "ascii" else _Bytes(body, order)
    tables, at = {}, 0
    for element in elements:
        if not element.properties:
            continue
        least = sum(cells.size(prop.count or prop.kind) for prop in element.properties)
        if element.count < 0 or at + element.count * least > len(cells):
            raise damaged_file(
                path, f"its header promises {element.count} of {element.name!a}, but it ends before that"
            )
        try:
            tables[element.name], at = _read_element(cells, element, at)
        except (IndexError, ValueError):
            raise damaged_file(
                path, f"not all of the {element.count} expected rows of {element.name!a} are there"
            ) from None
    return tables


def element_bytes(element: Element, table: Table) -> bytes:
    """Return the rows of an element as they stand in a little-endian binary file."""
    lists = [table.lists[prop.name].counts for prop in element.properties if prop.count]
    lengths = np.column_stack([np.zeros(element.count, dtype=np.int64), *lists])
    if (lengths == lengths[:1]).all():
        return _block(element, table, np.arange(element.count)).tobytes()
    kinds, kind = np.unique(lengths, axis=0, return_inverse=True)
    chosen = [np.flatnonzero(kind.reshape(-1) == at) for at in range(len(kinds))]
    blocks = [_block(element, table, rows) for rows in chosen]
    sizes = np.array([block.dtype.itemsize for block in blocks], dtype=np.int64)[kind.reshape(-1)]
    starts = np.cumsum(sizes) - sizes
    result = np.empty(sizes.sum(), dtype=np.uint8)
    for rows, block in zip(chosen, blocks, strict=True):
        size = block.dtype.itemsize
        result[starts[rows][:, None] + np.arange(size)] = block.view(np.uint8).reshape(-1, size)
    return result.tobytes()


def _block(element: Element, table: Table, rows: Places) -> NDArray[Any]:
    """Return some rows of an element whose lists are as long in one as in the other, as structured numbers."""
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


class _Bytes:
    """Numbers of a binary file; a place is a byte."""

    def __init__(self, body: bytes, order: str) -> None:
        self._bytes = np.frombuffer(body, dtype=np.uint8)
        self._body = body
        self._order = order

    def __len__(self) -> int:
        return len(self._bytes)

    def size(self, kind: str) -> int:
        """Return how many places a number takes."""
        return np.dtype(TYPES[kind]).itemsize

    def count(self, kind: str, at: int) -> int:
        """Return the whole number at one place; raises IndexError past the end."""
        size = self.size(kind)
        if at + size > len(self._body):
            raise IndexError
        return int.from_bytes(self._body[at : at + size], "little" if self._order == "<" else "big")

    def take(self, kind: str, places: Places) -> NDArray[Any]:
        """Return the numbers at (n,) places; raises IndexError past the end."""
        size = self.size(kind)
        picked = self._bytes[places[:, None] + np.arange(size)]
        numbers: NDArray[Any] = picked.view(np.dtype(self._order + TYPES[kind]))[:, 0]
        return numbers.astype(TYPES[kind])


class _Words:
    """Numbers of an ASCII file; a place is a word."""

    def __init__(self, body: bytes) -> None:
        self._numbers = np.array(body.split(), dtype=np.float64)

    def __len__(self) -> int:
        return len(self._numbers)

    def size(self, kind: str) -> int:
        return 1

    def count(self, kind: str, at: int) -> int:
        return int(self._numbers[at])

    def take(self, kind: str, places: Places) -> NDArray[Any]:
        return self._numbers[places].astype(TYPES[kind])


def _read_element(cells: _Bytes | _Words, element: Element, at: int) -> tuple[Table, int]:
    """Read one element whose rows begin at a place; also return the place after it."""
    starts, counts, end = _walk(cells, element, at)
    columns, lists = {}, {}
    for index, prop in enumerate(element.properties):
        if prop.count is None:
            columns[prop.name] = cells.take(prop.kind, starts[:, index])
            continue
        first = starts[:, index] + cells.size(prop.count)
        length = counts[:, index]
        within = np.arange(length.sum()) - np.repeat(np.cumsum(length) - length, length)
        places = np.repeat(first, length) + within * cells.size(prop.kind)
        lists[prop.name] = Lists(length, cells.take(prop.kind, places))
    return Table(columns, lists), end


def _walk(cells: _Bytes | _Words, element: Element, at: int) -> tuple[Places, Places, int]:
    """Find where each property of each row begins, (rows, properties) places, and how long each list is."""
    starts, counts, end = _walk_rows(cells, element, at, min(element.count, 1))

    # Nearly always all rows are like the first; if not, they have to be looked at one after another.
    row = end - at
    all_end = at + row * element.count
    if all_end > len(cells):
        return _walk_rows(cells, element, at, element.count)
    all_starts = starts + row * np.arange(element.count)[:, None]
    for index, prop in enumerate(element.properties):
        if prop.count and np.any(cells.take(prop.count, all_starts[:, index]) != counts[:, index]):
            return _walk_rows(cells, element, at, element.count)
    return all_starts, np.broadcast_to(counts, all_starts.shape), all_end


def _walk_rows(cells: _Bytes | _Words, element: Element, at: int, rows: int) -> tuple[Places, Places, int]:
    """Walk through the first rows of an element; raises IndexError or ValueError where that leads out of the file."""
    steps = [(prop.count, cells.size(prop.count or prop.kind), cells.size(prop.kind)) for prop in element.properties]
    starts: list[int] = []
    counts: list[int] = []
    for _ in range(rows):
        for count_kind, head, size in steps:
            starts.append(at)
            length = cells.count(count_kind, at) if count_kind else 0
            if length < 0:
                raise ValueError
            counts.append(length)
            at += head + length * size
    if at > len(cells):
        raise IndexError
    shape = (rows, len(steps))
    return np.array(starts, dtype=np.int64).reshape(shape), np.array(counts, dtype=np.int64).reshape(shape), at
