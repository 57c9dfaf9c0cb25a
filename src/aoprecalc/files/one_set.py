"""What becomes of a bake in a format that holds one set of UVs and one place for each part."""

from pathlib import Path

import numpy as np

from aoprecalc.model import SWAPPED, Atlas, Doubles, Scene


def placed_uvs(scene: Scene, atlas: Atlas) -> Doubles:
    """Return the atlas's UVs, (f, 3, 2), where parts that share a place have those of its owner.

    They are (0, 0) on parts that do not receive.
    """
    uvs = np.where(scene.receives[:, None, None], atlas.uvs, 0.0)
    for part in scene.parts:
        if part.receives and part.shares is not None:
            owner = scene.parts[part.shares]
            mirrored = (part.vertices != owner.vertices).any(axis=1)
            there = atlas.uvs[owner.faces]
            uvs[part.faces] = np.where(mirrored[:, None, None], there[:, SWAPPED], there)
    return uvs


def what_is_lost(path: Path, scene: Scene, atlas: Atlas) -> tuple[str, ...]:
    """Return what the user should know of looks that are lost, and where the file's own UVs make room for others."""
    kind = path.suffix.removeprefix(".").upper()
    looks = [part.look for part in scene.parts]
    lost: tuple[str, ...] = ()
    if any(look.glass or look.cutout is not None for look in looks):
        lost = (f"{path}: {kind} says nothing of glass and of holes, which the bake has heeded; a .glb would",)
    if not scene.uv_sets or atlas.uv_set == 0:
        return lost
    return (
        *lost,
        f"{path}: {kind} holds one set of UVs; those of {scene.path.name} are replaced, a .glb would hold both",
    )
