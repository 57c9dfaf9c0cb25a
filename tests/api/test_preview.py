"""Previews by Python: what they take, what they give, and how results show themselves in a notebook."""

import io
import re
from base64 import b64decode
from xml.etree import ElementTree

import numpy as np
import pytest
from PIL import Image

import aoprecalc as ao
from aoprecalc.api import preview as previews
from aoprecalc.api.preview import sheet_columns
from aoprecalc.errors import RendererError
from aoprecalc.io import write_colors
from shapes import torus

SMALL = {"size": (64, 48), "backend": "ray", "threads": 1}
CENTERS, RADII = [[1, 0, 0], [-1, 0, 0]], [0.5, 0.25]


@pytest.fixture(scope="module")
def ring():
    return ao.Mesh(*torus(around=16, across=8), name="ring")


@pytest.fixture(scope="module")
def result(ring):
    return ao.bake(ring, ao.BakeOptions(size=64, directions=64, backend="ray", threads=1))


@pytest.fixture(scope="module")
def spheres(ring):
    return ao.fit_spheres(ring, ao.SphereOptions(3, samples=300))


def picture_of(file):
    return np.asarray(Image.open(file).convert("RGB"))


def test_a_bake_is_drawn_and_its_texture_darkens_it(result):
    with_ao, clay = (result.preview(ao.PreviewOptions(shading=shading, **SMALL)) for shading in ("ao", "clay"))
    assert with_ao.shape == (48, 64, 3)
    assert with_ao.dtype == np.uint8
    assert with_ao.mean() < clay.mean()
    assert np.array_equal(with_ao, ao.preview(result.mesh, ao.PreviewOptions(**SMALL)).image)


def test_a_bake_is_drawn_from_its_file_as_from_memory(result, tmp_path):
    files = result.save(tmp_path / "ring.glb")
    drawn = ao.preview(files.mesh, ao.PreviewOptions(**SMALL))
    assert np.abs(drawn.image.astype(int) - result.preview(ao.PreviewOptions(**SMALL))).max() <= 2
    assert drawn.report.texture == f"image 0 of {files.mesh}"
    assert drawn.report.shading == "ao"


def test_without_a_texture_it_is_clay(ring):
    drawn = ao.preview(ring, ao.PreviewOptions(**SMALL))
    assert (drawn.report.texture, drawn.report.shading) == (None, "clay")
    assert "drawn as clay" in drawn.report.notes[0]


def test_base_colors_are_shown_where_there_are_some(tmp_path):
    write_colors(tmp_path / "red.png", np.full((2, 2, 3), (255, 0, 0), np.uint8))
    (tmp_path / "made.mtl").write_text("newmtl red\nmap_Kd red.png\n")
    corners = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\n"
    (tmp_path / "made.obj").write_text(f"mtllib made.mtl\nusemtl red\n{corners}f 1/1 2/2 3/3\n")
    drawn = ao.preview(tmp_path / "made.obj", ao.PreviewOptions(shading="material", **SMALL))
    assert drawn.report.shading == "material"
    red, green, _ = drawn.image[20:28, 28:34].reshape(-1, 3).mean(axis=0)
    assert red > green + 100


def test_a_format_without_colors_says_so(ring, tmp_path):
    drawn = ao.preview(ring, ao.PreviewOptions(shading="material", **SMALL))
    assert drawn.report.shading == "clay"
    assert drawn.report.notes[-1] == "ring: has no base colours, it is drawn as clay"


@pytest.mark.parametrize("kind", ["arrays", "set", "result", "file"])
def test_spheres_of_any_kind_are_shown(ring, spheres, kind, tmp_path):
    given = {
        "arrays": (spheres.centers.tolist(), spheres.radii.tolist()),
        "set": spheres.spheres,
        "result": spheres,
        "file": spheres.save(tmp_path / "s.json"),
    }
    drawn = ao.preview(ring, ao.PreviewOptions(**SMALL), spheres=given[kind])
    assert drawn.report.spheres == 3
    assert drawn.image.shape == (48, 64, 3)
    assert np.array_equal(drawn.image, spheres.preview(ao.PreviewOptions(**SMALL)))


def test_of_levels_the_finest_is_shown(ring, tmp_path):
    levels = ao.fit_spheres(ring, ao.SphereOptions(levels=(1, 4), samples=300))
    drawn = ao.preview(ring, ao.PreviewOptions(**SMALL), spheres=levels.save(tmp_path / "s.json"))
    assert drawn.report.spheres == 4
    assert drawn.report.notes[-1].endswith("has levels of 1 and 4 spheres; the finest is shown")


def test_views_are_one_sheet(result, tmp_path):
    drawn = ao.preview(result.mesh, ao.PreviewOptions(views=3, **SMALL))
    assert len(drawn.pictures) == drawn.report.pictures == 3
    height, width = drawn.image.shape[:2]
    assert (width, height) == (drawn.report.width, drawn.report.height)
    assert 2 * 64 < width < 3 * 64
    (saved,) = drawn.save(tmp_path / "sheet.png")
    assert np.array_equal(picture_of(saved), drawn.image)


def test_a_sheet_has_few_gaps_and_is_not_long():
    columns = [sheet_columns(count) for count in range(1, 65)]
    assert columns[:9] == [1, 2, 2, 2, 3, 3, 4, 4, 3]
    for count, wide in enumerate(columns, 1):
        rows = -(-count // wide)
        assert wide * (rows - 1) < count <= wide * rows
        assert rows <= wide <= 2 * rows
    assert sheet_columns(48) == 8


def test_a_turntable_is_an_animation_or_frames(result, tmp_path):
    drawn = ao.preview(result.mesh, ao.PreviewOptions(turntable=True, frames=3, **SMALL))
    assert np.array_equal(drawn.image, drawn.pictures[0])
    (animation,) = drawn.save(tmp_path / "turn.webp")
    again = drawn.save(tmp_path / "again.webp")[0]
    assert animation.read_bytes() == again.read_bytes()
    with Image.open(animation) as opened:
        assert (opened.n_frames, opened.size, opened.info["loop"]) == (3, (64, 48), 0)
        durations, shown = [], []
        for number in range(3):
            opened.seek(number)
            shown.append(np.asarray(opened.convert("RGB")).astype(int))
            durations.append(opened.info["duration"])
    assert sum(durations) == 4000
    assert all(np.abs(a - b).mean() < 6 for a, b in zip(shown, drawn.pictures, strict=True))
    frames = drawn.save(f"{tmp_path}/frames/")
    assert [file.name for file in frames] == ["0000.png", "0001.png", "0002.png"]
    assert all(np.array_equal(picture_of(file), picture) for file, picture in zip(frames, drawn.pictures, strict=True))


@pytest.mark.parametrize("name", ["p.png", "p.jpg", "p.webp"])
def test_pictures_are_written_in_each_format_with_the_same_bytes(result, tmp_path, name):
    drawn = ao.preview(result.mesh, ao.PreviewOptions(**SMALL))
    first, second = (drawn.save(tmp_path / f"{number}{name}")[0] for number in (1, 2))
    assert first.read_bytes() == second.read_bytes()
    assert np.abs(picture_of(first).astype(int) - drawn.image).mean() < (0.01 if name == "p.png" else 4)


def test_the_up_axis_is_that_of_the_bake(ring):
    lying = ao.bake(ring, ao.BakeOptions(size=64, directions=64, backend="ray", ground=True, up="z"))
    given = ao.PreviewOptions(up="z", **SMALL)
    assert np.array_equal(lying.preview(ao.PreviewOptions(**SMALL)), lying.preview(given))
    assert not np.array_equal(lying.preview(ao.PreviewOptions(up="y", **SMALL)), lying.preview(given))


WRONG = [
    ("spheres", "of type int, a SphereSet", {"spheres": 4}),
    ("centers", "shape (2,), (n, 3)", {"spheres": ([1, 2], [1.0])}),
    ("radii", "value -1, numbers >= 0", {"spheres": ([[0, 0, 0]], [-1])}),
    ("spheres_view", "is over, but there are no spheres", {"options": ao.PreviewOptions(spheres_view="over")}),
    ("options", "of type BakeOptions, PreviewOptions", {"options": ao.BakeOptions()}),
    ("texture", "shape (4,), (H, W)", {"texture": np.ones(4)}),
]


@pytest.mark.parametrize(("argument", "words", "given"), WRONG, ids=[row[1] for row in WRONG])
def test_wrong_arguments_are_named(result, argument, words, given):
    with pytest.raises(ao.ArgumentError) as raised:
        ao.preview(result.mesh, **given)
    assert str(raised.value).startswith(f"{argument} ")
    assert words in str(raised.value)


# Notebooks, as IPython asks objects for what they show.


def shown_by_ipython(value):
    """The representations that a notebook gets, by their MIME types; IPython leaves out those that are None."""
    methods = {"text/html": "_repr_html_", "image/png": "_repr_png_", "text/plain": "__repr__"}
    found = {kind: getattr(value, name)() for kind, name in methods.items() if hasattr(value, name)}
    return {kind: data for kind, data in found.items() if data is not None}


def pictures_in(html):
    """The pictures of some HTML, which is well-formed and gives each a text."""
    root = ElementTree.fromstring(f"<div>{html}</div>")
    pictures = list(root.iter("img"))
    assert all(picture.get("alt") for picture in pictures)
    return [picture_of(io.BytesIO(b64decode(picture.get("src").partition(",")[2]))) for picture in pictures]


def test_a_bake_shows_its_mesh_and_texture(result):
    shown = shown_by_ipython(result)
    mesh, texture = pictures_in(shown["text/html"])
    assert mesh.shape == (450, 600, 3)
    assert np.array_equal(texture[..., 0], np.floor(255 * result.ao + 0.5))
    assert np.array_equal(picture_of(io.BytesIO(shown["image/png"])), mesh)
    assert "ring: 64 x 64 texels, mean AO 0." in shown["text/html"]
    assert f"{result._baked.atlas.charts} charts" in shown["text/html"]


def test_a_sphere_result_shows_mesh_and_spheres(spheres):
    shown = shown_by_ipython(spheres)
    (picture,) = pictures_in(shown["text/html"])
    assert picture.shape == (380, 760, 3)
    assert "3 spheres by lloyd: silhouette IoU 0." in shown["text/html"]


def test_a_preview_shows_its_picture(ring):
    drawn = ao.preview(ring, ao.PreviewOptions(**SMALL))
    assert np.array_equal(picture_of(io.BytesIO(shown_by_ipython(drawn)["image/png"])), drawn.image)


@pytest.mark.parametrize("error", [RendererError("none works"), ValueError("a fault")])
def test_a_renderer_that_fails_leaves_the_plain_text(ring, spheres, monkeypatch, error):
    def fail(*given):
        raise error

    fresh = ao.bake(ring, ao.BakeOptions(size=32, directions=64, backend="ray"))
    fitted = ao.fit_spheres(ring, ao.SphereOptions(2, samples=100))
    monkeypatch.setattr(previews, "preview_pictures", fail)
    for value in (fresh, fitted):
        assert shown_by_ipython(value) == {"text/plain": repr(value)}
    with pytest.raises(type(error)):
        fresh.preview()


def circles(html):
    root = ElementTree.fromstring(html[html.index("<svg") : html.index("</svg>") + 6])
    return [
        {name: float(circle.get(name)) for name in ("cx", "cy", "r")}
        for circle in root.iter("{http://www.w3.org/2000/svg}circle")
    ]


def set_of(centers, radii):
    return ao.SphereSet(np.array(centers, float), np.array(radii, float), 1, True, "lloyd", "mean", 10, 0)


def test_a_sphere_set_draws_circles_the_nearest_on_top():
    spheres = set_of([[0, 0, 3], [0, 0, -3], [0, 2, 0]], [1, 0.5, 0.25])
    far, middle, near = circles(spheres._repr_html_())
    assert [circle["r"] / near["r"] for circle in (far, middle, near)] == pytest.approx([0.5, 0.25, 1], abs=0.01)
    assert middle["cy"] < near["cy"]  # y points upwards
    assert "3 spheres by lloyd, radii 0.25 to 1" in spheres._repr_html_()


@pytest.mark.parametrize(("centers", "radii"), [([[0, 0, 0]], [0]), ([[1e9, 0, 0]], [1]), ([[5, 5, 5]] * 2, [2, 2])])
def test_degenerate_sphere_sets_are_drawn_inside_their_box(centers, radii):
    html = set_of(centers, radii)._repr_html_()
    width, height = (float(re.search(rf'{side}="(\d+)"', html)[1]) for side in ("width", "height"))
    for circle in circles(html):
        assert -1 <= circle["cx"] - circle["r"] <= circle["cx"] + circle["r"] <= width + 2
        assert -1 <= circle["cy"] - circle["r"] <= circle["cy"] + circle["r"] <= height + 2
