"""The size of a texture and its UVs, which depend on each other: gutters are in texels, and so is a density.

`--size auto` is `--size N` for the smallest power of two that does, and then the bake is the same to the byte; with a
`--target-error` the directions have what the resolution leaves of it.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from aoprecalc.api.prepared_scene import PreparedScene
from aoprecalc.errors import ArgumentError, RendererError
from aoprecalc.mesh.detail import detail_of
from aoprecalc.mesh.surface import area_vectors
from aoprecalc.metrics.resolution import resolution_error
from aoprecalc.options import BakeOptions
from aoprecalc.progress import Progress
from aoprecalc.types import Atlas, Scene, SizeEstimates
from aoprecalc.uv.checks import RasterizerFactory, TexelDensity, needs_uvs
from aoprecalc.uv.fill import LARGEST_PAGE, FirstLook, TooDenseError, next_power_of_two, rounded_down
from aoprecalc.uv.pack import NoRoomError
from aoprecalc.uv.unwrap import Cuts, choose_atlas
from aoprecalc.visibility.backend import Backend
from aoprecalc.visibility.dark_texels import first_look
from aoprecalc.visibility.directions import MAX_SHADOW_SIZE
from aoprecalc.visibility.integrand import Integrand
from aoprecalc.visibility.plan import texels_per_chunk
from aoprecalc.visibility.rays import embreex_problem

SIZES = tuple(1 << power for power in range(6, 14))  # 64 to 8192
DEFAULT_ERROR = 0.005  # of resolution; a step of 8 bits is 0.004
_FIRST_TRY = 512
_STEPS = 2  # powers of two by which the next try may differ
_NO_ERROR = 1e-9


@dataclass(frozen=True, eq=False)
class ChosenTexture:
    """The size of a texture and its UVs.

    options     of the bake, with the size, and the target that is left for the sampling error
    atlas       the UVs
    estimates   the errors that were estimated for sizes, if any
    warnings    lines for the user
    """

    options: BakeOptions
    atlas: Atlas
    estimates: SizeEstimates = ()
    warnings: tuple[str, ...] = ()


def choose_texture(
    backend: Backend, prepared: PreparedScene, options: BakeOptions, progress: Progress
) -> ChosenTexture:
    """Choose the size of a texture, unless it is given, and its UVs.

    Raises UsageError where the density of texels that is asked for is impossible, with what is possible, and what
    `choose_atlas` raises; RendererError where errors cannot be estimated.
    """
    scene, normals = prepared.scene, prepared.normals
    look = partial(first_look, backend, scene, normals, options)
    if options.size != "auto":
        return ChosenTexture(options, _atlas_of_size(backend.rasterizer, scene, options, progress, look))
    sizes = [size for size in SIZES if _has_room(size, backend, scene, options)]
    if not sizes:  # which says what is too low
        return choose_texture(backend, prepared, replace(options, size=SIZES[0]), progress)
    tries = _Tries(partial(choose_atlas, backend.rasterizer, scene), options, progress, look)
    if options.texel_density is not None:
        size, atlas = _by_density(scene, tries, sizes, options.texel_density)
        reached = TexelDensity.of(scene, atlas, size, size).mean
        what = "the file's own UVs have" if atlas.method == "keep" else "all charts have"
        progress.note(f"size {size}: {what} {reached:.4g} texels per unit, {options.texel_density:g} were wanted")
        return ChosenTexture(replace(options, size=size), atlas)
    if (problem := embreex_problem()) is not None:
        raise RendererError(f"--size auto compares with ray tracing: {problem}; or use a number, or --texel-density")

    def error_at(size: int) -> float:
        try:
            atlas = tries.atlas(size)
        except ArgumentError as error:
            if isinstance(error.__cause__, NoRoomError):
                return math.inf
            raise
        progress.step(f"estimating the error at {size} x {size}")
        return resolution_error(scene, normals, atlas, (size, size), integrand, options.threads)

    integrand = Integrand.from_options(options, scene)
    target = resolution_target(options)
    size, errors = smallest_size(sizes, error_at, target)
    atlas, error = tries.atlas(size), errors[size]
    added = f"size {size}: the resolution adds an estimated error of {error:.4f}"
    progress.note(f"{added}, at most {target:.4f} was wanted")
    warnings = [] if error <= target else [f"{added}, more than the {target:.4f} that was wanted: it is the largest"]
    left = options.target_error
    if left is not None:
        left = math.sqrt(left**2 - error**2) if error < left else target
    estimates = tuple(sorted((tried, found) for tried, found in errors.items() if math.isfinite(found)))
    return ChosenTexture(replace(options, size=size, target_error=left), atlas, estimates, tuple(warnings))


def next_size(chosen: ChosenTexture, backend: Backend, scene: Scene, options: BakeOptions) -> int | None:
    """Return the next greater size that `auto` may take; None where there is none, or a density decides."""
    if options.size != "auto" or options.texel_density is not None:
        return None
    larger = (size for size in SIZES if size > chosen.options.width and _has_room(size, backend, scene, options))
    return next(larger, None)


def resolution_target(options: BakeOptions) -> float:
    """Return the greatest error that the resolution may add: half of the squared error that is asked for.

    A quarter of that of `max_error`, which is to be certain.
    """
    if options.max_error is not None:
        return options.max_error / 2
    return DEFAULT_ERROR if options.target_error is None else options.target_error / math.sqrt(2)


class _Tries:
    """The UVs for textures of several sizes; charts are cut once."""

    def __init__(
        self, choose: Callable[..., Atlas], options: BakeOptions, progress: Progress, first_look: FirstLook
    ) -> None:
        """Keep what `choose`, which is `choose_atlas` for a backend and a scene, needs besides a size."""
        self._choose, self._options, self._progress, self._first_look = choose, options, progress, first_look
        self._cuts: Cuts = {}
        self._atlases: dict[int, Atlas] = {}

    def atlas(self, size: int) -> Atlas:
        """Return the UVs for a square texture; see `choose_atlas`."""
        if size not in self._atlases:
            progress = _StepsOf(self._progress) if self._cuts or self._atlases else self._progress
            sized = replace(self._options, size=size)
            self._atlases[size] = self._choose(sized, progress, self._first_look, self._cuts)
        return self._atlases[size]


class _StepsOf(Progress):
    """Passes steps on, and no lines that would be told again."""

    def __init__(self, progress: Progress) -> None:
        self._progress = progress

    def step(self, text: str) -> None:
        """Pass it on."""
        self._progress.step(text)


def smallest_size(sizes: list[int], error_at: Callable[[int], float], target: float) -> tuple[int, dict[int, float]]:
    """Return the smallest of ascending sizes whose error is at most the target, the largest if none is, and all errors.

    The error falls about as 1 / size, from which the next try is guessed.
    """
    errors: dict[int, float] = {}
    low, high = 0, len(sizes) - 1
    at = min(sum(size < _FIRST_TRY for size in sizes), high)
    while low < high:
        error = errors[sizes[at]] = error_at(sizes[at])
        low, high = (low, at) if error <= target else (at + 1, high)
        steps = math.log2(max(error, _NO_ERROR) / max(target, _NO_ERROR)) if math.isfinite(error) else 1.0
        at = min(max(at + math.ceil(min(max(steps, -_STEPS), _STEPS)), low), high - 1)
    if sizes[high] not in errors:
        errors[sizes[high]] = error_at(sizes[high])
    return sizes[high], errors


def _by_density(scene: Scene, tries: _Tries, sizes: list[int], density: float) -> tuple[int, Atlas]:
    """Return the smallest size at which all charts have a density, or kept UVs have at least that, and its UVs."""
    surface = np.linalg.norm(area_vectors(scene.corners[needs_uvs(scene)]), axis=1).sum() / 2
    refusal: TooDenseError | ArgumentError | None = None
    for size in [size for size in sizes if size >= density * math.sqrt(surface)] or sizes[-1:]:
        try:
            atlas = tries.atlas(size)
        except (TooDenseError, ArgumentError) as error:
            if isinstance(error, ArgumentError) and not isinstance(error.__cause__, NoRoomError):
                raise
            refusal = error
            continue
        if atlas.method != "keep":
            return size, atlas
        of_one = TexelDensity.of(scene, atlas, 1, 1).mean
        enough = [other for other in sizes if other * of_one >= density]
        if enough:
            return enough[0], tries.atlas(enough[0])
        most = rounded_down(of_one * sizes[-1])
        found = f"is {density:g}, but the file's own UVs have {most} at {sizes[-1]} x {sizes[-1]}, the largest size"
        raise ArgumentError("texel_density", f"{found}; use a lower one, or {{unwrap}} xatlas for new UVs", "unwrap")
    assert refusal is not None
    raise refusal.advice() if isinstance(refusal, TooDenseError) else refusal


def _atlas_of_size(
    make_rasterizer: RasterizerFactory, scene: Scene, options: BakeOptions, progress: Progress, first_look: FirstLook
) -> Atlas:
    """Return the UVs for a texture of the size that `options` name; see `choose_texture`."""
    try:
        atlas = choose_atlas(make_rasterizer, scene, options, progress, first_look)
    except TooDenseError as error:
        raise error.advice() from error
    if options.texel_density is not None and atlas.method == "keep":
        raise _kept_density(scene, atlas, options, options.texel_density)
    return atlas


def _kept_density(scene: Scene, atlas: Atlas, options: BakeOptions, wanted: float) -> ArgumentError:
    """Return the error that tells the density of the file's UVs, and the size at which it is what is asked for."""
    size = max(options.width, options.height)
    density = TexelDensity.of(scene, atlas, options.width, options.height).mean
    found = f"is {wanted:g}, but the file's own UVs have {rounded_down(density)} at {options.width} x {options.height}"
    needed = next_power_of_two(size * wanted / density) if wanted / density <= LARGEST_PAGE / size else None
    without = f"use a {{size}} of {needed} without it" if needed else "omit it"
    return ArgumentError("texel_density", f"{found}; {without}, or {{unwrap}} xatlas for new UVs", "unwrap", "size")


def _has_room(size: int, backend: Backend, scene: Scene, options: BakeOptions) -> bool:
    """Tell whether a texture of this size is within the limits of the renderer and of memory, however full it is."""
    sized = replace(options, size=size)
    shadow_size = options.shadow_size or MAX_SHADOW_SIZE
    detail = detail_of(scene)
    try:
        backend.check_size(sized)
        texels_per_chunk(
            options.memory_limit,
            "",
            size**2,
            size**2,
            shadow_size,
            len(scene.faces) + (0 if detail is None else len(detail.scene.faces)),
            vectors=options.bent_normals,
            interleaved=options.interleaves and backend.kind == "ray",
        )
    except ArgumentError:
        return False
    return True
