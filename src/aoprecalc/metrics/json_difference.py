"""How far apart two documents of plain JSON values are."""

import math
from collections.abc import Iterator
from typing import Any

from aoprecalc.metrics.difference import Difference, rounded

# What is another on another machine, or at another time, and says nothing about the result.
IGNORED = frozenset({"seconds", "version", "renderer", "path", "outputs"})
_SHOWN = 10  # of the places that differ

_MISSING = object()


def document_difference(first: Any, second: Any) -> Difference:
    """Compare documents leaf by leaf, but for what is under the keys of IGNORED.

    The value is the greatest |a - b| / max(1, |a|, |b|) of two numbers. Whatever else differs, such as texts, keys and
    the lengths of lists, has no number and leaves the whole without one.
    """
    numbers, value, places, others = 0, 0.0, [], []
    for at, one, other in _leaves(first, second):
        apart = _apart(one, other)
        numbers += _is_number(one) and _is_number(other)
        if apart != 0:
            value = max(value, apart or 0.0)
            places.append({"at": at, "a": _shown(one), "b": _shown(other)})
            others += [at] if apart is None else []
    details = {"numbers": numbers, "differing": len(places), "value": rounded(value), "places": places[:_SHOWN]}
    if others:
        found = "1 place differs" if len(others) == 1 else f"{len(others)} places differ"
        return Difference(None, reason=f"{found} in more than a number, the first at {others[0]}", details=details)
    return Difference(value, equal=not places, details=details)


def _leaves(first: Any, second: Any) -> Iterator[tuple[str, Any, Any]]:
    """Yield the place of each leaf and what either document has there, in the first's order.

    Lists of different lengths, and what only one document has, count as leaves.
    """
    left: list[tuple[str, Any, Any]] = [("", first, second)]  # a stack, as documents may be nested deeply
    while left:
        at, one, other = left.pop()
        if isinstance(one, dict) and isinstance(other, dict):
            keys = [key for key in {**one, **other} if key not in IGNORED]
            below = [(f"{at}.{key}".lstrip("."), one.get(key, _MISSING), other.get(key, _MISSING)) for key in keys]
            left += reversed(below)
        elif isinstance(one, list) and isinstance(other, list) and len(one) == len(other):
            left += reversed([(f"{at}[{number}]", *both) for number, both in enumerate(zip(one, other, strict=True))])
        else:
            yield at, one, other


def _apart(one: Any, other: Any) -> float | None:
    """Return how far two leaves are apart; None where they are not the same and no number can tell."""
    if _is_number(one) and _is_number(other):
        if one == other:
            return 0.0
        try:
            apart = abs(one - other) / max(1, abs(one), abs(other))
        except OverflowError:  # whole numbers may have any number of digits
            return None
        return float(apart) if math.isfinite(apart) else None
    return 0.0 if type(one) is type(other) and one == other else None


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _shown(value: Any) -> Any:
    """Return a leaf as a report shows it: containers by their size, and what is not there as None."""
    if value is _MISSING:
        return None
    if isinstance(value, dict | list):
        return f"{len(value)} {'keys' if isinstance(value, dict) else 'values'}"
    if isinstance(value, str):
        return value if len(value) <= 80 else f"{value[:77]}..."
    return value
