"""Draw the README's pictures.

    python docs/make_pictures.py [NAME ...]

Writes borders.png and sides.png from small generated meshes, and spheres.png from two of ../shared/meshes, to
docs/pictures; with names, only those pictures. Needs Pillow.
"""

import sys
from pathlib import Path

import moderngl
import numpy as np
from picture_meshes import HALF_BOX, SIZE, cup, in_a_box, inside_out, leaning_wall, plant
from PIL import Image, ImageDraw, ImageFont

from aoprecalc import BakeOptions, SphereOptions
from aoprecalc.api.bake_scene import bake_scene
from aoprecalc.gl.context import open_renderer
from aoprecalc.io import load_scene
from aoprecalc.progress import Progress
from aoprecalc.raster.layout import build_layout
from aoprecalc.render import preview_panels
from aoprecalc.spheres import fit_sphere_set
from aoprecalc.types import Baked, Scene

HERE = Path(__file__).parent
MESHES = HERE.resolve().parents[1] / "shared" / "meshes"
SHADERS = {f"{stage}_shader": (HERE / f"shaders/{stage}.glsl").read_text("utf-8") for stage in ("vertex", "fragment")}
PAPER, INK, SOFT, OUTLINE = (247, 247, 245), (38, 42, 48), (104, 110, 118), (222, 40, 60)

ZOOM = 6  # pixels per texel in borders.png
READ_COLOR, PADDING_COLOR = (240, 130, 40), (70, 130, 230)
CELL, SUPERSAMPLING = 290, 4  # of sides.png: pixels per side of a cell, and samples per pixel along each axis
CAMERA_DIRECTION = np.array([0.34, -0.76, 0.56]) / np.linalg.norm([0.34, -0.76, 0.56])  # camera direction
FLAT = {-1: (0.70, 0.30, 0.17), -2: (0.86, 0.46, 0.30), -3: (0.52, 0.21, 0.12), -4: (0.62, 0.67, 0.73)}  # linear
SPHERE_MESHES = [("bigguy.obj", "y"), ("fruitfly_assembled_welded.ply", "z")]  # of spheres.png, with their up axes
PANEL = (420, 340)  # pixels of a cell of spheres.png


def write(picture: Image.Image, position: tuple[int, int], text: str, size: int = 16, color: tuple = INK) -> None:
    """Write lines of text with their upper left corner at `position`."""
    ImageDraw.Draw(picture).text(position, text, fill=color, font=ImageFont.load_default(size=size), spacing=5)


def borders() -> Image.Image:
    """Draw one texture at four stages: covered texels, padding, and two ways of filling the rest."""
    scene, (width, height) = leaning_wall(), SIZE
    # Depth maps far finer than `auto` would choose, so that every visible step is the texture's.
    settings = {"width": width, "height": height, "unwrap": "keep", "normals": "flat", "shadow_size": 2048}
    bakes = [(0, "none"), (8, "none"), (8, "mean"), (8, "pushpull")]
    baked = [bake_scene(scene, BakeOptions(padding=padding, fill=fill, **settings)) for padding, fill in bakes]
    bare, padded, mean, pushpull = (255 * one.texture.values[..., None] for one in baked)
    covered = baked[0].texture.valid[..., None]
    lines = build_layout(scene, baked[0].atlas, width, height).borders[:, :2]

    squares = np.where(np.indices((height, width)).sum(axis=0) % 2, 236, 250)[..., None]
    tinted = np.where(covered, padded, 0.5 * padded + 0.5 * np.where(bare > 0, READ_COLOR, PADDING_COLOR))
    panels = {
        "1  Texels that the surface covers, wholly or in part": np.where(covered, bare, squares),
        "2  Others that look-ups on it read (orange); padding (blue)": np.where(padded > 0, tinted, squares),
        "3  The rest: --fill mean": mean,
        "4  The rest: --fill pushpull": pushpull,
    }
    wide, high, gap, head = width * ZOOM, height * ZOOM, 20, 32
    picture = Image.new("RGB", (2 * wide + 3 * gap, 2 * (high + head) + gap), PAPER)
    for number, (title, texels) in enumerate(panels.items()):
        left, top = gap + number % 2 * (wide + gap), head + number // 2 * (high + head)
        panel = Image.fromarray(np.broadcast_to(texels.round(), (height, width, 3)).astype(np.uint8))
        panel = panel.resize((4 * wide, 4 * high), Image.Resampling.NEAREST)
        for start, end in 4 * ZOOM * lines:
            ImageDraw.Draw(panel).line([*start, *end], fill=OUTLINE, width=6)
        picture.paste(panel.resize((wide, high), Image.Resampling.BOX), (left, top))
        write(picture, (left, top - 24), title)
    return picture


CASES = {
    "One part inside another": (
        in_a_box,
        "The box is cut open for the view.\nWhat lies inside sees no light: 0.",
        "The same: neither side of what\nlies inside sees any light.",
    ),
    "Closed, but its faces look inwards": (
        inside_out,
        "The faces see the ring's inside:\n0 everywhere, and a warning.",
        "Right: the outer side is lighter.",
    ),
    "A cup of one layer, faces inwards": (
        cup,
        "Right inside; the outside shows\nthe same texels.",
        "Right outside, as that is lighter;\nthe inside shows the same texels.",
    ),
    "Leaves, every second one upside down": (
        plant,
        "Three leaves show the value of\ntheir lower side from above, too.",
        "All leaves show the value of\ntheir lighter side.",
    ),
}


def render_scene(context: moderngl.Context, scene: Scene, baked: Baked, box: int) -> Image.Image:
    """Render a scene with its texture, orthographically; its first `box` faces are a box that is cut open."""
    image = baked.texture.values
    context.texture(image.shape[::-1], 1, np.flipud(image).tobytes(), dtype="f4").use()
    right = np.cross((0, 0, 1), CAMERA_DIRECTION) / np.linalg.norm(CAMERA_DIRECTION[:2])
    view = scene.corners @ np.stack([right, np.cross(CAMERA_DIRECTION, right), CAMERA_DIRECTION]).T
    view -= (view.min(axis=(0, 1)) + view.max(axis=(0, 1))) / 2
    corners = np.concatenate([view, scene.corners, baked.atlas.uvs], axis=2).astype("f4")
    side = CELL * SUPERSAMPLING
    target = context.simple_framebuffer((side, side), 4, dtype="f4")
    target.use()
    target.clear(min(FLAT), 2.0, depth=1.0)
    context.enable_only(moderngl.DEPTH_TEST)
    program = context.program(**SHADERS)
    for half_box, faces in ((HALF_BOX, corners[:box]), ((0, 0, 0), corners[box:])):
        if len(faces):
            program["box"] = half_box
            context.vertex_array(program, context.buffer(faces.tobytes()), "seen", "position", "uv").render()
    value, depth = np.frombuffer(target.read(components=2, dtype="f4"), "f4").reshape(side, side, 2).transpose(2, 0, 1)
    color = np.clip(value, 0, 0.97)[..., None].repeat(3, axis=2)
    for key, flat in FLAT.items():
        color[value == key] = flat
    for axis, step in np.ndindex(2, 7):  # outlines at depth discontinuities
        color[np.roll(depth, step - 3, axis) - depth > 0.03] = 0.05
    color = color[::-1].reshape(CELL, SUPERSAMPLING, CELL, SUPERSAMPLING, 3).mean(axis=(1, 3))
    encoded = np.where(color < 0.0031308, 12.92 * color, 1.055 * np.maximum(color, 1e-9) ** (1 / 2.4) - 0.055)
    return Image.fromarray((255 * encoded).round().astype(np.uint8))


def sides() -> Image.Image:
    """Draw four scenes, baked by default in the upper row and with --two-sided in the lower."""
    scenes = [case[0]() for case in CASES.values()]
    gap, head, foot = 16, 40, 60
    picture = Image.new("RGB", (4 * (CELL + gap) + gap, 36 + 2 * (head + CELL + foot)), PAPER)
    for row, title in enumerate(("aoprecalc bake MESH", "aoprecalc bake MESH --two-sided")):
        options = BakeOptions(width=512, height=512, crease_angle=50, two_sided=bool(row))
        baked, top = [bake_scene(scene, options) for scene in scenes], 36 + head + row * (head + CELL + foot)
        write(picture, (gap, top - 30), title, 18)
        with open_renderer() as renderer:
            for column, (name, case) in enumerate(CASES.items()):
                left, box = gap + column * (CELL + gap), 0 if column else 12
                write(picture, (left, 12), name, 16, SOFT)
                picture.paste(render_scene(renderer.context, scenes[column], baked[column], box), (left, top))
                write(picture, (left, top + CELL + 6), case[1 + row])
    return picture


def spheres() -> Image.Image | None:
    """Draw figure 1.5 of *Précalcul*: meshes, and 100 spheres fitted to 100,000 samples by two methods."""
    rows = []
    for name, up in SPHERE_MESHES:
        if not (MESHES / name).exists():
            print(f"spheres.png: without {name}, which is not in {MESHES}")
            continue
        scene = load_scene(MESHES / name)
        sets = [fit_sphere_set(scene, SphereOptions(method=method), Progress())[0] for method in ("lloyd", "shadow")]
        panels = preview_panels(scene, [(spheres.centers, spheres.radii) for spheres in sets], PANEL, up)
        rows.append(np.concatenate(panels, axis=1))
    if not rows:
        return None
    cells, head = Image.fromarray(np.concatenate(rows)), 40
    picture = Image.new("RGB", (cells.width, cells.height + head), PAPER)
    picture.paste(cells, (0, head))
    for column, title in enumerate(("mesh", "--method lloyd, 100 spheres", "--method shadow, 100 spheres")):
        write(picture, (column * PANEL[0] + 20, 14), title)
    return picture


def main() -> None:
    """Write the pictures."""
    (HERE / "pictures").mkdir(exist_ok=True)
    for make in (borders, sides, spheres):
        if (not sys.argv[1:] or make.__name__ in sys.argv[1:]) and (picture := make()):
            picture.save(HERE / f"pictures/{make.__name__}.png", optimize=True)


if __name__ == "__main__":
    main()
