"""What the user should know about the result of a bake."""

import numpy as np

from aoprecalc.mesh.normals import area_vectors, geometric_normals
from aoprecalc.mesh.topology import topology
from aoprecalc.options import BakeOptions
from aoprecalc.types import Baked, Scene
from aoprecalc.uv.gutter import first_unsafe_mip
from aoprecalc.uv.select import MAX_OVERLAP
from aoprecalc.uv.unwrap import needs_uvs

_NAMED = 5  # parts
_UNSEEN = 0.01  # share of texels without light from which on it is said


def bake_warnings(baked: Baked, options: BakeOptions, overlap: float) -> tuple[str, ...]:
    """Return one line for each thing; `overlap` is the share of texels that lie inside two faces."""
    scene, atlas, warnings = baked.scene, baked.atlas, _about_roles(baked.scene)
    if baked.directions - 1 == options.directions:
        asked = f"{options.directions} were asked for"
        warnings.append(f"{baked.directions} directions were used, as they come in pairs; {asked}")
    warnings += _about_target(baked, options)
    if overlap > MAX_OVERLAP:
        warnings.append(f"{overlap:.1%} of the texels lie inside two faces of the new UVs and serve one of them")
    left_out = np.count_nonzero(needs_uvs(scene) & ~atlas.mapped)
    if left_out:
        warnings.append(
            f"{atlas.method} found no place for {left_out} of {len(scene.faces)} faces; they have no texels"
        )
    if (
        atlas.gutter is not None
        and atlas.gutter < options.padding
        and first_unsafe_mip(atlas.gutter, options.padding) == 1
    ):
        warnings.append(
            f"with {atlas.charts} charts there is room for gutters of {atlas.gutter} texels only; charts may mix from "
            "mip level 1 on; a larger --size has more room"
        )
    return (*warnings, *_about_sides(baked, options))


def _about_roles(scene: Scene) -> list[str]:
    clear = [part.name for part in scene.parts if part.material.transparent and not part.occludes]
    unlit = [part.name for part in scene.parts if part.material.unlit]
    said = []
    if clear:
        said.append(f"light passes through {_named(clear)} (--glass-occludes stops it)")
    if unlit:
        said.append(f"{_named(unlit)} without a texture: unlit")
    return said


def _named(parts: list[str]) -> str:
    names = ", ".join(repr(name) for name in parts[:_NAMED])
    more = f" and {len(parts) - _NAMED} more" if len(parts) > _NAMED else ""
    return f"{len(parts)} part{'s' if len(parts) > 1 else ''} ({names}{more})"


def _about_target(baked: Baked, options: BakeOptions) -> list[str]:
    if options.target_error is None or (
        baked.sampling_error is not None and baked.sampling_error <= options.target_error
    ):
        return []
    if baked.sampling_error is None:
        return ["the sampling error can be estimated from more than 128 directions on only; use more --directions"]
    return [
        f"the estimated sampling error is {baked.sampling_error:.4f} after {baked.directions} directions, more than "
        f"the {options.target_error:g} asked for; use more --directions"
    ]


def _about_sides(baked: Baked, options: BakeOptions) -> list[str]:
    if not options.two_sided and topology(baked.scene.faces).watertight and _volume(baked) < 0:
        return ["the surface is closed and its faces look inwards: its inside was baked; turn them or use --two-sided"]
    if baked.occluded_share < _UNSEEN:
        return []
    why = (
        "they lie inside other parts or touch them"
        if options.two_sided
        else ("they lie inside other parts, touch them, or face inwards (--two-sided takes the lighter side)")
    )
    floor = "" if baked.scene.ground_normal is None else "they look down at the floor, "
    return [f"{baked.occluded_share:.1%} of the texels see next to no direction: {floor}{why}"]


def _volume(baked: Baked) -> float:
    """Return three times the volume that a closed surface encloses, negative where its faces look inwards."""
    scene = baked.scene
    corners = scene.corners - scene.positions.mean(axis=0)
    areas = np.linalg.norm(area_vectors(corners), axis=1) / 2
    return float(np.einsum("fx,fx,f->", corners[:, 0], geometric_normals(scene, baked.normals), areas))
