"""Draw the pictures of README.md and of the explanation pages, from meshes that are made here or in examples/.

    python docs/make_pictures.py [NAME ...]

Writes before_after.png, borders.png, sides.png and spheres.png to docs/pictures; with names, only those pictures. Needs
Pillow. (benchmarks/speed.py draws speed.png.)
"""

import sys
from pathlib import Path

import moderngl
import numpy as np
from picture_meshes import HALF_BOX, SIZE, as_scene, chair, cup, in_a_box, inside_out, leaning_wall, octopus, plant
from PIL import Image, ImageDraw, ImageFont

from aoprecalc import BakeOptions, SphereOptions
from aoprecalc.api.bake_scene import bake_scene
from aoprecalc.gl.context import open_renderer
from aoprecalc.progress import Progress
from aoprecalc.raster.layout import build_layout
from aoprecalc.render.rasterizer import preview_panels
from aoprecalc.spheres import fit_sphere_set
from aoprecalc.types import Baked, Scene

HERE = Path(__file__).parent
EXAMPLES = HERE.parent / "examples"
SHADERS = {f"{stage}_shader": (HERE / f"shaders/{stage}.glsl").read_text("utf-8") for stage in ("vertex", "fragment")}
DIRECTIONS, SAMPLES = 1000, 100_000  # of every bake and every fit
PAPER, INK, SOFT, OUTLINE = (247, 247, 245), (38, 42, 48), (104, 110, 118), (222, 40, 60)

ZOOM = 6  # pixels per texel in borders.png
READ_COLOR, PADDING_COLOR = (240, 130, 40), (70, 130, 230)
CELL, SUPERSAMPLING = 290, 4  # of sides.png: pixels per side of a cell, and samples per pixel along each axis
CAMERA_DIRECTION = np.array([0.34, -0.76, 0.56]) / np.linalg.norm([0.34, -0.76, 0.56])  # camera direction
FLAT = {-1: (0.70, 0.30, 0.17), -2: (0.86, 0.46, 0.30), -3: (0.52, 0.21, 0.12), -4: (0.62, 0.67, 0.73)}  # linear
PANEL = (420, 340)  # pixels of a cell of spheres.png
STUDIO = (620, 372)  # pixels of a half of before_after.png


def write(picture: Image.Image, position: tuple[int, int], text: str, size: int = 16, color: tuple = INK) -> None:
    """Write lines of text with their upper left corner at `position`."""
    ImageDraw.Draw(picture).text(position, text, fill=color, font=ImageFont.load_default(size=size), spacing=5)


def borders() -> Image.Image:
    """Draw one texture at four stages: covered texels, padding, and two ways of filling the rest."""
    scene, (width, height) = leaning_wall(), SIZE
    # Depth maps far finer than `auto` would choose, so that every visible step is the texture's.
    settings = {"width": width, "height": height, "directions": DIRECTIONS, "unwrap": "keep", "normals": "flat"}
    settings["shadow_size"] = 2048
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
        options = BakeOptions(width=512, height=512, directions=DIRECTIONS, crease_angle=50, two_sided=bool(row))
        baked, top = [bake_scene(scene, options) for scene in scenes], 36 + head + row * (head + CELL + foot)
        write(picture, (gap, top - 30), title, 18)
        with open_renderer() as renderer:
            for column, (name, case) in enumerate(CASES.items()):
                left, box = gap + column * (CELL + gap), 0 if column else 12
                write(picture, (left, 12), name, 16, SOFT)
                picture.paste(render_scene(renderer.context, scenes[column], baked[column], box), (left, top))
                write(picture, (left, top + CELL + 6), case[1 + row])
    return picture


def spheres() -> Image.Image:
    """Draw figure 1.5 of *Précalcul*: meshes, and 100 spheres fitted to 100,000 samples by two methods."""
    rows = []
    for scene in (octopus(), chair()):
        methods = [SphereOptions(samples=SAMPLES, method=method) for method in ("lloyd", "shadow")]
        sets = [fit_sphere_set(scene, options, Progress())[0] for options in methods]
        panels = preview_panels(scene, [(spheres.centers, spheres.radii) for spheres in sets], PANEL)
        rows.append(np.concatenate(panels, axis=1))
    cells, head = Image.fromarray(np.concatenate(rows)), 40
    picture = Image.new("RGB", (cells.width, cells.height + head), PAPER)
    picture.paste(cells, (0, head))
    for column, title in enumerate(("mesh", "--method lloyd, 100 spheres", "--method shadow, 100 spheres")):
        write(picture, (column * PANEL[0] + 20, 14), title)
    return picture


def before_after() -> Image.Image:
    """Draw a mesh in even light, and with its texture and the shadow of its spheres, by the shaders of examples/."""
    sys.path.insert(0, str(EXAMPLES))
    from make_meshes import colonnade

    from render import draw

    scene = as_scene([colonnade()])
    baked = bake_scene(scene, BakeOptions(directions=DIRECTIONS, crease_angle=40))
    fitted = fit_sphere_set(scene, SphereOptions(300, samples=SAMPLES, method="shadow"), Progress())[0]
    corners = np.concatenate([scene.corners, baked.normals, baked.atlas.uvs], axis=2).reshape(-1, 8)
    nowhere = np.array([[0.0, 1e6, 0.0, 1e-6]])
    open_everywhere = np.ones((1, 1), np.float32)
    cast = np.column_stack([fitted.centers, fitted.radii])
    picture = Image.new("RGB", (2 * STUDIO[0] + 8, STUDIO[1]), PAPER)
    with open_renderer() as renderer:
        for column, (title, occlusion, balls) in enumerate(
            (
                ("Before", open_everywhere, nowhere),
                ("After: ambient occlusion, and a shadow cast by 300 spheres", baked.texture.values, cast),
            )
        ):
            left = column * (STUDIO[0] + 8)
            picture.paste(draw(renderer.context, corners, occlusion, balls, STUDIO), (left, 0))
            write(picture, (left + 16, 12), title)
    return picture


def main() -> None:
    """Write the pictures."""
    (HERE / "pictures").mkdir(exist_ok=True)
    for make in (before_after, borders, sides, spheres):
        if not sys.argv[1:] or make.__name__ in sys.argv[1:]:
            make().save(HERE / f"pictures/{make.__name__}.png", optimize=True)


if __name__ == "__main__":
    main()
