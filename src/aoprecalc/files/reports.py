"""Reports, and other documents, as JSON files."""

import json
import math
from pathlib import Path
from typing import Any

from aoprecalc.errors import InputError, OutputError


def report_text(report: dict[str, Any]) -> str:
    """Lay a report out as JSON that people can read too."""
    return json.dumps(report, indent=2, allow_nan=False, ensure_ascii=False) + "\n"


def write_report(path: Path, report: dict[str, Any]) -> None:
    """Write a report; raises OutputError where the file cannot be written."""
    try:
        path.write_text(report_text(report), encoding="utf-8")
    except OSError as error:
        raise OutputError(f"{path}: cannot be written ({error.strerror}); choose another output") from error


def read_document(path: Path) -> dict[str, Any]:
    """Read a JSON object whose numbers are finite.

    Raises InputError where the file is missing or holds something else.
    """
    try:
        document = json.loads(path.read_bytes(), parse_float=_finite, parse_constant=_finite)
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror}), a JSON file was expected") from error
    except (ValueError, RecursionError) as error:
        raise InputError(f"{path}: is not JSON ({' '.join(str(error).split())[:120]}); write it again") from error
    if not isinstance(document, dict):
        raise InputError(f"{path}: holds no JSON object; a report or a sphere set was expected")
    return document


def _finite(text: str) -> float:
    number = float(text)
    if not math.isfinite(number):
        raise ValueError(f"{text[:20]} is no finite number")
    return number
