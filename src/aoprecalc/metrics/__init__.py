"""Differences between two results: pictures, meshes, sphere sets and JSON documents, each reduced to one number."""

from aoprecalc.metrics.difference import (
    Answer,
    ComparedMesh,
    ComparedTexture,
    Difference,
    PicturePair,
    document_difference,
    mesh_difference,
    picture_difference,
)
from aoprecalc.metrics.sphere_difference import Spheres, spheres_difference

__all__ = [
    "Answer",
    "ComparedMesh",
    "ComparedTexture",
    "Difference",
    "PicturePair",
    "Spheres",
    "document_difference",
    "mesh_difference",
    "picture_difference",
    "spheres_difference",
]
