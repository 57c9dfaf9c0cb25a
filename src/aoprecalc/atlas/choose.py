"""Which UVs a bake uses, and why."""

from collections.abc import Callable
from importlib.util import find_spec
from typing import Literal

import numpy as np

from aoprecalc.atlas.gutter import doubled_areas
from aoprecalc.atlas.unwrap import unwrap
from aoprecalc.errors import InputError, UsageError
from aoprecalc.model import Atlas, Scene
from aoprecalc.options import LARGE_MESH, BakeOptions
from aoprecalc.progress import Progress
from aoprecalc.surface.normals import face_directions
from aoprecalc.texspace.layout import MOST_TILES, Layout, as_atlas, lay_out
from aoprecalc.texspace.samples import TexelSampler

Sampler = Callable[[Layout], TexelSampler]

MOST_OVERLAP = 0.001  # share of covered texels that may lie inside two triangles


def choose_atlas(sampler: Sampler, scene: Scene, options: BakeOptions, progress: Progress) -> Atlas:
    """Return the file's UVs where they can hold a bake or are asked for, else an unwrap.

    sampler   makes what finds the texels of a layout

    Raises InputError where `keep` is asked for and impossible, UsageError where an unwrapper is that is not installed,
    AoprecalcError where the unwrapper fails or takes longer than `unwrap_timeout`.
    """
    if options.unwrap in ("auto", "keep"):
        kept, fault = keep(sampler, scene, options.width, options.height)
        if kept is not None:
            return kept
        if options.unwrap == "keep":
            raise InputError(f"{scene.path}: its UVs cannot hold a bake ({fault}); use --unwrap auto or xatlas")
        progress.note(f"the file's UVs are not kept: {fault}")
    if options.unwrap == "uvunwrap" and find_spec("uvunwrap") is None:
        raise UsageError("--unwrap uvunwrap: it is not installed; `pip install uvunwrap`, or use --unwrap xatlas")
    large = len(scene.faces) > LARGE_MESH and find_spec("uvunwrap") is not None
    fast = options.unwrap == "uvunwrap" or (options.unwrap == "auto" and large)
    size = min(options.width, options.height)
    method: Literal["xatlas", "uvunwrap"] = "uvunwrap" if fast else "xatlas"
    return unwrap(scene, method, size, options.padding, seconds=options.unwrap_timeout, heard=progress.step)


def keep(sampler: Sampler, scene: Scene, width: int, height: int) -> tuple[Atlas | None, str]:
    """Return the atlas of the file's own UVs, or None and why they cannot hold a bake."""
    if scene.uvs is None:
        return None, "there are none"
    solid = face_directions(scene.corners)[1]
    if not solid.any():
        raise InputError(f"{scene.path}: none of its {len(scene.faces)} faces has area; expected a surface to bake")
    longest = np.linalg.norm(np.roll(scene.uvs, -1, axis=1) - scene.uvs, axis=2).max(axis=1)
    flat = solid & (doubled_areas(scene.uvs) <= 1e-9 * np.maximum(longest**2, 1e-9))
    if flat.any():
        return None, f"{np.count_nonzero(flat)} faces with area have no area in UV space"
    atlas = as_atlas(scene, scene.uvs, solid)
    if np.ptp(scene.uvs[solid], axis=1).max() > MOST_TILES:
        return None, f"a face spans more than {MOST_TILES} repeats of the texture"
    overlap = sampler(lay_out(scene, atlas, width, height)).overlap()
    if overlap >= MOST_OVERLAP:
        return None, f"{overlap:.1%} of the texels lie inside two triangles; at most {MOST_OVERLAP:.1%} may"
    return atlas, ""
