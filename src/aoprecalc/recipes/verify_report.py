"""The report of a verification, as one JSON document."""

from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from aoprecalc import __version__
from aoprecalc.files import OcclusionPicture
from aoprecalc.measure.errors import Errors, Place, Verified
from aoprecalc.model import Atlas, Scene
from aoprecalc.options import VerifyOptions

SCHEMA = 1


def verify_report(
    scene: Scene,
    atlas: Atlas,
    found: OcclusionPicture,
    verified: Verified,
    options: VerifyOptions,
    places: dict[str, Path],
    seconds: dict[str, float],
    warnings: tuple[str, ...],
) -> dict[str, Any]:
    """Return the report; every value is a plain JSON value, and only `seconds` differs between equal runs."""
    height, width = found.values.shape
    return {
        "schema": SCHEMA,
        "version": __version__,
        "input": {"path": str(scene.path), "triangles": len(scene.faces)},
        "texture": {
            "path": found.name,
            "width": width,
            "height": height,
            "triangles": int(np.count_nonzero(atlas.covers)),
            "charts": atlas.charts,
            "repeats": atlas.wraps,
        },
        "outputs": {name: str(path) for name, path in places.items()},
        "seed": options.seed,
        "estimator": options.estimator,
        "two_sided": options.two_sided,
        **verified_report(verified),
        "tolerance": options.tolerance,
        "passed": options.tolerance is None or verified.levels[0].rmse <= options.tolerance,
        "seconds": seconds,
        "warnings": list(warnings),
    }


def verified_report(verified: Verified) -> dict[str, Any]:
    """Return what was measured, for a report of any job."""
    return {
        "points": verified.points,
        "rays": verified.rays,
        "levels": [_errors(number, errors) for number, errors in enumerate(verified.levels)],
        "worst": [_place(place) for place in verified.worst],
    }


def _errors(level: int, errors: Errors) -> dict[str, Any]:
    return {"level": level, **{name: round(value, 6) for name, value in asdict(errors).items()}}


def _place(place: Place) -> dict[str, Any]:
    return {
        "position": list(place.position),
        "uv": [round(number, 6) for number in place.uv],
        "value": round(place.value, 6),
        "reference": round(place.reference, 6),
        "error": round(place.error, 6),
    }
