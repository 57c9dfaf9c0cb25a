"""How well spheres stand in for a mesh: what is measured, and in words what each measure is."""

from dataclasses import dataclass, field
from pathlib import Path

import msgspec

from aoprecalc.api.documents import OMIT_NONE, Report
from aoprecalc.io.outputs import read_json_object


@dataclass(frozen=True)
class SphereQuality(Report):
    """How well spheres stand in for a mesh.

    Attributes
    ----------
    radius_min, radius_mean, radius_max, radius_deviation : float
        Of the radii, in the mesh's units; the last one is the standard deviation.
    inertia : float
        Sum over the surface samples of the squared distance to the nearest centre, over the squared diagonal of the
        mesh's bounding box.
    surface_error_mean, surface_error_p95, surface_error_max : float
        Distance of the samples from the surface of the nearest sphere, over the diagonal.
    coverage : float
        Share of the samples inside some sphere, 0 to 1.
    silhouette_iou, silhouette_iou_min : float
        Intersection over union of the silhouettes of mesh and spheres, 0 to 1: mean and worst of 32 views that no
        fit uses, of 256 x 256 pixels.
    leak, spill, area_bias : float or None
        Mesh silhouette not covered by spheres, sphere silhouette outside the mesh's, and silhouette area of the
        spheres less the mesh's, all over the area of the mesh's; None for a mesh too thin to cover a pixel.
    overlap : float
        Mean number of spheres at a point of their union, at least 1.
    inside_volume, outside_volume : float or None
        Volume of the spheres inside and outside a watertight mesh, over its volume; None for other meshes.
    """

    radius_min: float
    radius_mean: float
    radius_max: float
    radius_deviation: float
    inertia: float
    surface_error_mean: float
    surface_error_p95: float
    surface_error_max: float
    coverage: float
    silhouette_iou: float
    silhouette_iou_min: float
    leak: float | None = field(default=None, metadata=OMIT_NONE)
    spill: float | None = field(default=None, metadata=OMIT_NONE)
    area_bias: float | None = field(default=None, metadata=OMIT_NONE)
    overlap: float = 1.0
    inside_volume: float | None = field(default=None, metadata=OMIT_NONE)
    outside_volume: float | None = field(default=None, metadata=OMIT_NONE)


# What each measure of SphereQuality is, and its unit.
MEASURES = {
    "radius_min": "smallest radius, in the mesh's units",
    "radius_mean": "mean radius, in the mesh's units",
    "radius_max": "largest radius, in the mesh's units",
    "radius_deviation": "standard deviation of the radii, in the mesh's units",
    "inertia": "sum of squared distances, surface samples to nearest centres, over diagonal squared",
    "surface_error_mean": "mean distance of the surface to the nearest sphere, over the diagonal",
    "surface_error_p95": "95% of the surface is within this distance, over the diagonal",
    "surface_error_max": "largest distance, over the diagonal",
    "coverage": "share of the surface inside spheres, 0 to 1",
    "silhouette_iou": "intersection over union of the silhouettes, 1 is best: mean of the views",
    "silhouette_iou_min": "the same, of the worst view",
    "leak": "mesh silhouette that spheres do not cover, over its area",
    "spill": "sphere silhouette outside the mesh's, over the area of the mesh's",
    "area_bias": "silhouette area of the spheres less the mesh's, over the mesh's",
    "overlap": "mean number of spheres at a point inside them, at least 1",
    "inside_volume": "volume of the spheres inside the mesh, over its volume",
    "outside_volume": "volume of the spheres outside the mesh, over its volume",
}


def quality_in(path: Path) -> SphereQuality | None:
    """Return the quality that a sphere file tells; None where it tells none."""
    if path.suffix.lower() != ".json":
        return None
    try:
        return msgspec.convert(read_json_object(path).get("quality"), SphereQuality)
    except (msgspec.ValidationError, UnicodeError):
        return None
