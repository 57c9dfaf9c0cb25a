"""What becomes of a bake in a format that holds one set of UVs and one place for each part."""

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from aoprecalc.io.images import decode_pixels, read_pixels
from aoprecalc.types import REVERSED_WINDING, Atlas, Float32Array, Float64Array, Scene


def placed_uvs(scene: Scene, atlas: Atlas) -> Float64Array:
    """Return the atlas's UVs, (f, 3, 2), where parts that share a place have those of its owner.

    They are (0, 0) on parts that do not receive.
    """
    uvs = np.where(scene.receives[:, None, None], atlas.uvs, 0.0)
    for part in scene.parts:
        if part.receives and part.uv_owner is not None:
            owner = scene.parts[part.uv_owner]
            mirrored = (part.vertices != owner.vertices).any(axis=1)
            there = atlas.uvs[owner.faces]
            uvs[part.faces] = np.where(mirrored[:, None, None], there[:, REVERSED_WINDING], there)
    return uvs


def what_is_lost(path: Path, scene: Scene, atlas: Atlas) -> tuple[str, ...]:
    """Return warnings: materials that the format cannot hold, and UVs of the file that are replaced."""
    kind = path.suffix.removeprefix(".").upper()
    materials = [part.material for part in scene.parts]
    lost: tuple[str, ...] = ()
    if any(material.transparent or material.alpha_mask is not None for material in materials):
        lost = (f"{path}: {kind} says nothing of glass and of holes, which the bake has heeded; a .glb would",)
    if not scene.uv_sets or atlas.uv_set == 0:
        return lost
    return (
        *lost,
        f"{path}: {kind} holds one set of UVs; those of {scene.path.name} are replaced, a .glb would hold both",
    )


# What meshes say about the pictures that lie on them.


@dataclass(frozen=True)
class Picture:
    """A picture that a mesh refers to.

    name   what messages call it
    path   its file; None where the mesh's own file holds it
    data   its bytes in that case
    """

    name: str
    path: Path | None = None
    data: bytes = field(default=b"", repr=False, compare=False)

    def pixels(self) -> Float32Array:
        """Return its values as stored, (height, width, channels) float32; raises InputError where it is unreadable."""
        return decode_pixels(self.data, self.name) if self.path is None else read_pixels(self.path)

    def read(self) -> Float32Array:
        """Return its first channel, (height, width) float32; raises InputError where it is unreadable."""
        return np.ascontiguousarray(self.pixels()[:, :, 0])


@dataclass(frozen=True, eq=False)
class Pictured:
    """The ambient occlusion on one part of a scene, as its file has it.

    picture   None where it names none
    uvs       (n, 3, 2) float64 at the part's corners, v upwards, those that the picture is for, or else the file's
              first; None where there are none
    note      what the user should know about it
    """

    picture: Picture | None
    uvs: Float64Array | None
    note: str = ""
