"""What depth maps are wrong by where their texels are far wider than the texture's."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from aoprecalc.mesh.normalized_surface import NormalizedSurface
from aoprecalc.mesh.roles import in_poses
from aoprecalc.mesh.surface import bounding_sphere, positions_of
from aoprecalc.progress import Progress
from aoprecalc.raster.layout import area_per_texel, doubled_uv_areas
from aoprecalc.types import Float32Array, Float64Array, Texels
from aoprecalc.visibility.backend import RayBackend
from aoprecalc.visibility.directions import map_texel
from aoprecalc.visibility.gather import TexelOcclusion
from aoprecalc.visibility.instances import SharedInstances, mean_over_poses
from aoprecalc.visibility.rays import embreex_problem
from aoprecalc.visibility.setup import BakeSetup, SurfaceSide

_COARSE = 4.0  # map texels over surface texels: a map adds about 0.005 (a stool among far larger things, measured)
_MIN_COARSE = 0.01  # of the texels: where fewer lie on surfaces for which the maps are coarse, no error is estimated
_CHECKED = 512  # texels for which rays are traced, as many as for texels with an error of 0.01 tell 0.009 from 0.011
_MAX_ERROR = 0.01  # that depth maps may add without a warning


def warnings_on_maps(setup: BakeSetup, sides: Sequence[TexelOcclusion], shadow_size: int) -> list[str]:
    """Return a warning where depth maps of `shadow_size` add an error of more than 0.01, or one that is not known.

    sides   of the setup, in their order
    Where map texels are far wider than those of the texture, rays are traced for a sample of the texels: from the
    points that the maps were compared at, along the same axes. The error is the RMS difference.
    """
    known, ratios, squares = embreex_problem() is None, list[float](), 0.0
    for side, found in zip(setup.sides, sides, strict=True):
        ratio = _coarseness(setup, side, shadow_size)
        if ratio is not None and len(found.texels):
            ratios.append(ratio)
            squares += len(found.texels) * (_squared_error(setup, side, found) if known else 0.0)
    error = (squares / sum(len(found.texels) for found in sides)) ** 0.5 if ratios else 0.0
    if not ratios or (known and error <= _MAX_ERROR):
        return []
    added = f"an estimated error of {error:.3f}" if known else "an error of unknown size"
    return [
        f"the depth maps add {added}: their texels are {max(ratios):.0f} times as wide as the texture's on the "
        f"surface; use --backend ray, a --shadow-size larger than {shadow_size}, or --only for small parts"
    ]


def _coarseness(setup: BakeSetup, side: SurfaceSide, shadow_size: int) -> float | None:
    """Return how wide map texels are over those of the texture, on the surfaces of one side where they are far wider.

    None where they are fine enough on nearly all of it.
    """
    scene, atlas = setup.textured(side), setup.inputs.atlas
    poses = [pose for pose, _ in in_poses(side.scene, setup.inputs.normals)]
    areas = area_per_texel(scene, atlas, side.texels) * bounding_sphere(scene.positions)[1] ** 2
    weights = doubled_uv_areas(atlas.uvs) * (atlas.mapped & scene.receives)
    widths = np.sqrt(np.maximum(areas, 1e-300))

    def coarse_weights(map_width: float) -> Float64Array | None:
        coarse: Float64Array = weights * (map_width > _COARSE * widths)
        return coarse if coarse.sum() > _MIN_COARSE * weights.sum() else None

    at_most = max(2 * bounding_sphere(positions_of(pose, pose.receives))[1] / shadow_size for pose in poses)
    if coarse_weights(at_most) is None:  # as a rule
        return None
    map_width = max(map_texel(pose, shadow_size) for pose in poses)
    coarse = coarse_weights(map_width)
    return None if coarse is None else float((coarse * map_width / widths).sum() / coarse.sum())


def _squared_error(setup: BakeSetup, side: SurfaceSide, found: TexelOcclusion) -> float:
    """Return the mean squared difference of a side's texels to rays."""
    options, index = setup.inputs.options, found.texels.index
    chosen = np.sort(np.random.default_rng(0).choice(len(index), min(_CHECKED, len(index)), replace=False))
    checked = replace(side, texels=Texels(found.texels.width, found.texels.height, index[chosen]))
    integrand = replace(setup.integrand, vectors=False)
    instances = SharedInstances.from_scene(side.scene)

    def traced(surface: NormalizedSurface) -> Float32Array:
        tester = RayBackend(options.threads).tester(surface, integrand, len(chosen), 0, len(chosen))
        sums = np.zeros((len(chosen), 2), np.float32)
        for number, group in enumerate(setup.groups):
            if 2 * group.start < found.directions:
                samples = setup.samples(checked, slice(0, len(chosen)), number)
                sums += instances.accumulate(tester, samples, setup.axes[group], number, Progress())
        return sums

    sums = mean_over_poses(map(traced, side.surfaces))
    values, measured = integrand.estimate(sums, found.directions)
    both = measured & found.measured[chosen]
    difference = np.clip(values, 0.0, 1.0)[both] - found.values[chosen][both]
    return float(np.mean(difference**2)) if both.any() else 0.0
