"""Draw the pictures of the tutorials and how-to pages, from the meshes of sample_meshes.py.

    python docs/make_guide_pictures.py [NAME ...]

Writes first-bake.png, shadows.png, robot.png, dark.png, leaks.png and three.png to docs/pictures; with names, only
those. Needs Pillow; three.png needs node, Chromium and the packages of benchmarks/browser (`npm install` there).
"""

import dataclasses
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
import sample_meshes
import trimesh
from make_pictures import CELL, INK, PAPER, render_scene, write
from picture_meshes import as_scene
from PIL import Image

import aoprecalc as ao
from aoprecalc.api.bake_scene import bake_scene
from aoprecalc.gl.context import open_renderer
from aoprecalc.io import load_scene
from aoprecalc.progress import Progress
from aoprecalc.render.rasterizer import preview_panels
from aoprecalc.spheres import fit_sphere_set
from aoprecalc.types import Baked, Scene

HERE = Path(__file__).parent
BROWSER = HERE.parent / "benchmarks/browser"
GAP, HEAD = 16, 36


def side_by_side(panels: dict[str, Image.Image]) -> Image.Image:
    """Put pictures of one height into a row, each below its title."""
    width = sum(panel.width + GAP for panel in panels.values()) + GAP
    picture = Image.new("RGB", (width, HEAD + next(iter(panels.values())).height + GAP), PAPER)
    left = GAP
    for title, panel in panels.items():
        write(picture, (left, 10), title, 16, INK)
        picture.paste(panel, (left, HEAD))
        left += panel.width + GAP
    return picture


def z_up(solid: trimesh.Trimesh) -> Scene:
    """Make a Scene of a mesh whose y points up, turned for `render_scene`."""
    turned = solid.copy().apply_transform(np.linalg.inv(sample_meshes.Z_TO_Y))
    turned.apply_scale(1.9 / turned.scale)
    return as_scene([turned])


def first_bake(_: Path) -> Image.Image:
    """Draw the statue in ambient light without its texture, the texture, and the statue with it."""
    scene = z_up(sample_meshes.statue())
    baked = bake_scene(scene, ao.BakeOptions(size=1024))
    texture = Image.fromarray((255 * baked.texture.values).round().astype(np.uint8)).convert("RGB")
    bare = dataclasses.replace(baked.texture, values=np.ones_like(baked.texture.values))
    return side_by_side(
        {
            "in light from all around": rendered(scene, dataclasses.replace(baked, texture=bare)),
            "statue_ao.png": texture.resize((CELL, CELL), Image.Resampling.LANCZOS),
            "multiplied by the texture": rendered(scene, baked),
        }
    )


def spheres(file: Path, sets: dict[str, ao.SphereOptions], up: str) -> Image.Image:
    """Draw a mesh beside spheres of several methods, with the shadows that they cast."""
    scene = load_scene(file)
    fitted = [fit_sphere_set(scene, options, Progress())[0] for options in sets.values()]
    panels = preview_panels(scene, [(one.centers, one.radii) for one in fitted], (340, 300), up)
    return side_by_side(dict(zip([file.name, *sets], map(Image.fromarray, panels), strict=True)))


def shadows(folder: Path) -> Image.Image:
    """Draw the statue beside 64 spheres by lloyd and by shadow."""
    names = {f"--method {method}": ao.SphereOptions(64, method=method) for method in ("lloyd", "shadow")}
    return spheres(folder / "statue.obj", names, "y")


def robot(folder: Path) -> Image.Image:
    """Draw the robot's link beside spheres that contain it."""
    names = {
        "--method lloyd --radius cover": ao.SphereOptions(40, radius="cover"),
        "--method collision": ao.SphereOptions(40, method="collision"),
    }
    return spheres(folder / "robot.stl", names, "z")


def as_srgb(baked: Baked) -> Baked:
    """Return the texture as a program reads it that takes it for a colour."""
    values = baked.texture.values
    decoded = np.where(values <= 0.04045, values / 12.92, ((values + 0.055) / 1.055) ** 2.4).astype(np.float32)
    return dataclasses.replace(baked, texture=dataclasses.replace(baked.texture, values=decoded))


def rendered(scene: Scene, baked: Baked) -> Image.Image:
    """Draw a scene with its texture alone."""
    with open_renderer() as renderer:
        return render_scene(renderer.context, scene, baked, 0)


def dark(_: Path) -> Image.Image:
    """Draw three reasons why a texture looks dark."""
    scene = z_up(sample_meshes.rock(3))
    plain = bake_scene(scene, ao.BakeOptions(size=512))
    ground = bake_scene(scene, ao.BakeOptions(size=512, ground=True, up="z"))
    cases = {"read as data": plain, "read as sRGB": as_srgb(plain), "--ground, read as data": ground}
    return side_by_side({title: rendered(scene, baked) for title, baked in cases.items()})


def leaks(_: Path) -> Image.Image:
    """Draw a box that stands through a plate, at two sizes of the texture."""
    plate = trimesh.creation.box(bounds=[(-0.9, -0.9, -0.12), (0.9, 0.9, 0)])
    post = trimesh.creation.box(bounds=[(-0.3, -0.3, -0.06), (0.3, 0.3, 0.55)])
    scene = as_scene([plate, post])
    bakes = {size: bake_scene(scene, ao.BakeOptions(size=size, normals="flat")) for size in (64, 512)}
    return side_by_side({f"--size {size}": rendered(scene, baked) for size, baked in bakes.items()})


def three(folder: Path) -> Image.Image:
    """Photograph examples/three/index.html in Chromium, its ambient occlusion off and on."""
    ao.bake(folder / "car.glb", ao.BakeOptions(ground=True)).save(f"{folder}/")
    (folder / "index.html").write_bytes((HERE.parent / "examples/three/index.html").read_bytes())
    (folder / "node_modules").symlink_to(BROWSER / "node_modules")
    shots = []
    for mark in ("#off", ""):
        shot = folder / f"shot{len(shots)}.png"
        command = ["node", "photograph.mjs", folder, f"index.html{mark}", shot, "500x340"]
        subprocess.run(command, cwd=BROWSER, check=True)
        shots.append(Image.open(shot).convert("RGB"))
    picture = Image.new("RGB", (1000, 340))
    for number, shot in enumerate(shots):
        picture.paste(shot, (500 * number, 0))
    return picture


def main() -> None:
    """Write the pictures."""
    for make in (first_bake, shadows, robot, dark, leaks, three):
        name = make.__name__.replace("_", "-")
        if not sys.argv[1:] or name in sys.argv[1:]:
            with tempfile.TemporaryDirectory() as folder:
                sample_meshes.write(Path(folder))
                picture = make(Path(folder))
            picture.quantize(255, dither=Image.Dither.NONE).save(HERE / f"pictures/{name}.png", optimize=True)


if __name__ == "__main__":
    main()
