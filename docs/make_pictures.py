"""Make the pictures of README.md and of the documentation with aoprecalc itself, from meshes that code makes.

    python docs/make_pictures.py [NAME ...]

Writes docs/pictures/NAME.png; without names, all of them. three.png, report.png and report-batch.png are photographs of
Chromium, which need what scripts/setup-viewer and scripts/setup-browser install. (benchmarks/speed.py draws speed.png.)
"""

import contextlib
import functools
import http.server
import io
import shutil
import sys
import tempfile
import threading
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import picture_meshes
import sample_meshes
import trimesh
from PIL import Image, ImageDraw

import aoprecalc as ao
from aoprecalc.io.images import write_image
from aoprecalc.render.comparison import contact_sheet
from aoprecalc.texture_lookup import bilinear

HERE = Path(__file__).parent
EXAMPLES = HERE.parent / "examples"
DIRECTIONS, SAMPLES = 500, 50_000  # of every bake and every fit
CELL = (340, 340)  # pixels of one view among several
OUTLINE, READ_COLOR, PADDING_COLOR = (222, 40, 60), (240, 130, 40), (70, 130, 230)
TOWARDS_CAMERA = np.array([0.41, -0.91, 0.0])  # of a mesh whose z axis points up, on the ground
PAGE_WIDTH = 900  # pixels of a whole sheet
ZOOM = 6  # pixels per texel in borders.png

Picture = np.ndarray  # (height, width, 3) uint8 sRGB


def baked(mesh: ao.Mesh | trimesh.Trimesh | Path | str, **options: object) -> ao.BakeResult:
    """Bake a mesh with the directions of all pictures."""
    return ao.bake(mesh, ao.BakeOptions(directions=DIRECTIONS, **options))


def drawn(result: ao.BakeResult, size: tuple[int, int] = CELL, **options: object) -> Picture:
    """Draw a result."""
    return result.preview(ao.PreviewOptions(size=size, **options))


def fitted(mesh: trimesh.Trimesh | Path | str, count: int, **options: object) -> ao.SphereResult:
    """Fit spheres to a mesh."""
    return ao.fit_spheres(mesh, ao.SphereOptions(count, samples=SAMPLES, **options))


def with_spheres(result: ao.BakeResult, spheres: ao.SphereResult, size: tuple[int, int], **options: object) -> Picture:
    """Draw a result beside, or under, its spheres."""
    return ao.preview(result.mesh, ao.PreviewOptions(size=size, **options), spheres=spheres).image


def right_half(picture: Picture) -> Picture:
    """Cut off the panel of the mesh."""
    return picture[:, picture.shape[1] // 2 :]


def gray(values: np.ndarray, size: tuple[int, int] = CELL) -> Picture:
    """Show a texture as an 8-bit file of it looks."""
    return np.asarray(Image.fromarray((255 * values).round().astype(np.uint8)).resize(size).convert("RGB"))


# Previews


def before_after(_: Path) -> Picture:
    """The colonnade in clay, with its own shadow; with its texture, and the shadow that its spheres cast."""
    sys.path.insert(0, str(EXAMPLES))
    from make_meshes import colonnade

    mesh = colonnade()
    result, spheres = baked(mesh, crease_angle=40), fitted(mesh, 300, method="shadow")
    before, after = (
        with_spheres(result, spheres, (1240, 440), ground=True, spheres_view="over", shading=shading)
        for shading in ("clay", "ao")
    )
    names = ("without ambient occlusion", "with it; 300 spheres cast the shadow")
    return contact_sheet([(before[:, :620], names[0]), (right_half(after), names[1])], 2)


def preview(folder: Path) -> Picture:
    """The picture that `aoprecalc preview` makes by default."""
    return drawn(baked(folder / "statue.obj"), (800, 600))


def preview_material(folder: Path) -> Picture:
    """The car with its base colours, without and with ambient occlusion."""
    return drawn(baked(folder / "car.glb", ground=True), (800, 500), shading="material")


def preview_ground(folder: Path) -> Picture:
    """The statue's own shadow, and that of its spheres."""
    mesh = folder / "statue.obj"
    return with_spheres(baked(mesh), fitted(mesh, 64, method="shadow"), (1000, 480), ground=True)


def preview_views(folder: Path) -> Picture:
    """Four views of the car."""
    options = ao.PreviewOptions(size=(400, 280), views=4)
    return ao.preview(baked(folder / "car.glb", ground=True).mesh, options).image


def first_bake(folder: Path) -> Picture:
    """The statue in clay, the texture, and the statue with it."""
    result = baked(folder / "statue.obj")
    cells = [(drawn(result, shading="clay"), "without the texture"), (gray(result.ao), "statue_ao.png")]
    return contact_sheet([*cells, (drawn(result), "with the texture")], 3)


def methods(mesh: trimesh.Trimesh | Path, count: int, columns: Sequence[dict], **options: object) -> list:
    """A mesh, and spheres by several methods, each with its shadow, as cells."""
    result = baked(mesh, crease_angle=40)
    wide = (2 * CELL[0], CELL[1])
    views = [with_spheres(result, fitted(mesh, count, **kind), wide, ground=True, **options) for kind in columns]
    named = [option_words(kind) for kind in columns]
    return [
        (views[0][:, : CELL[0]], "mesh"),
        *((right_half(view), name) for view, name in zip(views, named, strict=True)),
    ]


def shadows(folder: Path) -> Picture:
    """The statue beside 64 spheres by lloyd and by shadow."""
    return contact_sheet(methods(folder / "statue.obj", 64, [{"method": "lloyd"}, {"method": "shadow"}]), 3)


def robot(folder: Path) -> Picture:
    """The robot's link beside spheres that contain it."""
    kinds = [{"method": "lloyd", "radius": "cover"}, {"method": "collision"}]
    return contact_sheet(methods(folder / "robot.stl", 40, kinds, up="z"), 3)


def spheres(_: Path) -> Picture:
    """Figure 1.5 of *Précalcul*: meshes, and 100 spheres fitted to 100,000 samples by two methods."""
    kinds = [{"method": "lloyd"}, {"method": "shadow"}]
    return contact_sheet(
        [*methods(picture_meshes.octopus(), 100, kinds), *methods(picture_meshes.chair(), 100, kinds)], 3
    )


def dark(_: Path) -> Picture:
    """Three reasons why a texture looks dark."""
    rock = sample_meshes.rock(3)
    plain, ground = baked(rock, size=512), baked(rock, size=512, ground=True)
    values = plain.ao
    as_colour = np.where(values <= 0.04045, values / 12.92, ((values + 0.055) / 1.055) ** 2.4).astype(np.float32)
    wrong = ao.preview(plain.mesh, ao.PreviewOptions(size=CELL), texture=as_colour).image
    cells = [(drawn(plain), "read as data"), (wrong, "read as sRGB")]
    return contact_sheet([*cells, (drawn(ground), "--ground, read as data")], 3)


def leaks(_: Path) -> Picture:
    """A box that stands through a plate, at two sizes of the texture."""
    plate = trimesh.creation.box(bounds=[(-0.9, -0.12, -0.9), (0.9, 0, 0.9)])
    post = trimesh.creation.box(bounds=[(-0.3, -0.06, -0.3), (0.3, 0.55, 0.3)])
    mesh = trimesh.util.concatenate([plate, post])
    results = {size: baked(mesh, size=size, normals="flat") for size in (64, 512)}
    cells = [(drawn(result, (440, 340), elevation=42), f"--size {size}") for size, result in results.items()]
    return contact_sheet(cells, 2)


def occlusion(_: Path) -> Picture:
    """The colonnade with each option that says what counts as occlusion."""
    sys.path.insert(0, str(EXAMPLES))
    from make_meshes import colonnade

    mesh = colonnade()
    kinds: list[dict] = [
        {},
        {"max_distance": "10%"},
        {"max_distance": "10%", "falloff": "linear"},
        {"max_distance": "10%", "falloff": "smooth"},
        {"cone": 90},
        {"weight": "uniform"},
    ]
    results = [baked(mesh, crease_angle=40, size=512, **kind) for kind in kinds]
    views = [drawn(result, (360, 300)) for result in results]
    named = [option_words(kind) or "default" for kind in kinds]
    return contact_sheet(list(zip(views, named, strict=True)), 3)


def several_textures(folder: Path) -> Picture:
    """The car with a texture for each material, and these textures."""
    result = baked(folder / "car.glb", size=512, textures="material", ground=True)
    cells = [(drawn(result), "the car")]
    for texture in result.textures:
        grey = Image.fromarray(np.floor(255 * texture.ao + 0.5).astype(np.uint8)).convert("RGB").resize(CELL)
        cells.append((np.asarray(grey), f"car_ao.{texture.name}.png"))
    return contact_sheet(cells, 3)


def high_to_low(_: Path) -> Picture:
    """A ball with studs, a plain one, and that with the ambient occlusion of the studs."""
    detailed, simple = picture_meshes.studded(6, 0.08), picture_meshes.studded(3, 0.0)
    bakes = [baked(detailed), baked(simple), ao.bake(simple, ao.BakeOptions(directions=DIRECTIONS), high=[detailed])]
    views = [drawn(result, shading="ao") for result in bakes]
    names = (
        f"detailed: {len(detailed.faces):,} triangles",
        f"simple: {len(simple.faces):,} triangles",
        "simple, with the AO of the detailed mesh",
        "its texture",
    )
    return contact_sheet(list(zip([*views, gray(bakes[-1].ao)], names, strict=True)), 2)


def ground_height(folder: Path) -> Picture:
    """The statue on the ground, above it, and in it."""
    options = {"ground": True, "max_distance": "40%", "falloff": "smooth", "size": 512}
    kinds: list[dict] = [{}, {"ground_height": -0.5}, {"ground_height": 0.4}]
    results = [baked(folder / "statue.obj", **options, **kind) for kind in kinds]
    named = [f"--ground {option_words(kind)}" for kind in kinds]
    return contact_sheet([(drawn(result), name) for result, name in zip(results, named, strict=True)], 3)


def backfaces(_: Path) -> Picture:
    """A floor with a ball, under a roof that is one sheet which faces up: with its back, and without."""
    floor, ball = trimesh.creation.box((3, 0.2, 3)), trimesh.creation.icosphere(4, 0.4)
    floor.apply_translation((0, -0.1, 0))
    ball.apply_translation((0, 0.4, 0))
    posts = [trimesh.creation.box(bounds=[(x, 0, z), (x + 0.1, 1, z + 0.1)]) for x in (-1, 0.9) for z in (-1, 0.9)]
    sheet = trimesh.Trimesh([(-1, 1, -1), (-1, 1, 1), (1, 1, 1), (1, 1, -1)], [(0, 1, 2), (0, 2, 3)], process=False)
    mesh = trimesh.util.concatenate([floor, ball, *posts, sheet])
    kinds: list[dict] = [{"backfaces": "occlude"}, {"backfaces": "ignore"}]
    results = [baked(mesh, size=512, crease_angle=40, backend="ray", **kind) for kind in kinds]
    cells = [(drawn(result, elevation=12), option_words(kind)) for result, kind in zip(results, kinds, strict=True)]
    return contact_sheet(cells, 2)


def surroundings(folder: Path) -> Picture:
    """The statue alone, in front of a wall, and under two skies."""
    wall = trimesh.creation.box((3, 3, 0.1), trimesh.transformations.translation_matrix((0, 1.2, -0.6)))
    wall.export(folder / "wall.ply")
    side = np.tile(np.where(np.arange(64) < 32, 1.0, 0.05), (32, 1))[..., None]  # light from -Z
    write_image(folder / "side.exr", side.astype(np.float32))
    kinds: list[dict] = [
        {},
        {"occluder": "wall.ply"},
        {"sky": "overcast"},
        {"sky": "side.exr"},
    ]
    with contextlib.chdir(folder):
        results = [baked("statue.obj", size=512, **kind) for kind in kinds]
    named = [option_words(kind) or "default" for kind in kinds]
    views = [drawn(result, (260, 340)) for result in results]
    return contact_sheet(list(zip(views, named, strict=True)), 4)


def poses(folder: Path) -> Picture:
    """A chest that stands open, with the texture of its rest pose, of the open one, and of both."""
    mesh = folder / "chest.glb"
    picture_meshes.chest(mesh)
    kinds = {"rest pose, drawn closed": (), "rest pose, drawn open": (), "--pose open@1": ("open@1",)}
    kinds["--pose open@0 --pose open@1"] = ("open@0", "open@1")
    cells = []
    for name, pose in kinds.items():
        result = baked(mesh, size=512, pose=pose, ground=True)
        cells.append((drawn(result, (440, 340), elevation=35, pose=None if "closed" in name else "open@1"), name))
    return contact_sheet(cells, 2)


def self_occlusion(folder: Path) -> Picture:
    """A chest, baked while its lid is shut, and drawn with the lid open: occluded by all, and each part by itself."""
    mesh = folder / "chest.glb"
    picture_meshes.chest(mesh)
    kinds: list[dict] = [{"self_occlusion": "all"}, {"self_occlusion": "part"}]
    results = [baked(mesh, size=512, **kind) for kind in kinds]
    views = [drawn(result, (440, 340), elevation=35, pose="open@1") for result in results]
    return contact_sheet(list(zip(views, map(option_words, kinds), strict=True)), 2)


def vertex_values(_: Path) -> Picture:
    """A ball on a floor with its texture, with fitted values at the vertices and with sampled ones."""
    ball = trimesh.creation.icosphere(2)
    ball.apply_translation((0, 1, 0))
    plate = trimesh.creation.box((4, 0.2, 4)).subdivide().subdivide()
    plate.apply_translation((0, -0.1, 0))
    result = baked(trimesh.util.concatenate([plate, ball]), size=512, crease_angle=40, vertex_ao="attribute")
    sampled = bilinear(result.ao, result.mesh.uvs.reshape(-1, 2), repeats=False).reshape(-1, 3)
    pictures = {
        "the texture": result.ao,
        "--vertex-ao: fitted values": interpolated(result, result.vertex_ao),
        "values sampled at the vertices": interpolated(result, sampled),
    }
    options = ao.PreviewOptions(size=CELL, elevation=30)
    cells = [(ao.preview(result.mesh, options, texture=values).image, name) for name, values in pictures.items()]
    return contact_sheet(cells, 3)


def interpolated(result: ao.BakeResult, values: np.ndarray) -> np.ndarray:
    """Draw values at the corners of the faces, (F, 3), as a texture: around the charts first, then inside."""
    texture = result.ao.copy()
    height, width = texture.shape
    for margin in (0.5, 0.0):
        for uvs, corners in zip(result.mesh.uvs * (width, height), values, strict=True):
            low, high = np.floor(uvs.min(axis=0) - 2).astype(int), np.ceil(uvs.max(axis=0) + 2).astype(int)
            x, y = np.meshgrid(*(np.arange(max(a, 0), b) for a, b in zip(low, high, strict=True)))
            inside = (x < width) & (y < height)
            x, y = x[inside], y[inside]
            sides = np.linalg.inv(np.column_stack([uvs[1] - uvs[0], uvs[2] - uvs[0]]))
            second = (np.column_stack([x, y]) + 0.5 - uvs[0]) @ sides.T
            weights = np.column_stack([1 - second.sum(axis=1), second])
            hit = (weights >= -margin).all(axis=1)
            texture[height - 1 - y[hit], x[hit]] = (weights[hit] @ corners).clip(0, 1)
    return texture


def option_words(options: dict) -> str:
    """Write options as on the command line."""
    return " ".join(f"--{name.replace('_', '-')} {value}" for name, value in options.items())


def cut_open(result: ao.BakeResult) -> Picture:
    """Draw a result without the upright walls towards the camera."""
    mesh = result.mesh
    normal = np.cross(*(mesh.vertices[mesh.faces[:, k]] - mesh.vertices[mesh.faces[:, 0]] for k in (1, 2)))
    towards = (normal / np.linalg.norm(normal, axis=1, keepdims=True)) @ TOWARDS_CAMERA
    kept = (np.arange(len(mesh.faces)) >= 12) | (towards < 0.1)  # the box comes first
    rest = ao.Mesh(mesh.vertices, mesh.faces[kept], normals=mesh.normals[kept], uvs=mesh.uvs[kept])
    return ao.preview(rest, ao.PreviewOptions(size=CELL, up="z"), texture=result.ao).image


CASES = {  # the mesh; what to see with the default options, and with --two-sided
    "one part inside another": (
        picture_meshes.in_a_box,
        "The walls towards the camera are left out of the picture. What lies inside sees no light: 0.",
        "The same: neither side of what lies inside sees any light.",
    ),
    "closed, but its faces look inwards": (
        picture_meshes.inside_out,
        "The faces see the ring's inside: 0 everywhere, and a warning.",
        "Right: the outer side is lighter.",
    ),
    "a cup of one layer, faces inwards": (
        picture_meshes.cup,
        "Right inside; the outside shows the same texels.",
        "Right outside, as that is lighter; the inside shows the same texels.",
    ),
    "leaves, every second one upside down": (
        picture_meshes.plant,
        "Three leaves show the value of their lower side from above, too.",
        "All leaves show the value of their lighter side.",
    ),
}


def sides(_: Path) -> Picture:
    """Four meshes, baked by default in the upper row and with --two-sided in the lower."""
    cells = []
    for two_sided in (False, True):
        for name, (make, *seen) in CASES.items():
            result = baked(make(), size=512, crease_angle=50, two_sided=two_sided)
            picture = cut_open(result) if make is picture_meshes.in_a_box else drawn(result, up="z")
            title = f"{name}, --two-sided" if two_sided else name
            cells.append((picture, f"{title}\n{seen[two_sided]}"))
    return contact_sheet(cells, len(CASES))


# Textures


def borders(_: Path) -> Picture:
    """One texture at four stages: covered texels, padding, and two ways of filling the rest."""
    mesh, (width, height) = picture_meshes.leaning_wall(), picture_meshes.SIZE
    # Depth maps far finer than `auto` would choose, so that every visible step is the texture's.
    options = {"width": width, "height": height, "unwrap": "keep", "normals": "flat", "shadow_size": 2048}
    steps = [{"padding": 0, "fill": "none"}, {"fill": "none"}, {"fill": "mean"}, {"fill": "pushpull"}]
    results = [baked(mesh, **options, **step) for step in steps]
    bare, padded, mean, pushpull = (255 * result.ao[..., None] for result in results)
    covered = results[0].valid[..., None]

    squares = np.where(np.indices((height, width)).sum(axis=0) % 2, 236, 250)[..., None]
    tinted = np.where(covered, padded, 0.5 * padded + 0.5 * np.where(bare > 0, READ_COLOR, PADDING_COLOR))
    stages = {
        "1  texels that the surface covers, wholly or in part": np.where(covered, bare, squares),
        "2  others that look-ups on it read (orange); padding (blue)": np.where(padded > 0, tinted, squares),
        "3  the rest: --fill mean": mean,
        "4  the rest: --fill pushpull": pushpull,
    }
    cells = []
    for title, texels in stages.items():
        image = Image.fromarray(np.broadcast_to(texels.round(), (height, width, 3)).astype(np.uint8))
        image = image.resize((4 * width * ZOOM, 4 * height * ZOOM), Image.Resampling.NEAREST)
        for outline in (picture_meshes.FLOOR, picture_meshes.WALL):
            corners = [(4 * ZOOM * x, 4 * ZOOM * y) for x, y in [*outline, outline[0]]]
            ImageDraw.Draw(image).line(corners, fill=OUTLINE, width=6)
        cells.append((np.asarray(image.resize((width * ZOOM, height * ZOOM), Image.Resampling.BOX)), title))
    return contact_sheet(cells, 2)


# Pages in Chromium


class Server(http.server.ThreadingHTTPServer):
    """Serves a folder on this machine until it is shut down."""

    def __init__(self, folder: Path) -> None:
        """Start."""

        class Handler(http.server.SimpleHTTPRequestHandler):
            def log_message(self, *_: object) -> None: ...

        super().__init__(("localhost", 0), functools.partial(Handler, directory=folder))
        threading.Thread(target=self.serve_forever, daemon=True).start()


def photographed(address: str, size: tuple[int, int]) -> Picture:
    """Show a page in Chromium and take a picture of it once it is drawn."""
    sys.path.insert(0, str(HERE.parent / "tests"))
    from playwright.sync_api import sync_playwright

    from browser.chromium import launched

    with sync_playwright() as driver, launched(driver) as chromium:
        page = chromium.new_page(viewport={"width": size[0], "height": size[1]})
        page.goto(address, wait_until="networkidle")
        page.wait_for_timeout(2000)
        return np.asarray(Image.open(io.BytesIO(page.screenshot())).convert("RGB"))


def three(folder: Path) -> Picture:
    """The car in examples/three/index.html, its ambient occlusion off and on."""
    ao.bake(folder / "car.glb", ao.BakeOptions(ground=True)).save(f"{folder}/")
    shutil.copy(EXAMPLES / "three/index.html", folder)
    (folder / "node_modules").symlink_to(HERE.parent / "viewer/node_modules")
    with Server(folder) as server:
        page = f"http://localhost:{server.server_port}/index.html"
        shots = [photographed(page + mark, (500, 340)) for mark in ("#off", "")]
        server.shutdown()
    return np.concatenate(shots, axis=1)


SKY, SLOPE = 0.5, np.array([0.3, 0.2, 0.25])  # the light from w is SKY + SLOPE.w


def by_rays(folder: Path) -> tuple[ao.BakeResult, np.ndarray, ao.BakeResult]:
    """The statue with bent normals, the light on it by ray tracing, and the statue where nothing occludes."""
    result = baked(folder / "statue.obj", bent_normals=True)
    rows, columns = np.mgrid[:64, :128] + 0.5
    polar, azimuth = np.pi * rows / 64, 2 * np.pi * (columns / 128 - 0.5)
    towards = np.stack([np.sin(polar) * np.cos(azimuth), np.cos(polar), np.sin(polar) * np.sin(azimuth)], axis=-1)
    write_image(folder / "sky.exr", (SKY + towards @ SLOPE)[..., None].astype(np.float32), "float")
    under_sky = baked(folder / "statue.obj", sky=folder / "sky.exr", backend="ray").ao  # the share that is left
    unoccluded = baked(folder / "statue.obj", bent_normals=True, max_distance=1e-6)
    return result, under_sky * (unoccluded.sh @ [SKY, *SLOPE]).astype(np.float32), unoccluded


def bent_normals(folder: Path) -> Picture:
    """The statue's bent normals, and the light of a sky along its normals, along these, and by rays."""
    result, reference, unoccluded = by_rays(folder)
    lights = {
        "light along the normal, times AO": result.ao * (SKY + 2 / 3 * unoccluded.bent_normals @ SLOPE),
        "light along the bent normal, times AO": result.ao * (SKY + 2 / 3 * result.bent_normals @ SLOPE),
        "the same light by ray tracing": reference,
    }
    picture = np.floor(127.5 * (result.bent_normals + 1) + 0.5).astype(np.uint8)
    cells = [(np.asarray(Image.fromarray(picture).resize((300, 300))), "statue_bent.png, --bent-space world")]
    brightest = max(values.max() for values in lights.values())
    for name, values in lights.items():
        texture = (values / brightest).astype(np.float32)
        print(f"{name}: {np.sqrt(((values - reference)[result.valid] ** 2).mean()):.4f} from rays, RMS")
        cells.append((ao.preview(result.mesh, ao.PreviewOptions(size=(300, 300)), texture=texture).image, name))
    return contact_sheet(cells, 4)


def strength(_: Path) -> Picture:
    """The colonnade with its whole occlusion and with a part of it, as viewers of glTF show it; an inverted picture."""
    sys.path.insert(0, str(EXAMPLES))
    from make_meshes import colonnade

    mesh = colonnade()
    results = {value: baked(mesh, size=512, crease_angle=40, strength=value) for value in (1.0, 0.6, 0.2)}
    cells = [(drawn(result, (360, 300)), f"--strength {value:g}") for value, result in results.items()]
    return contact_sheet([*cells, (gray(1 - results[1.0].ao, (300, 300)), "the picture of --invert")], 4)


def spherical_harmonics(folder: Path) -> Picture:
    """The statue in examples/three/spherical-harmonics.html: without occlusion, by harmonics, and by rays."""
    result, reference, _ = by_rays(folder)
    result.save(folder / "statue_ao.glb", sh=folder / "statue_sh.png")
    write_image(folder / "reference.png", reference, "16")
    shutil.copy(EXAMPLES / "three/spherical-harmonics.html", folder)
    (folder / "node_modules").symlink_to(HERE.parent / "viewer/node_modules")
    names = {"open": "without occlusion", "": "spherical harmonics in three.js", "reference": "ray tracing"}
    with Server(folder) as server:
        page = f"http://localhost:{server.server_port}/spherical-harmonics.html"
        shots = {mark: photographed(f"{page}#{mark}", (300, 400)) for mark in names}
        server.shutdown()
    harmonics, traced = (shots[mark].astype(float) / 255 for mark in ("", "reference"))
    print(f"three.js and rays differ by {np.sqrt(((harmonics - traced) ** 2).mean()):.4f}, RMS, in sRGB")
    return contact_sheet([(shots[mark], name) for mark, name in names.items()], 3)


def report(folder: Path) -> Picture:
    """The report of the statue."""
    with contextlib.chdir(folder):  # the page shows no absolute paths
        baked("statue.obj").save("build/", report="build/")
        fitted("statue.obj", 64, method="shadow").save("build/")
        ao.write_report("build", "report.html")
    return photographed(f"file://{folder}/report.html", (1000, 1250))


def report_batch(folder: Path) -> Picture:
    """The report of a batch of which one mesh is broken."""
    (folder / "assets/props/broken.obj").write_text("v 0 0 0\nf 1 2 3\n")
    with contextlib.chdir(folder):
        made = ao.batch("assets", "build", bake=ao.BakeOptions(size=256, directions=DIRECTIONS))
        ao.write_report(made.report, "report.html")
    return photographed(f"file://{folder}/report.html", (1000, 460))


# The figures of the report


def figures(folder: Path) -> Picture:
    """The sheet of `aoprecalc bake --figures`."""
    return page_wide(baked(folder / "statue.obj", size=512).figures().sheet)


def sphere_figures(folder: Path) -> Picture:
    """The sheet of `aoprecalc spheres --figures`."""
    return page_wide(fitted(folder / "statue.obj", 64, method="shadow").figures().sheet)


def page_wide(sheet: Picture) -> Picture:
    """Scale a sheet to the width of a page."""
    size = PAGE_WIDTH, round(PAGE_WIDTH * sheet.shape[0] / sheet.shape[1])
    return np.asarray(Image.fromarray(sheet).resize(size, Image.Resampling.LANCZOS))


PICTURES = (before_after, preview, preview_material, preview_ground, preview_views, first_bake, shadows, robot, spheres,
            dark, leaks, occlusion, several_textures, high_to_low, ground_height, backfaces, self_occlusion,
            surroundings, poses, vertex_values, bent_normals, strength, sides, borders, figures, sphere_figures, three,
            spherical_harmonics, report, report_batch)  # fmt: skip


def main() -> None:
    """Write the pictures."""
    for make in PICTURES:
        name = make.__name__.replace("_", "-")
        if not sys.argv[1:] or name in sys.argv[1:]:
            with tempfile.TemporaryDirectory() as folder:
                sample_meshes.write(Path(folder))
                picture = Image.fromarray(make(Path(folder)))
            picture.save(HERE / f"pictures/{name}.png", optimize=True)


if __name__ == "__main__":
    main()
