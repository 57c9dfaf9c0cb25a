"""Makes a glTF scene in which parts differ in what light does at them.

    python examples/make_scene.py [FOLDER]

Writes terrace.glb (y up): a table with a top of glass, four instances of one chair, and a plant whose leaves are
squares with holes, on a slab. Needs Pillow, as trimesh does for textures.
"""

import argparse
from pathlib import Path

import numpy as np
import trimesh
from PIL import Image
from trimesh.transformations import rotation_matrix, translation_matrix
from trimesh.visual import TextureVisuals
from trimesh.visual.material import PBRMaterial

LEAF = 64  # texels of its picture
UP = (0, 1, 0)


def material(name: str, color: tuple[int, int, int, int], **more: object) -> PBRMaterial:
    """Make a rough, non-metallic material of an RGBA colour."""
    return PBRMaterial(name=name, baseColorFactor=color, metallicFactor=0.0, roughnessFactor=0.9, **more)


def block(low: tuple[float, float, float], high: tuple[float, float, float]) -> trimesh.Trimesh:
    """Make a box."""
    return trimesh.creation.box(bounds=[low, high])


def chair() -> trimesh.Trimesh:
    """Make a chair that looks along +z, its feet about the origin."""
    legs = [block((x - 0.03, 0, z - 0.03), (x + 0.03, 0.45, z + 0.03)) for x in (-0.2, 0.2) for z in (-0.2, 0.2)]
    slats = [block((x - 0.03, 0.45, -0.23), (x + 0.03, 0.95, -0.19)) for x in (-0.18, -0.06, 0.06, 0.18)]
    solid = trimesh.util.concatenate([block((-0.24, 0.45, -0.24), (0.24, 0.5, 0.24)), *legs, *slats])
    solid.visual = TextureVisuals(material=material("wood", (150, 105, 70, 255)))
    return solid


def leaves(count: int = 26) -> trimesh.Trimesh:
    """Make squares that lean outwards around a stem, each with the picture of one leaf, cut out by its alpha."""
    square = np.array([(-0.5, 0.0, 0.0), (0.5, 0.0, 0.0), (0.5, 1.0, 0.0), (-0.5, 1.0, 0.0)])
    corners = []
    for number in range(count):
        lean, turn = 0.2 + 1.1 * number / count, number * 2.39996  # the golden angle
        placed = trimesh.transform_points(square * 0.42, rotation_matrix(lean, (1, 0, 0)))
        corners.append(trimesh.transform_points(placed, rotation_matrix(turn, UP)) + (0, 0.35, 0))
    first = 4 * np.arange(count)[:, None]
    faces = np.concatenate([first + (0, 1, 2), first + (0, 2, 3)])
    uv = np.tile([(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)], (count, 1))
    x, y = (np.indices((LEAF, LEAF))[::-1] + 0.5) / LEAF
    width = 0.38 * np.sin(np.pi * np.clip(1 - y, 0, 1)) ** 0.7
    alpha = np.clip(0.5 + 20 * (width - np.abs(x - 0.5)), 0, 1)
    picture = np.dstack([np.full((LEAF, LEAF), shade) for shade in (70, 130, 60)] + [255 * alpha]).astype(np.uint8)
    leaf = material("leaf", (255, 255, 255, 255), baseColorTexture=Image.fromarray(picture))
    leaf.alphaMode, leaf.doubleSided = "MASK", True
    return trimesh.Trimesh(np.concatenate(corners), faces, process=False, visual=TextureVisuals(uv, material=leaf))


def terrace() -> trimesh.Scene:
    """Put everything on a slab."""
    scene = trimesh.Scene()
    slab, pot = block((-2.2, -0.15, -1.8), (2.2, 0, 1.8)), trimesh.creation.cylinder(0.22, 0.4)
    pot.apply_transform(translation_matrix((0, 0.2, 0)) @ rotation_matrix(np.pi / 2, (1, 0, 0)))
    frame = trimesh.util.concatenate(
        [block((x - 0.04, 0, z - 0.04), (x + 0.04, 0.72, z + 0.04)) for x in (-0.7, 0.7) for z in (-0.35, 0.35)]
    )
    top = block((-0.8, 0.72, -0.45), (0.8, 0.76, 0.45))
    for solid, appearance in (
        (slab, material("stone", (190, 190, 185, 255))),
        (pot, material("clay", (170, 95, 70, 255))),
        (frame, material("steel", (120, 125, 130, 255))),
        (top, material("glass", (200, 230, 235, 70), alphaMode="BLEND")),
    ):
        solid.visual = TextureVisuals(material=appearance)
    for name, solid in (("slab", slab), ("table frame", frame), ("table top", top)):
        scene.add_geometry(solid, node_name=name, geom_name=name)
    for name, solid in (("pot", pot), ("leaves", leaves())):
        scene.add_geometry(solid, node_name=name, geom_name=name, transform=translation_matrix((1.6, 0, -1.2)))
    places = [(-0.4, 0.75, np.pi), (0.4, 0.75, np.pi), (-0.4, -0.75, 0), (0.4, -0.75, 0.3)]
    scene.geometry["chair"] = chair()
    for number, (x, z, turn) in enumerate(places, 1):
        placed = translation_matrix((x, 0, z)) @ rotation_matrix(turn, UP)
        scene.graph.update(f"chair {number}", matrix=placed, geometry="chair")
    return scene


def main() -> None:
    """Write the scene into the folder named on the command line, by default the present one."""
    parser = argparse.ArgumentParser(description="Make the example scene.")
    parser.add_argument("folder", nargs="?", type=Path, default=Path())
    folder = parser.parse_args().folder
    folder.mkdir(parents=True, exist_ok=True)
    terrace().export(folder / "terrace.glb")


if __name__ == "__main__":
    main()
