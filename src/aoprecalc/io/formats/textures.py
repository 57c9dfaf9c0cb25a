"""The baked textures of a mesh that is written: which faces have which, on which UVs, and by which materials."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import chain, count, pairwise
from pathlib import Path
from typing import Literal, TypeVar

import numpy as np

from aoprecalc.options import BentSpace, Green
from aoprecalc.types import (
    REVERSED_WINDING,
    Atlas,
    BoolArray,
    Certificate,
    Float32Array,
    Float64Array,
    Int64Array,
    Part,
    Scene,
)

_ROUNDING = 1e-6  # by which UVs may leave [0, 1]

Values = TypeVar("Values", Float32Array, Float64Array)


Directions = Literal["bent normals", "spherical harmonics"]


@dataclass(frozen=True)
class DirectionalPicture:
    """A picture of bent normals or of spherical harmonics, of integers.

    holds   which of them
    path    of the picture, already written
    space   of its vectors
    green   where their second component points
    """

    holds: Directions
    path: Path
    space: BentSpace
    green: Green


@dataclass(frozen=True, eq=False)
class MeshTexture:
    """A baked texture of a mesh.

    name    of its material, mesh or UDIM tile; empty for the only one of a mesh
    path    of the picture, already written
    atlas   the UVs of its faces
    faces   (f,) bool: those whose occlusion it holds
    directional   further pictures on the same UVs; none where the format of the mesh cannot refer to them
    certificate   of its error; None where none was asked for
    """

    name: str
    path: Path
    atlas: Atlas
    faces: BoolArray
    directional: tuple[DirectionalPicture, ...] = ()
    certificate: Certificate | None = None

    def repeats(self, scene: Scene) -> bool:
        """Tell whether some of its UVs, as they are written, lie outside [0, 1], so that the picture repeats."""
        if self.atlas.uv_set is None:
            return self.atlas.repeats
        uvs = scene.uv_sets[self.atlas.uv_set][self.faces & self.atlas.mapped]
        return self.atlas.repeats or bool(uvs.min() < -_ROUNDING or uvs.max() > 1 + _ROUNDING)


def texture_owners(textures: Sequence[MeshTexture]) -> Int64Array:
    """Return the index of the texture of each face, (f,); -1 where it has none."""
    owners = np.full(len(textures[0].faces), -1)
    for index, texture in enumerate(textures):
        owners[texture.faces] = index
    return owners


def split_parts(parts: Sequence[Part], owners: Int64Array) -> tuple[Part, ...]:
    """Return parts of which each has one texture: one whose faces have several becomes several.

    owners   (f,) index of the texture of each face, -1 for none
    """
    result = list[Part]()
    for part in parts:
        own = owners[part.faces]
        cuts = [0, *(np.flatnonzero(np.diff(own)) + 1).tolist(), len(own)]
        result += [
            replace(part, start=part.start + first, stop=part.start + stop, vertices=part.vertices[first:stop])
            for first, stop in pairwise(cuts)
        ]
    return tuple(result)


# Materials.


@dataclass(frozen=True)
class PartSource:
    """Where a part of a scene comes from: the name of its material; None where it has none."""

    material: str | None = None


MaterialUse = tuple[str | None, int]  # the name of a material, None for none, and the index of the texture, -1 for none


def part_material(part: Part) -> str | None:
    """Return the name of the material of a part; None where it has none."""
    return part.source.material if isinstance(part.source, PartSource) else None


def material_uses(parts: Sequence[Part], owners: Int64Array) -> list[MaterialUse]:
    """Return the material and the texture of each part, see `split_parts`."""
    return [(part_material(part), int(owners[part.start])) for part in parts]


def material_names(
    uses: Iterable[MaterialUse], known: Iterable[str], textures: Sequence[MeshTexture]
) -> dict[MaterialUse, str]:
    """Name the materials of the output, as in the file.

    A material that has a texture in some places and none in others, or several textures, is copied under the names of
    these; the one without a texture keeps its name.
    known   names of materials that are taken, beside those that are used
    """
    uses = list(dict.fromkeys(uses))
    taken = {*known, *(material for material, _ in uses if material)}
    names: dict[MaterialUse, str] = {}
    for material, texture in uses:
        others = [other for name, other in uses if name == material]
        if material is not None and (texture < 0 or others == [texture]):
            names[material, texture] = material
            continue
        own = textures[texture].name if texture >= 0 else ""
        if material is not None:
            name = f"{material}_{own or 'ao'}"
        else:
            name = "plain" if texture < 0 else f"baked_{own}" if own else "baked"
        free = next(free for free in chain([name], (f"{name}_{n}" for n in count(2))) if free not in taken)
        taken.add(free)
        names[material, texture] = free
    return names


# UVs at the corners of faces.


def first_uvs(scene: Scene, part: Part) -> Float64Array | None:
    """Return the first UV set at the corners of a part, (n, 3, 2) float64; None where there is none."""
    return None if scene.uvs is None else scene.uvs[part.faces]


def textures_uvs(scene: Scene, textures: Sequence[MeshTexture]) -> Float64Array:
    """Return the UVs of every face in its texture, (f, 3, 2); see `output_uvs`."""
    uvs = np.zeros((len(scene.faces), 3, 2))
    for texture in textures:
        uvs[texture.faces] = output_uvs(scene, texture.atlas)[texture.faces]
    return uvs


def output_uvs(scene: Scene, atlas: Atlas) -> Float64Array:
    """Return the UVs to write, (f, 3, 2): parts that share a UV region get those of the part that owns it.

    They are (0, 0) on parts that are not baked.
    """
    return shared_by_owners(scene, np.where(scene.receives[:, None, None], atlas.uvs, 0.0))


def shared_by_owners(scene: Scene, corners: Values) -> Values:
    """Return (f, 3, c) values at corners in which parts that share a UV region have those of the part that owns it."""
    result = corners.copy()
    for part in scene.parts:
        if part.receives and part.uv_owner is not None:
            owner = scene.parts[part.uv_owner]
            mirrored = (part.vertices != owner.vertices).any(axis=1)
            shared = corners[owner.faces]
            result[part.faces] = np.where(mirrored[:, None, None], shared[:, REVERSED_WINDING], shared)
    return result
