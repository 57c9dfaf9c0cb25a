"""Reports as JSON files."""

import json
from pathlib import Path
from typing import Any

from aoprecalc.errors import OutputError


def report_text(report: dict[str, Any]) -> str:
    """Lay a report out as JSON that people can read too."""
    return json.dumps(report, indent=2, allow_nan=False, ensure_ascii=False) + "\n"


def write_report(path: Path, report: dict[str, Any]) -> None:
    """Write a report; raises OutputError where the file cannot be written."""
    try:
        path.write_text(report_text(report), encoding="utf-8")
    except OSError as error:
        raise OutputError(f"{path}: cannot be written ({error.strerror}); choose another output") from error
