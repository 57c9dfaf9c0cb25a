"""Bakes with a greatest error (`--max-error`): how many directions they take, and the certificate of the texture.

A texture is baked with few directions, and measured; while its error is not certain to be small enough, with more. Of
the squared error as rendered, the part of sampling falls as N^-3/2 with N directions; the rest is of the resolution.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Generic, TypeVar

from aoprecalc.api.prepared_scene import PreparedScene
from aoprecalc.errors import ArgumentError
from aoprecalc.io.images import LOSSY_EXTENSIONS, stored
from aoprecalc.metrics.certificate import RenderedErrors, certify
from aoprecalc.options import BakeOptions, ValueOptions, VerifyOptions
from aoprecalc.types import CONFIDENCE, Atlas, Certificate, Float32Array
from aoprecalc.visibility.directions import DirectionPlan
from aoprecalc.visibility.integrand import Integrand

COUNTS = tuple(144 << power for power in range(8))  # nine groups of 8 to 1024 axes
_ERROR_OF_ONE = 0.45  # times N^-3/4 is the RMS sampling error as rendered; measured: 0.25 to 0.65
_FIRST_SHARE = 0.6  # of the greatest error, which sampling is to add to the first texture
_ENOUGH = 0.7  # of the greatest squared error: a texture of that can be certified, see `certify`
_LEAST = 0.05  # of it, for which directions are taken at once
_FAR = 2.0  # of it: where the resolution alone adds more, that is clear from one texture
_BAKE, _VERIFY = 0, 1  # first numbers of seeds
_MORE_POINTS = 2.0  # factor, when a certificate is confirmed: the bake may have had luck with few

_Made = TypeVar("_Made")


@dataclass(frozen=True)
class Attempt:
    """A texture that was measured: its number of directions, and its squared error as rendered."""

    directions: int
    squared_error: float


@dataclass(frozen=True, eq=False)
class Certified(Generic[_Made]):
    """The last of several attempts, its certificate, and all attempts: those before `first` had smaller sizes."""

    made: _Made
    certificate: Certificate
    attempts: tuple[Attempt, ...]
    first: int = 0

    @property
    def too_coarse(self) -> bool:
        """Whether the error is too great however many directions are taken."""
        return not self.certificate.holds and _too_coarse(self.attempts[self.first :], self.certificate.max_error)

    def warnings(self, options: BakeOptions) -> list[str]:
        """Return the line for the user where the error is too great, and what helps."""
        certificate, attempts = self.certificate, self.attempts[self.first :]
        if certificate.holds:
            return []
        found = f"as rendered, {certificate}; {certificate.max_error:g} was wanted"
        coarse = resolution_part(attempts)
        if coarse >= attempts[-1].squared_error / 2:
            larger = "a larger --size" if options.size == "auto" else "a larger --size, or auto"
            return [f"{found}: the resolution alone adds about {math.sqrt(coarse):.4f}; use {larger}, or new UVs"]
        return [f"{found}: {attempts[-1].directions} directions are not enough; allow more --directions"]


def until_certain(
    make: Callable[[DirectionPlan], _Made],
    measure: Callable[[_Made, float, int], Certificate],
    max_error: float,
    counts: Sequence[int],
    *,
    doubt: float = 1 - CONFIDENCE,
    before: Sequence[Attempt] = (),
) -> Certified[_Made]:
    """Make textures with more and more directions until the error of one is certain to be small enough, or hopeless.

    make      a texture
    measure   certify a texture with a confidence; the second number counts attempts
    counts    of directions that may be taken, see `direction_counts`
    doubt     1 - the confidence that all certificates together are right
    before    attempts with smaller sizes: the first texture takes as many directions as the last of them
    """
    attempts: list[Attempt] = []
    need = before[-1].directions if before else _first_need(max_error)
    count = next((count for count in counts if count >= need), counts[-1])
    while True:
        made = make(DirectionPlan(count, count >= COUNTS[0]))
        number = len(before) + len(attempts)
        certificate = replace(measure(made, 1 - doubt * 0.5 ** (number + 1), number), confidence=CONFIDENCE)
        attempts.append(Attempt(count, certificate.error**2))
        more = None if certificate.holds else next_count(attempts, counts, max_error)
        if more is None:
            return Certified(made, certificate, (*before, *attempts), len(before))
        del made  # before the next one takes memory
        count = more


def next_count(attempts: Sequence[Attempt], counts: Sequence[int], max_error: float) -> int | None:
    """Return how many directions the next texture takes; None where no more may be taken, or would not help."""
    more = [count for count in counts if count > attempts[-1].directions]
    if not more or _too_coarse(attempts, max_error):
        return None
    last, target = attempts[-1], max_error**2
    coarse = resolution_part(attempts)
    left = max(_ENOUGH * target - coarse, _LEAST * target)
    need = last.directions * math.pow((last.squared_error - coarse) / left, 2 / 3)
    return next((count for count in more if count >= need), more[-1])


def resolution_part(attempts: Sequence[Attempt]) -> float:
    """Return the part of the squared error of textures of one size that no number of directions removes."""
    last = attempts[-1]
    if len(attempts) == 1:
        return max(last.squared_error - _ERROR_OF_ONE**2 * math.pow(last.directions, -1.5), 0.0)
    before = attempts[-2]
    ratio = math.pow(last.directions / before.directions, 1.5)
    found = (ratio * last.squared_error - before.squared_error) / (ratio - 1)
    return min(max(found, 0.0), last.squared_error)


def _too_coarse(attempts: Sequence[Attempt], max_error: float) -> bool:
    limit = _FAR if len(attempts) == 1 else _ENOUGH
    return resolution_part(attempts) >= limit * max_error**2


def _first_need(max_error: float) -> float:
    """Return the number of directions at which the sampling error is a share of the greatest error."""
    return math.pow(_ERROR_OF_ONE / (_FIRST_SHARE * max_error), 4 / 3)


def direction_counts(options: BakeOptions) -> tuple[int, ...]:
    """Return the numbers of directions that a bake may take, ascending; `directions` is the most, if it is given."""
    if options.directions is None:
        return COUNTS
    return (*(count for count in COUNTS if count < options.directions), options.directions)


def certify_texture(
    prepared: PreparedScene,
    atlas: Atlas,
    texture: Float32Array,
    options: BakeOptions,
    max_error: float,
    *,
    confidence: float,
    attempt: int,
) -> Certificate:
    """Certify a texture of a bake, (h, w) float32, as it is stored: with 8 bits, unless the options say more."""
    values = stored(texture, "8" if options.bit_depth == "auto" else options.bit_depth)
    integrand, seed = Integrand.from_options(options, prepared.scene), (_BAKE, options.seed, attempt)
    errors = RenderedErrors(prepared.scene, prepared.normals, atlas, values, integrand, seed, options.threads)
    return certify(errors, max_error, confidence=confidence, seed=options.seed)


def confirm(
    claimed: Certificate,
    prepared: PreparedScene,
    atlas: Atlas,
    texture: Float32Array,
    value: ValueOptions,
    options: VerifyOptions,
) -> Certificate:
    """Certify a texture, (h, w) float32, again, at other points than its bake did; `value` are the options of that."""
    integrand, seed = Integrand.from_options(value, prepared.scene), (_VERIFY, options.seed)
    errors = RenderedErrors(prepared.scene, prepared.normals, atlas, texture, integrand, seed, options.threads)
    return certify(errors, claimed.max_error, seed=options.seed, effort=_MORE_POINTS)


def check_lossless(path: Path, options: BakeOptions) -> None:
    """Raise UsageError for a picture that changes the values of which the error is to be certain."""
    if options.max_error is not None and path.suffix.lower() in LOSSY_EXTENSIONS:
        found = f"is {options.max_error:g}, but {path} is written with losses that are not measured"
        raise ArgumentError("max_error", f"{found}; write a .png, or omit it")


def shows_as_measured(options: BakeOptions, picture: Path) -> bool:
    """Tell whether a mesh shows the values of a picture that were certified: not scaled, nor with fewer bits."""
    exact = options.bit_depth in ("auto", "8") or picture.suffix.lower() == ".png"
    return exact and options.pack == "none"
