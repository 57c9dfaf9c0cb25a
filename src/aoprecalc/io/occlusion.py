"""Finds the picture of ambient occlusion that belongs to a mesh, and how it lies on it."""

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from aoprecalc.errors import AoprecalcError, InputError
from aoprecalc.io.formats.base import Picture, Pictured
from aoprecalc.io.formats.builder import damaged
from aoprecalc.io.formats.gltf.document import GltfDocument
from aoprecalc.io.formats.gltf.occlusion_textures import gltf_occlusion
from aoprecalc.io.formats.obj.reader import ObjDocument, Section
from aoprecalc.io.formats.ply import PlyDocument
from aoprecalc.types import BoolArray, Float32Array, Float64Array, Part, Scene


class NoOcclusionError(InputError):
    """A mesh refers to no picture of its ambient occlusion, or has no UVs by which one lies on it."""


@dataclass(frozen=True, eq=False)
class OcclusionPicture:
    """A picture of ambient occlusion and how it lies on a scene.

    name      what to call it: the path of its file, where it has one of its own
    path      of that file; None where it is within the mesh's
    values    (height, width) float32, row 0 at v = 1
    uvs       (f, 3, 2) float64, v upwards, NaN where a face has none
    shown     (f,) bool: the faces that show this picture
    warnings  what the user should know
    """

    name: str
    path: Path | None
    values: Float32Array
    uvs: Float64Array
    shown: BoolArray
    warnings: tuple[str, ...]


def find_occlusion(scene: Scene, texture: Path | None = None) -> OcclusionPicture:
    """Return the ambient occlusion of a scene: of a `texture` where one is given, else of what the file refers to.

    That is the occlusionTexture of glTF, map_Ka or map_Kd of an OBJ's materials, and the TextureFile of a PLY; where
    there is none, `<stem>.png` beside the mesh. Where materials have different pictures, it is the first, or that of
    them which is `texture`, and its faces only. UVs are those of the occlusionTexture, else the file's first.

    Raises NoOcclusionError where there are no UVs or no picture is found, InputError where it cannot be read.
    """
    parts = [_part(scene, part) for part in scene.parts]
    if all(part.uvs is None for part in parts):
        found = "has no UVs, by which a texture lies on a mesh"
        raise NoOcclusionError(f"{scene.path}: {found}; bake it, or export it with UVs")
    pictures = list(dict.fromkeys(part.picture for part in parts if part.picture is not None))
    chosen = _choose(scene.path, pictures, texture)
    sizes = [part.stop - part.start for part in scene.parts]
    shown = np.repeat([chosen not in pictures or part.picture == chosen for part in parts], sizes)
    uvs = [np.full((n, 3, 2), np.nan) if part.uvs is None else part.uvs for n, part in zip(sizes, parts, strict=True)]

    said = dict.fromkeys(part.note for part in parts if part.note and part.picture == chosen)
    if not shown.all():
        others = ", ".join(picture.name for picture in pictures if picture != chosen)
        left_out = f"{np.count_nonzero(~shown)} of {len(shown)} faces are left out: their materials have"
        said[f"{left_out} {f'other pictures ({others})' if others else 'no such picture'}"] = None
    values = chosen.read()
    if not np.isfinite(values).all():
        raise InputError(f"{chosen.name}: holds values that are not finite, 0 to 1 were expected; bake it again")
    return OcclusionPicture(chosen.name, chosen.path, values, np.concatenate(uvs), shown, tuple(said))


def _part(scene: Scene, part: Part) -> Pictured:
    """Return what the scene's document says about one part."""
    if isinstance(scene.document, GltfDocument):
        try:
            return gltf_occlusion(scene.document, part)
        except AoprecalcError:
            raise
        except Exception as error:  # whatever a damaged document provokes
            reason = f"its materials cannot be understood ({type(error).__name__}: {error})"
            raise damaged(scene.path, reason) from error
    path = None
    if isinstance(scene.document, ObjDocument) and isinstance(part.source, Section):
        material = scene.document.materials.get(part.source.material or "")
        path = None if material is None else material.ambient or material.picture
    elif isinstance(scene.document, PlyDocument):
        path = scene.document.picture
    uvs = None if scene.uvs is None else scene.uvs[part.start : part.stop]
    return Pictured(None if path is None else Picture(str(path), path), uvs)


def _choose(mesh: Path, pictures: Sequence[Picture], texture: Path | None) -> Picture:
    beside = mesh.with_suffix(".png")
    if texture is None and not pictures and beside.is_file():
        texture = beside
    if texture is not None:
        same = (p for p in pictures if p.path is not None and os.path.realpath(p.path) == os.path.realpath(texture))
        return next(same, Picture(str(texture), texture))
    if not pictures:
        raise NoOcclusionError(
            f"{mesh}: refers to no picture of its ambient occlusion, and there is no {beside.name} beside it; "
            "pass the picture with --texture"
        )
    return pictures[0]
