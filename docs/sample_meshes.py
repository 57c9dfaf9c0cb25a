"""Makes the meshes that the tutorials and how-to pages talk about.

    python docs/sample_meshes.py [FOLDER]

Writes statue.obj, car.glb, rock.glb (y up), robot.stl (z up), and assets/ with a few of the same for batches. Needs
Pillow, as trimesh does for textures.
"""

import argparse
from pathlib import Path

import numpy as np
import trimesh
from PIL import Image
from trimesh.transformations import rotation_matrix, translation_matrix
from trimesh.visual import TextureVisuals
from trimesh.visual.material import PBRMaterial

Z_TO_Y = rotation_matrix(-np.pi / 2, (1, 0, 0))

# statue: radius and height from the foot up. Its middle is fluted, and the flutes wind around it.
FOOT = [(0.0, 0.0), (0.5, 0.0), (0.5, 0.1), (0.4, 0.14), (0.44, 0.2), (0.4, 0.27), (0.27, 0.31)]
NECK = [(0.2, 1.15), (0.33, 1.19), (0.35, 1.24), (0.22, 1.29), (0.2, 1.35)]
HEAD = [(0.28, 1.42), (0.34, 1.5), (0.37, 1.6), (0.4, 1.72), (0.3, 1.72), (0.26, 1.6), (0.2, 1.54), (0.0, 1.53)]
FLUTES = 8

# car: half its width; heights of its underside and its top at places along x; where the wheels are, and their radii.
WIDTH, WHEELS, WHEEL_RADIUS, ARCH_RADIUS = 0.8, (-1.25, 1.25), 0.36, 0.46
UNDERSIDE = 0.3
TOP = [(-2.1, 0.72), (-2.0, 0.86), (-0.95, 0.98), (-0.45, 1.42), (0.75, 1.45), (1.45, 1.0), (2.0, 0.95), (2.1, 0.8)]


def spun(profile: np.ndarray, sections: int, flutes: np.ndarray) -> trimesh.Trimesh:
    """Turn a profile of (radius, height) about the y axis; `flutes` is the depth of grooves at each of its points."""
    radius, height = profile.T[:, :, None]
    angle = 2 * np.pi * np.arange(sections) / sections
    groove = 1 - flutes[:, None] * np.sin(FLUTES / 2 * (angle + 0.9 * height)) ** 2
    ring = np.stack([radius * groove * np.sin(angle), height + 0 * angle, radius * groove * np.cos(angle)], axis=-1)
    a = np.arange((len(profile) - 1) * sections)
    b = a // sections * sections + (a + 1) % sections
    faces = np.concatenate([np.stack([a, b, b + sections], 1), np.stack([a, b + sections, a + sections], 1)])
    solid = trimesh.Trimesh(ring.reshape(-1, 3).round(9), faces)  # joins the corners at the poles
    solid.update_faces(solid.nondegenerate_faces())
    return solid


def statue() -> trimesh.Trimesh:
    """Make a chess king of one closed surface, with wound flutes and a hollow crown."""
    share = np.linspace(0, 1, 40)[1:-1]
    body = np.column_stack([0.27 + 0.05 * np.sin(np.pi * share) - 0.06 * share, 0.31 + 0.84 * share])
    profile = np.concatenate([FOOT, body, NECK, HEAD])
    flutes = np.zeros(len(profile))
    flutes[len(FOOT) : len(FOOT) + len(body)] = 0.3 * np.sin(np.pi * share) ** 0.5
    return spun(profile, 96, flutes)


def strip(low: np.ndarray, high: np.ndarray, along: np.ndarray, half: float) -> trimesh.Trimesh:
    """Make a solid between two curves, heights over x, from z = -half to half."""
    n = len(along)
    rows = [np.column_stack([along, low]), np.column_stack([along, high])]
    corners = np.concatenate([np.column_stack([row, np.full(n, z)]) for z in (half, -half) for row in rows])
    i = np.arange(n - 1)
    quads = [
        np.stack([i, i + 1, i + 1 + n, i + n], 1),  # towards +z
        np.stack([i + 1, i, i + n, i + 1 + n], 1) + 2 * n,  # towards -z
        np.stack([i + n, i + 1 + n, i + 1 + 3 * n, i + 3 * n], 1),  # the top
        np.stack([i + 1, i, i + 2 * n, i + 1 + 2 * n], 1),  # the underside
        [(0, n, 3 * n, 2 * n), (n - 1, 3 * n - 1, 4 * n - 1, 2 * n - 1)],  # the ends
    ]
    quad = np.concatenate(quads)
    return trimesh.Trimesh(corners, np.concatenate([quad[:, [0, 1, 2]], quad[:, [0, 2, 3]]]), process=False)


def looks(name: str, color: tuple[int, int, int, int], rough: float = 0.9, **more: object) -> PBRMaterial:
    """Make a non-metallic material."""
    return PBRMaterial(name=name, baseColorFactor=color, metallicFactor=0.0, roughnessFactor=rough, **more)


def block(low: tuple[float, float, float], high: tuple[float, float, float]) -> trimesh.Trimesh:
    """Make a box."""
    return trimesh.creation.box(bounds=[low, high])


def car() -> trimesh.Scene:
    """Make a car: a painted body, glass, and a loaded roof rack, and four instances of one wheel."""
    along = np.unique(np.concatenate([np.linspace(-2.1, 2.1, 85), [x for x, _ in TOP]]).round(6))
    high = np.interp(along, *np.array(TOP).T)
    low = np.full(len(along), UNDERSIDE)
    for wheel in WHEELS:
        reach = ARCH_RADIUS**2 - (along - wheel) ** 2
        low = np.where(reach > 0, WHEEL_RADIUS + np.sqrt(np.maximum(0, reach)), low)
    body = strip(low, high, along, WIDTH)
    # Paint that repeats along the car: these UVs overlap, as those of many assets do.
    body = trimesh.Trimesh(
        body.vertices[body.faces].reshape(-1, 3), np.arange(3 * len(body.faces)).reshape(-1, 3), process=False
    )
    stripes = np.full((64, 64, 3), (205, 70, 50), np.uint8)
    stripes[26:32] = stripes[36:38] = (240, 235, 225)
    uv = body.vertices[:, [0, 1]] * (0.5, 0.7)
    paint = looks("paint", (255, 255, 255, 255), 0.5, baseColorTexture=Image.fromarray(stripes))
    body.visual = TextureVisuals(uv, material=paint)

    panes = []
    for left, side in ((-0.35, 1), (0.22, 1), (-0.35, -1), (0.22, -1)):
        x, z = (left, left + 0.5)[::side], side * (WIDTH + 0.01)
        panes.append(
            trimesh.Trimesh([(x[0], 1.0, z), (x[1], 1.0, z), (x[1], 1.34, z), (x[0], 1.34, z)], [(0, 1, 2), (0, 2, 3)])
        )
    glass = trimesh.util.concatenate(panes)
    glass.visual = TextureVisuals(material=looks("glass", (170, 200, 215, 110), 0.1, alphaMode="BLEND"))

    rails = [block((-0.4, 1.5, z - 0.03), (0.75, 1.54, z + 0.03)) for z in (-0.6, 0.6)]
    bars = [block((x - 0.04, 1.55, -0.68), (x + 0.04, 1.58, 0.68)) for x in (-0.3, 0.15, 0.6)]
    bumpers = [block((x - 0.06, 0.4, -0.75), (x + 0.06, 0.52, 0.75)) for x in (-2.2, 2.2)]
    steel = trimesh.util.concatenate([*rails, *bars, *bumpers])
    steel.visual = TextureVisuals(material=looks("steel", (190, 190, 195, 255), 0.4))
    trunk = block((-0.35, 1.59, -0.5), (0.65, 1.9, 0.35))
    trunk.visual = TextureVisuals(material=looks("leather", (130, 85, 55, 255), 0.7))

    tyre = trimesh.creation.annulus(0.2, WHEEL_RADIUS, 0.26, sections=48)
    hub = trimesh.creation.cylinder(0.15, 0.1, sections=32)
    tyre.visual = TextureVisuals(material=looks("rubber", (45, 45, 48, 255)))
    hub.visual = TextureVisuals(material=steel.visual.material)

    scene = trimesh.Scene()
    for name, solid in (("body", body), ("windows", glass), ("roof rack", steel), ("trunk", trunk)):
        scene.add_geometry(solid, node_name=name, geom_name=name)
    scene.geometry["tyre"], scene.geometry["hub"] = tyre, hub
    for number, (x, z) in enumerate([(x, z) for x in WHEELS for z in (-0.62, 0.62)], 1):
        for part in ("tyre", "hub"):
            scene.graph.update(f"{part} {number}", matrix=translation_matrix((x, WHEEL_RADIUS, z)), geometry=part)
    return scene


def rock(seed: int = 1, dents: int = 14) -> trimesh.Trimesh:
    """Make a ball with round dents, flattened."""
    solid = trimesh.creation.icosphere(5)
    middles = np.random.default_rng(seed).normal(size=(dents, 3))
    middles /= np.linalg.norm(middles, axis=1, keepdims=True)
    depth = 0.45 * np.exp((solid.vertices @ middles.T - 1) / 0.05).sum(axis=1)
    solid.vertices *= (1 - np.minimum(depth, 0.6))[:, None] * (1.2, 0.8, 1.0)
    solid.visual = TextureVisuals(material=looks("stone", (150, 145, 135, 255)))
    return solid


def robot() -> trimesh.Trimesh:
    """Make a link of a robot's arm, in metres, its joints about the z axis."""
    shoulder = trimesh.creation.cylinder(0.07, 0.14, sections=48)
    elbow = trimesh.creation.cylinder(0.05, 0.1, sections=48).apply_translation((0.4, 0, 0.02))
    beam = trimesh.creation.box(bounds=[(0.03, -0.035, -0.03), (0.38, 0.035, 0.03)])
    return trimesh.util.concatenate([shoulder, beam, elbow])


def write(folder: Path) -> None:
    """Write all of them into a folder."""
    for name in ("props", "wip"):
        (folder / "assets" / name).mkdir(parents=True, exist_ok=True)
    statue().export(folder / "statue.obj", header=None, include_normals=False)
    car().export(folder / "car.glb")
    rock().export(folder / "rock.glb")
    robot().export(folder / "robot.stl")
    statue().export(folder / "assets/hero.obj", header=None, include_normals=False)
    for seed, name in enumerate(("props/rock", "props/boulder", "wip/pebble"), 1):
        rock(seed).export(folder / f"assets/{name}.glb")


def main() -> None:
    """Write the meshes into the folder named on the command line, by default the present one."""
    parser = argparse.ArgumentParser(description="Make the meshes of the tutorials.")
    parser.add_argument("folder", nargs="?", type=Path, default=Path())
    write(parser.parse_args().folder)


if __name__ == "__main__":
    main()
