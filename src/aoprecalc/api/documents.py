"""What every report is made of: documents that become JSON, and the errors of a texture against ray tracing.

Numbers are rounded as the documents show them.
"""

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field, fields
from typing import Any

from aoprecalc import __version__
from aoprecalc.metrics.errors import TextureErrors
from aoprecalc.options import ValueOptions
from aoprecalc.types import Certificate

OMIT_NONE = {"omit_none": True}  # metadata of a field that the document lacks where it is None


@dataclass(frozen=True)
class Report:
    """A part of a report, or all of it."""

    def to_dict(self) -> dict[str, Any]:
        """Return the JSON document: dicts, lists, strings, numbers, booleans and None.

        Returns
        -------
        dict
            What the command line writes with ``--report`` or prints with ``--json``.
        """
        document = {}
        for entry in fields(self):
            value = getattr(self, entry.name)
            if value is not None or not entry.metadata.get("omit_none"):
                document[entry.metadata.get("key", entry.name)] = _plain(value)
        return document


def _plain(value: Any) -> Any:
    if isinstance(value, Report):
        return value.to_dict()
    if isinstance(value, ValueOptions):
        return _plain(asdict(value))
    if isinstance(value, tuple | list):
        return [_plain(entry) for entry in value]
    if isinstance(value, dict):
        return {key: _plain(entry) for key, entry in value.items()}
    return value


@dataclass(frozen=True)
class Document(Report):
    """A whole report: the schema of its JSON document, and the version of aoprecalc that made it."""

    schema: int = field(kw_only=True)
    version: str = field(default=__version__, kw_only=True)


@dataclass(frozen=True)
class LevelErrors(Report):
    """Texture minus reference at one mip level, both ambient occlusion in [0, 1].

    level           0 is full resolution
    rmse, bias      root mean square, and mean (positive where the texture is too bright)
    p50 to max      percentiles of the absolute error, and its greatest value
    """

    level: int
    rmse: float
    bias: float
    p50: float
    p95: float
    p99: float
    max: float


_DIGITS, _MAX_DIGITS = 4, 15  # of a coordinate: over the extent of the points, and at most


@dataclass(frozen=True)
class PointError(Report):
    """One surface point: position in the mesh's units, UV (v upwards), texture value, reference, their difference."""

    position: tuple[float, float, float]
    uv: tuple[float, float]
    value: float
    reference: float
    error: float


def position_texts(points: Sequence[PointError]) -> list[tuple[str, ...]]:
    """Return the coordinates of points in digits that tell their places apart, also far away from the origin."""
    columns = list(zip(*(point.position for point in points), strict=True))
    extent = max((max(column) - min(column) for column in columns), default=0.0)
    farthest = max((abs(number) for column in columns for number in column), default=0.0)
    digits = _DIGITS
    if 0 < extent < farthest:
        digits = min(_DIGITS + math.ceil(math.log10(farthest / extent)), _MAX_DIGITS)
    elif len(points) == 1:
        digits = _MAX_DIGITS
    return [tuple(f"{number:.{digits}g}" for number in point.position) for point in points]


@dataclass(frozen=True)
class ErrorCertificate(Report):
    """How sure it is that the RMS error of a texture, as rendered, is at most a bound; in units of ambient occlusion.

    certified   the bound is at most `max_error`
    max_error   that was asked for
    error       as measured, without the noise of the rays
    bound       the error is at most this, with the confidence
    confidence  least probability, 0 to 1, that the bound is right
    points      on the surface, to which the texture was not fitted; rays: from each
    seed        of both
    """

    certified: bool
    max_error: float
    error: float
    bound: float
    confidence: float
    points: int
    rays: int
    seed: int

    @classmethod
    def of(cls, certificate: Certificate | None) -> "ErrorCertificate | None":
        """Return what a document has of a certificate, if there is one."""
        return None if certificate is None else cls(certificate.holds, **asdict(certificate))

    def __str__(self) -> str:
        values = asdict(self)
        del values["certified"]
        return str(Certificate(**values))


@dataclass(frozen=True)
class RayTracedErrors(Report):
    """Errors at points uniform on the surface, against rays from each: per mip level, and the worst points."""

    points: int
    rays: int
    levels: tuple[LevelErrors, ...]
    worst: tuple[PointError, ...]

    @classmethod
    def of(cls, verified: TextureErrors) -> "RayTracedErrors":
        """Return rounded errors."""
        levels = [
            LevelErrors(level, **{name: round(value, 6) for name, value in asdict(errors).items()})
            for level, errors in enumerate(verified.levels)
        ]
        worst = [
            PointError(
                point.position,
                (round(point.uv[0], 6), round(point.uv[1], 6)),
                *(round(number, 6) for number in (point.value, point.reference, point.error)),
            )
            for point in verified.worst
        ]
        return cls(verified.points, verified.rays, tuple(levels), tuple(worst))
