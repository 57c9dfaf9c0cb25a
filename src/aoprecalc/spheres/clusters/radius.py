"""How large the sphere of a cluster is."""

import numpy as np

from aoprecalc.model import Doubles
from aoprecalc.options import Radius
from aoprecalc.spheres.clusters.lloyd import Clusters
from aoprecalc.spheres.clusters.pairing import greatest


def radii(clusters: Clusters, rule: Radius) -> Doubles:
    """Choose a radius for each cluster, from the distances |p - c| of samples p from their centre c.

    mean      each cluster's mean of |p - c| (equation 1.2.2.4 of *Précalcul*)
    uniform   one for all: the mean of |p - c| over all samples
    cover     each cluster's greatest |p - c|, so that the spheres hold every sample

    Returns (n,) float64 in the unit of the distances; 0 for a cluster that is a single point, unless uniform.
    """
    count = len(clusters.centers)
    if rule == "uniform":
        return np.full(count, clusters.distances.mean())
    if rule == "cover":
        return greatest(clusters.distances, clusters.labels, count)
    return np.bincount(clusters.labels, clusters.distances) / np.bincount(clusters.labels)
