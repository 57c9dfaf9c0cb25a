"""Which UVs a bake uses: those of the file if they can hold a bake, else new ones."""

from collections.abc import Callable
from dataclasses import replace
from importlib.util import find_spec
from typing import Literal

import numpy as np

from aoprecalc.errors import AoprecalcError, ArgumentError, InputError, KilledError, counted, one_or_many, option_name
from aoprecalc.options import LARGE_MESH, BakeOptions, Unwrap
from aoprecalc.progress import Progress
from aoprecalc.raster.layout import MAX_TILES, Layout, atlas_from_uvs, build_layout
from aoprecalc.raster.samples import Rasterizer
from aoprecalc.types import Atlas, Scene, UvCheck
from aoprecalc.uv.unwrap import doubled_uv_areas, needs_uvs, unwrap

RasterizerFactory = Callable[[Layout], Rasterizer]
Unwrapper = Literal["xatlas", "uvunwrap"]

MAX_OVERLAP = 0.001  # share of covered texels that may lie inside two triangles


def choose_atlas(make_rasterizer: RasterizerFactory, scene: Scene, options: BakeOptions, progress: Progress) -> Atlas:
    """Keep the file's UVs if `options.unwrap` allows it and they can hold a bake, else unwrap.

    Raises InputError where `keep` is asked for and impossible, UsageError where an unwrapper is asked for that is not
    installed, AoprecalcError where the unwrapper fails or takes longer than `unwrap_timeout`.
    """
    checks = []
    if options.unwrap in ("auto", "keep"):
        for uv_set in range(len(scene.uv_sets)):
            check, kept = check_uvs(make_rasterizer, scene, uv_set, options.width, options.height)
            checks.append(check)
            if kept is not None:
                return replace(kept, checks=tuple(checks))
        faults = "; ".join(f"set {check.uv_set}: {check.fault}" for check in checks) or "it has none"
        if len(checks) == 1:
            faults = checks[0].fault
        if options.unwrap == "keep":
            raise InputError(f"{scene.path}: its UVs cannot hold a bake ({faults}); use --unwrap auto or xatlas")
        progress.note(f"the file's UVs are not kept: {faults}" if checks else "the file has no UVs")
    methods = _choose_unwrappers(options.unwrap, int(np.count_nonzero(needs_uvs(scene))), progress)
    size = min(options.width, options.height)

    def unwrap_with(method: Unwrapper) -> Atlas:
        timeout, on_step = options.unwrap_timeout, progress.step
        atlas = unwrap(scene, method, size, options.padding, timeout=timeout, on_step=on_step)
        return replace(atlas, checks=tuple(checks))

    try:
        return unwrap_with(methods[0])
    except KilledError:  # which says nothing about the mesh
        raise
    except AoprecalcError as error:
        if len(methods) == 1 or not isinstance(error.__cause__, ChildProcessError):
            raise
        progress.note(f"{methods[1]} is used instead: {error.worded(option_name)}")
        return unwrap_with(methods[1])


def _choose_unwrappers(wanted: Unwrap, faces: int, progress: Progress) -> list[Unwrapper]:
    """Return the unwrapper to use, and what to use if that fails by a fault of its own.

    Raises UsageError where the one that is asked for is not installed, or none is.
    """
    names: tuple[Unwrapper, ...] = ("xatlas", "uvunwrap")
    installed = [name for name in names if find_spec(name) is not None]
    if wanted == "xatlas" or wanted == "uvunwrap":
        if wanted in installed:
            return [wanted]
        other = "uvunwrap" if wanted == "xatlas" else "xatlas"
        raise ArgumentError("unwrap", f"is {wanted}, which is not installed; `pip install {wanted}`, or use {other}")
    if not installed:
        raise ArgumentError("unwrap", "needs xatlas or uvunwrap, neither of which is installed; `pip install uvunwrap`")
    if installed == ["uvunwrap"]:
        progress.note("uvunwrap makes the UVs: xatlas is not installed (PyPI has none for Python 3.14 or Linux on ARM)")
        return installed
    return installed[::-1] if faces > LARGE_MESH else installed[:1]


def check_uvs(
    make_rasterizer: RasterizerFactory, scene: Scene, uv_set: int, width: int, height: int
) -> tuple[UvCheck, Atlas | None]:
    """Check one of the file's UV sets, by index; also return its atlas if it can hold a bake.

    It can if, wrapped modulo 1, less than MAX_OVERLAP of the covered texels lie inside two triangles, every face with
    area has area in UV space, and no face spans more than MAX_TILES repeats of the texture.
    """
    uvs, mapped = scene.uv_sets[uv_set], needs_uvs(scene)
    longest = np.linalg.norm(np.roll(uvs, -1, axis=1) - uvs, axis=2).max(axis=1)
    flat = int(np.count_nonzero(mapped & (doubled_uv_areas(uvs) <= 1e-9 * np.maximum(longest**2, 1e-9))))
    tiles = int(np.ceil(uvs[mapped].max(axis=1) - np.floor(uvs[mapped].min(axis=1))).max())
    if flat:
        fault = f"{counted(flat, 'face')} with area {one_or_many(flat, 'has', 'have')} no area in UV space"
        return UvCheck(uv_set, flat, tiles, None, fault), None
    if tiles > MAX_TILES:
        fault = f"a face lies on {tiles} repeats of the texture; at most {MAX_TILES} may be"
        return UvCheck(uv_set, flat, tiles, None, fault), None
    atlas = replace(atlas_from_uvs(scene, uvs, mapped), uv_set=uv_set)
    overlap = make_rasterizer(build_layout(scene, atlas, width, height)).overlap()
    if overlap < MAX_OVERLAP:
        return UvCheck(uv_set, flat, tiles, overlap, ""), atlas
    fault = f"{overlap:.1%} of the texels lie inside two triangles; at most {MAX_OVERLAP:.1%} may"
    return UvCheck(uv_set, flat, tiles, overlap, fault), None
