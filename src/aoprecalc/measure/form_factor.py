"""What share of the light that reaches a point comes through an opening: a closed form to measure bakes against."""

import numpy as np

from aoprecalc.model import Doubles


def form_factor(places: Doubles, normals: Doubles, polygon: Doubles) -> Doubles:
    """Return the form factor of a flat polygon from points of a surface, (k,) float64 in [0, 1].

    It is the cosine-weighted share of the hemisphere that the polygon takes up: the ambient occlusion of a point that
    sees nothing but black around it.

    places    (k, 3) float64, none on the polygon's edges
    normals   (k, 3) float64 unit normals of the surface; no corner may lie below the surface's plane
    polygon   (c, 3) float64 corners, in order, clockwise seen from the points

    Lambert's formula: the sum over the edges of the angle under which each is seen, times the cosine between the
    surface's normal and that of the plane through the edge and the point, over 2 pi (J. H. Lambert, Photometria, 1760;
    D. Baum, H. Rushmeier, J. Winget, Improving Radiosity Solutions Through the Use of Analytically Determined
    Form-Factors, SIGGRAPH 1989). For a rectangle that is parallel or perpendicular to the surface it agrees with the
    expressions in section B of J. R. Howell's Catalog of Radiation Heat Transfer Configuration Factors.
    """
    first = polygon - places[:, None]
    second = np.roll(first, -1, axis=1)
    across = np.cross(first, second)
    length = np.linalg.norm(across, axis=2)
    angle = np.arctan2(length, np.einsum("kcx,kcx->kc", first, second))
    slope = np.einsum("kcx,kx->kc", across, normals) / np.where(length > 0, length, 1)
    factors: Doubles = (angle * slope).sum(axis=1) / (2 * np.pi)
    return factors
