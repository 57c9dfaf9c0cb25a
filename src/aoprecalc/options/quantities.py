"""Quantities: how the values of options are written as text, on command lines and in manifests."""

import re
from collections.abc import Callable
from dataclasses import dataclass
from math import inf, isfinite
from typing import Any

AUTO = "auto"  # a size that is chosen
NONE = "none"  # no limit


@dataclass(frozen=True)
class Quantity:
    """How a value is written as text.

    read       text -> value; raises ValueError for other text
    write      value -> text that `read` takes
    expected   what `read` takes, in words
    metavar    placeholder in `--help`
    """

    read: Callable[[str], Any]
    write: Callable[[Any], str]
    expected: str
    metavar: str


def _match(pattern: str, text: str) -> re.Match[str]:
    match = re.fullmatch(pattern, text.strip(), re.IGNORECASE)
    if match is None:
        raise ValueError(f"{text!r} does not match {pattern}")
    return match


def _read_size(text: str) -> tuple[int, int] | str:
    if text == AUTO:
        return text
    match = _match(r"(\d{1,9})(?:x(\d{1,9}))?", text)
    return int(match[1]), int(match[2] or match[1])


def _write_size(size: tuple[int, int] | str) -> str:
    if isinstance(size, str):
        return size
    width, height = size
    return str(width) if width == height else f"{width}x{height}"


def _read_count(text: str) -> int | None:
    return None if text == AUTO else int(_match(r"\d{1,9}", text)[0])


def _write_count(count: int | None) -> str:
    return AUTO if count is None else str(count)


def _read_levels(text: str) -> tuple[int, ...]:
    return tuple(int(count) for count in _match(r"\d{1,9}\s*(,\s*\d{1,9}\s*)*", text)[0].split(","))


def _read_vector(text: str) -> tuple[float, ...]:
    vector = tuple(float(number) for number in text.split(","))
    if len(vector) != 3 or not any(vector) or not all(map(isfinite, vector)):
        raise ValueError
    return vector


def _read_limit(text: str) -> float | str:
    return NONE if text.strip() == NONE else read_distance(text)


def read_distance(text: str) -> float | str:
    """Return a length above 0, or a share of the diagonal such as 10%; raises ValueError for other text."""
    share = text.strip().endswith("%")
    number = float(text.strip().removesuffix("%"))
    if not 0 < number < inf:
        raise ValueError
    return f"{repr(number).removesuffix('.0')}%" if share else number


def _read_bytes(text: str) -> int:
    match = _match(r"(\d{1,9}(?:\.\d{1,9})?)\s*([KMGT])(?:i?B)?", text)
    return int(float(match[1]) * 1024 ** (1 + "KMGT".index(match[2].upper())))


def _write_bytes(count: int) -> str:
    """Write an amount of memory in the smallest unit that `_read_bytes` takes, rounded up."""
    units = enumerate("KMGT", 1)
    return next(f"{whole}{unit}" for power, unit in units if (whole := -(-count >> 10 * power)) < 10**9)


def _read_days(text: str) -> float:
    match = _match(r"(\d{1,6}(?:\.\d{1,6})?)\s*([hdw])", text)
    return float(match[1]) * {"h": 1 / 24, "d": 1.0, "w": 7.0}[match[2].lower()]


SIZE = Quantity(_read_size, _write_size, "a number of texels such as 1024, or 2048x1024", "N|WxH")
TEXTURE_SIZE = Quantity(_read_size, _write_size, "a number of texels such as 1024, or 2048x1024, or auto", "N|WxH|auto")
SHADOW_SIZE = Quantity(_read_count, _write_count, "a number of texels, or auto", "N|auto")
DIRECTIONS = Quantity(_read_count, _write_count, "a whole number of directions, or auto", "N|auto")
LEVELS = Quantity(
    _read_levels, lambda levels: ",".join(map(str, levels)), "numbers of spheres such as 8,32,128", "N,N,..."
)
VECTOR = Quantity(
    _read_vector,
    lambda vector: ",".join(f"{number!r}" for number in vector),
    "three numbers, not all 0, such as 1,0.5,-2",
    "X,Y,Z",
)
LIMIT = Quantity(  # a distance, or none
    _read_limit,
    lambda distance: distance if isinstance(distance, str) else f"{distance!r}",
    "a length above 0, a share of the diagonal such as 10%, or none",
    "X|X%|none",
)
# K, M, G and T are powers of 1024; so are KB, KiB, ...
BYTES = Quantity(_read_bytes, _write_bytes, "an amount of memory with K, M, G or T, such as 1.5G", "SIZE")
AGE = Quantity(_read_days, lambda days: f"{days:g}d", "a time with h, d or w, such as 30d", "TIME")
