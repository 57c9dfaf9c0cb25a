"""How far apart two results are: pictures, meshes, sphere sets, documents; each kind ends in one number."""

from aoprecalc.measure.difference.difference import Answer, Difference, Pair
from aoprecalc.measure.difference.documents import document_difference
from aoprecalc.measure.difference.meshes import Surface, mesh_difference
from aoprecalc.measure.difference.pictures import picture_difference
from aoprecalc.measure.difference.spheres import Spheres, spheres_difference

__all__ = [
    "Answer",
    "Difference",
    "Pair",
    "Spheres",
    "Surface",
    "document_difference",
    "mesh_difference",
    "picture_difference",
    "spheres_difference",
]
