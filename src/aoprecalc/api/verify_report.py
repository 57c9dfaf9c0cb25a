"""The report of a verification: what was measured, and whether it passes."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from aoprecalc.api.documents import (
    OMIT_NONE,
    Document,
    ErrorCertificate,
    LevelErrors,
    PointError,
    RayTracedErrors,
    Report,
)
from aoprecalc.api.textured_surface import TexturedSurface
from aoprecalc.io.outputs import SCHEMAS
from aoprecalc.metrics.errors import TextureErrors
from aoprecalc.options import ValueOptions, VerifyOptions
from aoprecalc.progress import notes_of, warnings_of
from aoprecalc.types import Certificate


@dataclass(frozen=True)
class VerifiedMesh(Report):
    """The mesh whose texture was measured."""

    path: str
    triangles: int


@dataclass(frozen=True)
class VerifiedTexture(Report):
    """The texture, and how many triangles and charts it covers; `repeats` where UVs leave [0, 1]."""

    path: str
    width: int
    height: int
    triangles: int
    charts: int
    repeats: bool


@dataclass(frozen=True)
class VerifyOutputs(Report):
    """Paths of the files that were written, if any."""

    heat_map: str | None = field(default=None, metadata=OMIT_NONE)
    report: str | None = field(default=None, metadata=OMIT_NONE)


@dataclass(frozen=True)
class VerifyReport(Document):
    """Error of an ambient-occlusion texture against ray tracing.

    Attributes
    ----------
    input : VerifiedMesh
    texture : VerifiedTexture
    outputs : VerifyOutputs
    seed : int
        As in `VerifyOptions`.
    options : ValueOptions
        What the texture was held to: the options that were given, else those of its bake, else the defaults.
    options_from : str or None
        The picture, or the mesh around it, that told the options of the bake; None where nothing did.
    points, rays : int
        Points on the surface, and rays from each.
    levels : tuple of LevelErrors
        Errors per mip level, full resolution first.
    worst : tuple of PointError
        The points of greatest error at full resolution, the worst first.
    certificate : ErrorCertificate or None
        The one of the bake, as the texture or the glTF file around it says, measured again at other points: it is
        confirmed if `certified`. None where there is none, or other options were given than those of the bake.
    tolerance : float or None
        Greatest RMS error that passes.
    passed : bool
        The RMS error at full resolution is at most `tolerance`, and the certificate, if there is one that was reached,
        is confirmed.
    seconds : dict of str to float
        Per stage, and ``"total"``.
    warnings : tuple of str
        What may need an action.
    notes : tuple of str
        Other lines about the result.
    """

    schema: int = field(default=SCHEMAS["verify"], kw_only=True)
    input: VerifiedMesh
    texture: VerifiedTexture
    outputs: VerifyOutputs
    seed: int
    options: ValueOptions
    options_from: str | None
    points: int
    rays: int
    levels: tuple[LevelErrors, ...]
    worst: tuple[PointError, ...]
    certificate: ErrorCertificate | None
    tolerance: float | None
    passed: bool
    seconds: dict[str, float]
    warnings: tuple[str, ...]
    notes: tuple[str, ...]

    @property
    def error(self) -> float:
        """RMS error at full resolution, in units of ambient occlusion."""
        return self.levels[0].rmse


def verify_report(
    surface: TexturedSurface,
    verified: TextureErrors,
    certificate: Certificate | None,
    options: VerifyOptions,
    outputs: VerifyOutputs,
    seconds: dict[str, float],
    messages: Sequence[str],
) -> VerifyReport:
    """Return the report of a texture that was measured; only `seconds` differs between equal runs."""
    scene, atlas, picture = surface.scene, surface.atlas, surface.picture
    height, width = picture.values.shape
    errors = RayTracedErrors.of(verified)
    mapped = int(np.count_nonzero(atlas.mapped))
    return VerifyReport(
        input=VerifiedMesh(str(scene.path), len(scene.faces)),
        texture=VerifiedTexture(picture.name, width, height, mapped, atlas.charts, repeats=atlas.repeats),
        outputs=outputs,
        seed=options.seed,
        options=surface.options,
        options_from=None if picture.options is None else picture.name,
        points=errors.points,
        rays=errors.rays,
        levels=errors.levels,
        worst=errors.worst,
        certificate=ErrorCertificate.of(certificate),
        tolerance=options.tolerance,
        passed=(options.tolerance is None or verified.levels[0].rmse <= options.tolerance)
        and (certificate is None or certificate.holds),
        seconds=seconds,
        warnings=warnings_of(messages),
        notes=notes_of(messages),
    )
