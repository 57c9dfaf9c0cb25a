"""How far apart two results are: pictures, meshes, sphere sets, documents; each kind ends in one number."""

from aoprecalc.metrics.difference import (
    Answer,
    ComparedMesh,
    Difference,
    PicturePair,
    mesh_difference,
    picture_difference,
)
from aoprecalc.metrics.json_difference import document_difference
from aoprecalc.metrics.sphere_difference import Spheres, spheres_difference

__all__ = [
    "Answer",
    "ComparedMesh",
    "Difference",
    "PicturePair",
    "Spheres",
    "document_difference",
    "mesh_difference",
    "picture_difference",
    "spheres_difference",
]
