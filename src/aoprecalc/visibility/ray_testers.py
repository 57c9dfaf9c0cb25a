"""Visibility of samples by rays: one at a time, with all that an integrand asks for, or in packets, which is faster."""

from math import inf
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from aoprecalc.mesh.normalized_surface import ON_GROUND, NormalizedSurface
from aoprecalc.progress import Progress
from aoprecalc.raster.layout import Samples, morton_codes
from aoprecalc.system import whole_cores
from aoprecalc.types import Float32Array, Float64Array, Int64Array
from aoprecalc.visibility.embree import OcclusionScene, casts_packets
from aoprecalc.visibility.integrand import Integrand
from aoprecalc.visibility.rays import FAR, RayCaster

if TYPE_CHECKING:
    from aoprecalc.visibility.packets import Lights

# Distance above its face at which a ray starts, as a share of the bounding radius, so that it does not hit that face;
# 32-bit positions are good to 1e-7. With ten times as much, rays near a concave edge start behind the neighbouring
# face, which then cannot occlude them.
RAY_OFFSET = 1e-5
_CELLS = 4095  # of the octahedral map along both sides, in which axes are sorted
_SIGNS = (1.0, -1.0)  # of the two directions of an axis


class RayOcclusion:
    """How much of the light the occluders of a surface, and the ground, take, by rays."""

    def __init__(self, surface: NormalizedSurface, integrand: Integrand, threads: int = 0) -> None:
        """Build the occluders. Raises RendererError where embreex is not installed."""
        self._surface, self._integrand = surface, integrand
        self._occluders = RayCaster(surface.occluders, threads, surface.one_sided)

    def occlusion(self, origins: Float32Array, directions: Float32Array) -> Float64Array:
        """Return the share of the light from each of k directions that is taken, (k,) in [0, 1].

        origins      (k, 3) float32
        directions   (k, 3) float32 unit vectors, or (1, 3) for parallel rays
        """
        surface, integrand = self._surface, self._integrand
        below = surface.is_below_ground(directions)
        if surface.buried:
            below = below | surface.is_under_ground(origins)
        if integrand.max_distance == inf:
            if below.all():
                return np.ones(len(origins))
            return np.where(below, 1.0, self._occluders.occluded(origins, directions))
        if integrand.falloff == "none":
            taken = self._occluders.occluded(origins, directions, integrand.max_distance / surface.unit).astype(float)
        else:
            taken = integrand.occlusion(self._occluders.distances(origins, directions) * surface.unit)
        if below.any():
            up = np.asarray(surface.ground_normal)
            slopes = np.where(below, np.abs(directions @ up), 1.0)
            to_ground = np.maximum(origins @ up - surface.ground_height, 0) / slopes
            taken = np.where(below, np.maximum(taken, integrand.occlusion(to_ground * surface.unit)), taken)
        return taken


def ray_origins(
    surface: NormalizedSurface, samples: Samples
) -> tuple[NDArray[np.intp], Float32Array, Float64Array, Float64Array]:
    """Return which samples have a face, (k,), and of these where rays start, and n and g, (k, 3) each."""
    with_face = np.flatnonzero(samples.faces >= 0)
    points, normals, geometric = surface.interpolate(samples.faces[with_face], samples.weights[with_face])
    return with_face, (points + RAY_OFFSET * geometric).astype(np.float32), normals, geometric


class RayTester:
    """A VisibilityTester that casts a ray from every sample along every direction in front of it, one at a time."""

    def __init__(self, surface: NormalizedSurface, integrand: Integrand, threads: int = 0) -> None:
        """Build the occluders. Raises RendererError where embreex is not installed."""
        self._surface, self._integrand = surface, integrand
        self._rays = RayOcclusion(surface, integrand, threads)

    def accumulate(self, samples: Samples, axes: Float64Array, progress: Progress) -> Float32Array:
        """Return the visibility sums of the samples, see VisibilityTester."""
        with_face, origins, normals, geometric = ray_origins(self._surface, samples)
        found = np.zeros((len(with_face), self._integrand.columns))
        radiance = np.stack([self._integrand.radiance(sign * axes) for sign in _SIGNS], axis=1).tolist()
        for axis, lights in zip(axes, radiance, strict=True):
            g_dot_axis, n_dot_axis = geometric @ axis, normals @ axis
            for sign, light in zip(_SIGNS, lights, strict=True):
                weights = light * self._integrand.weights(sign * n_dot_axis)
                in_front = np.flatnonzero((sign * g_dot_axis > 0) & (weights > 0))
                taken = self._rays.occlusion(origins[in_front], (sign * axis)[None].astype(np.float32))
                visible = weights[in_front] * (1 - taken)
                found[in_front, 0] += visible
                found[in_front, 1] += weights[in_front]
                if self._integrand.vectors:
                    found[in_front, 2:] += visible[:, None] * (sign * axis)
                progress.advance()
        sums = np.zeros((len(samples.faces), self._integrand.columns), np.float32)
        sums[with_face] = found
        return sums


class PacketTester:
    """A VisibilityTester that casts packets of rays, where the first hit on any side of a triangle counts."""

    def __init__(self, surface: NormalizedSurface, integrand: Integrand, texels: int, threads: int = 0) -> None:
        """Build the occluders; `threads` cast rays, 0 is one for each core. For `texels` see `Backend.tester`."""
        self._surface, self._integrand, self._texels = surface, integrand, texels
        self._threads = threads or whole_cores()
        self._scene = OcclusionScene(surface.occluders)

    @staticmethod
    def serves(surface: NormalizedSurface, integrand: Integrand) -> bool:
        """Tell whether packets do: they tell neither how far away an occluder is, nor on which side it was hit."""
        return integrand.falloff == "none" and not surface.one_sided and casts_packets()

    def accumulate(self, samples: Samples, axes: Float64Array, progress: Progress) -> Float32Array:
        """Return the visibility sums of the samples, see VisibilityTester."""
        from aoprecalc.visibility.packets import Receivers, visibility_sums  # numba takes half a second

        surface, integrand = self._surface, self._integrand
        receivers = Receivers(
            faces=_plain(samples.faces, np.int32),
            weights=_plain(samples.weights, np.float32),
            corners=_plain(surface.faces, np.int32),
            positions=_plain(surface.positions, np.float32),
            shading=_plain(surface.shading_normals, np.float32),
            geometric=_plain(surface.geometric_normals, np.float32),
            offset=RAY_OFFSET,
        )
        lights = self._lights(axes[_order_of_axes(axes)])
        return visibility_sums(self._scene, receivers, lights, integrand.columns, self._texels, self._threads, progress)

    def _lights(self, axes: Float64Array) -> "Lights":
        from aoprecalc.visibility.packets import Lights

        surface, integrand = self._surface, self._integrand
        return Lights(
            axes=axes,
            radiance=np.stack([integrand.radiance(axes), integrand.radiance(-axes)], axis=1),
            cosine=integrand.weight == "cosine",
            min_cosine=integrand.min_cosine,
            reach=min(integrand.max_distance / surface.unit, FAR),
            up=np.array(surface.ground_normal or (0.0, 0.0, 0.0)),
            ground=surface.ground_height,
            deepest=-ON_GROUND if surface.buried else -inf,
        )


def _plain(values: NDArray[np.generic], kind: type[np.generic]) -> NDArray[Any]:
    """Return an array as compiled code takes it; a copy of one that is read-only or not contiguous.

    For another memory layout the code would be compiled again, which takes seconds.
    """
    return np.require(values, kind, ["C_CONTIGUOUS", "WRITEABLE"])


def _order_of_axes(axes: Float64Array) -> Int64Array:
    """Return an order of (a, 3) axes in which those that follow each other lie near each other: (a,) indices.

    So the rays of a packet of directions go through the same boxes, and those of the next packet find them in the
    processor's cache. The order is that of the Z-order curve on the octahedral map of the half sphere (Z. H. Cigolle et
    al., "A Survey of Efficient Representations for Independent Unit Vectors", 2014).
    """
    upwards = axes * np.where(axes[:, 2:] < 0, -1.0, 1.0)
    octahedral = upwards[:, :2] / np.abs(upwards).sum(axis=1, keepdims=True)
    order: Int64Array = np.argsort(morton_codes(((octahedral + 1.0) * 0.5 * _CELLS).astype(np.int64)), kind="stable")
    return order
