"""Quantities as people write them, on the command line and in manifests."""

import re

from aoprecalc.errors import UsageError


def read_size(text: str) -> tuple[int, int]:
    """Read a texture's size, `1024` or `2048x1024`, as (width, height). Raises UsageError."""
    match = re.fullmatch(r"(\d{1,9})(?:[xX](\d{1,9}))?", text.strip())
    if match is None:
        raise UsageError(f"{text!r} is not a size; expected a number of texels such as 1024, or 2048x1024")
    return int(match[1]), int(match[2] or match[1])


def read_levels(text: str) -> tuple[int, ...]:
    """Read numbers of spheres, such as 8,32,128. Raises UsageError."""
    if not re.fullmatch(r"\s*\d{1,9}\s*(,\s*\d{1,9}\s*)*", text):
        raise UsageError(f"{text!r} are no numbers of spheres; expected some such as 8,32,128")
    return tuple(int(number) for number in text.split(","))


def read_bytes(text: str) -> int:
    """Read an amount such as 800M or 1.5G (or GB, GiB: all are powers of 1024), in bytes. Raises UsageError."""
    match = re.fullmatch(r"(\d{1,9}(?:\.\d{1,9})?)\s*([KMGT])(?:i?B)?", text.strip(), re.IGNORECASE)
    if match is None:
        raise UsageError(f"{text!r} is no amount of bytes; expected a number and K, M, G or T, such as 1.5G")
    return int(float(match[1]) * 1024 ** (1 + "KMGT".index(match[2].upper())))


def say_bytes(count: int) -> str:
    """Write an amount of bytes in the greatest of K, M, G and T that it is one of, such as 1.5G."""
    amount, unit = float(count), ""
    for larger in "KMGT":
        if amount < 1024:
            break
        amount, unit = amount / 1024, larger
    return f"{amount:.0f}{unit or ' bytes'}" if not unit or amount >= 100 else f"{amount:.3g}{unit}"


def read_shadow_size(text: str) -> int | None:
    """Read the side of a near/far map: a number of texels, or `auto`, which is None. Raises UsageError."""
    if text == "auto":
        return None
    if not re.fullmatch(r"\d{1,9}", text):
        raise UsageError(f"{text!r} is neither a number of texels nor auto")
    return int(text)


def read_days(text: str) -> float:
    """Read a time such as 12h, 30d or 8w, in days. Raises UsageError."""
    match = re.fullmatch(r"(\d{1,6}(?:\.\d{1,6})?)\s*([hdw])", text.strip(), re.IGNORECASE)
    if match is None:
        raise UsageError(f"{text!r} is no time; expected a number and h, d or w, such as 30d")
    return float(match[1]) * {"h": 1 / 24, "d": 1.0, "w": 7.0}[match[2].lower()]
