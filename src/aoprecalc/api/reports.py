"""The report of a verification, as one JSON document."""

from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from aoprecalc import __version__
from aoprecalc.io import OcclusionTexture
from aoprecalc.io.outputs import SCHEMAS
from aoprecalc.mesh.topology import topology
from aoprecalc.metrics.errors import ErrorStatistics, TextureErrors, WorstPoint
from aoprecalc.options import BakeOptions, VerifyOptions
from aoprecalc.types import Atlas, Baked, Part, Scene, UvCheck
from aoprecalc.uv.gutter import first_unsafe_mip


def verify_report(
    scene: Scene,
    atlas: Atlas,
    found: OcclusionTexture,
    verified: TextureErrors,
    options: VerifyOptions,
    places: dict[str, Path],
    seconds: dict[str, float],
    warnings: tuple[str, ...],
) -> dict[str, Any]:
    """Return the report; every value is a plain JSON value, and only `seconds` differs between equal runs."""
    height, width = found.values.shape
    return {
        "schema": SCHEMAS["verify"],
        "version": __version__,
        "input": {"path": str(scene.path), "triangles": len(scene.faces)},
        "texture": {
            "path": found.name,
            "width": width,
            "height": height,
            "triangles": int(np.count_nonzero(atlas.mapped)),
            "charts": atlas.charts,
            "repeats": atlas.repeats,
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


def verified_report(verified: TextureErrors) -> dict[str, Any]:
    """Return what was measured, for a report of any job."""
    return {
        "points": verified.points,
        "rays": verified.rays,
        "levels": [_errors(number, errors) for number, errors in enumerate(verified.levels)],
        "worst": [_place(place) for place in verified.worst],
    }


def _errors(level: int, errors: ErrorStatistics) -> dict[str, Any]:
    return {"level": level, **{name: round(value, 6) for name, value in asdict(errors).items()}}


def _place(place: WorstPoint) -> dict[str, Any]:
    return {
        "position": list(place.position),
        "uv": [round(number, 6) for number in place.uv],
        "value": round(place.value, 6),
        "reference": round(place.reference, 6),
        "error": round(place.error, 6),
    }


# The report of a bake: what was read, chosen and measured, as one JSON document.


def bake_report(
    baked: Baked,
    options: BakeOptions,
    places: dict[str, Path],
    files: list[Path],
    verified: TextureErrors | None,
    seconds: dict[str, float],
    warnings: tuple[str, ...],
) -> dict[str, Any]:
    """Return the report; every value is a plain JSON value, and only `seconds` differs between equal runs."""
    scene, atlas, texture = baked.scene, baked.atlas, baked.texture
    shape = topology(scene.faces)
    values = texture.values[texture.valid]
    return {
        "schema": SCHEMAS["bake"],
        "version": __version__,
        "input": {
            "path": str(scene.path),
            "triangles": len(scene.faces),
            "vertices": len(scene.positions),
            "components": shape.components,
            "watertight": shape.watertight,
        },
        "parts": [_part(part) for part in scene.parts],
        "outputs": {**{name: str(path) for name, path in places.items()}, "others": _others(places, files)},
        "renderer": baked.renderer,
        "backend": baked.backend,
        "directions": baked.directions,
        "estimated_error": None if baked.sampling_error is None else round(baked.sampling_error, 6),
        "sampling": options.sampling,
        "estimator": options.estimator,
        "two_sided": options.two_sided,
        "floor": scene.ground_normal,
        "shadow_size": baked.shadow_size,
        "unwrap": {
            "method": atlas.method,
            "uv_set": atlas.uv_set,
            "checks": [_check(check) for check in atlas.checks],
            "charts": atlas.charts,
            "used_share": round(float(np.count_nonzero(texture.valid)) / texture.valid.size, 4),
            "gutter": atlas.gutter,
            "first_unsafe_mip": None if atlas.gutter is None else first_unsafe_mip(atlas.gutter, options.padding),
        },
        "texels": {"width": options.width, "height": options.height, "valid": int(np.count_nonzero(texture.valid))},
        "ao": {
            "mean": round(float(values.mean(dtype=np.float64)), 6),
            "min": round(float(values.min()), 6),
            "max": round(float(values.max()), 6),
            "unseen_share": round(baked.occluded_share, 6),
        },
        "verify": None if verified is None else verified_report(verified),
        "seconds": seconds,
        "warnings": list(warnings),
    }


def _others(places: dict[str, Path], files: list[Path]) -> list[str]:
    """Return the files beside the named places that go with them (.mtl, .bin, images), as they were named."""
    named = {path.resolve() for path in places.values()}
    folder = places["mesh"].parent
    return sorted(str(folder / file.name) for file in files if file not in named)


def _part(part: Part) -> dict[str, Any]:
    return {
        "name": part.name,
        "triangles": part.stop - part.start,
        "receives": part.receives,
        "occludes": part.occludes,
        "shares": part.uv_owner,
        "glass": part.material.transparent,
        "unlit": part.material.unlit,
        "cut_out": part.material.alpha_mask is not None,
    }


def _check(check: UvCheck) -> dict[str, Any]:
    found = asdict(check)
    return found if check.overlap is None else found | {"overlap": round(check.overlap, 6)}
