"""Why texels are dark: shares by cause on scenes whose causes are known, and which of them are warnings."""

from dataclasses import replace

import numpy as np
import pytest

from aoprecalc.api.bake_report import bake_report
from aoprecalc.api.bake_scene import bake_scene
from aoprecalc.api.reports import BakeOutputs
from aoprecalc.mesh.surface import face_normals
from aoprecalc.options import BakeOptions
from aoprecalc.raster.layout import doubled_uv_areas
from aoprecalc.visibility import dark_texels
from shapes import ball, box, cap, join, quad, scene, scene_of_parts, spun

backends = pytest.mark.parametrize("backend", ["gl", "ray"])
CAUSES = ("inside", "inwards", "below_ground", "on_ground", "above_ground", "narrow")


def bake(made, backend="ray", **options):
    return bake_scene(
        made,
        BakeOptions(
            **{
                "size": 64,
                "padding": 1,
                "directions": 128,
                "backend": backend,
                "up": "z",
                "normals": "smooth",
                **options,
            }
        ),
    )


def grounded(made, backend="ray", **options):
    return bake(made, backend, ground=True, **options)


def plain(made, backend="ray", **options):
    return bake(made, backend, up="auto", **options)


def causes(baked):
    return {cause: getattr(baked.dark, cause) for cause in CAUSES if getattr(baked.dark, cause)}


@backends
def test_a_box_in_a_box_is_inside_another_part(backend):
    inner, outer = box(), box((-2, -2, -2), (2, 2, 2))
    baked = plain(scene_of_parts(inner, outer), backend)
    assert causes(baked) == {"inside": baked.dark.share}
    assert baked.dark.share == pytest.approx(0.2, abs=0.05)  # a quarter of the outer box's area, in the same atlas
    (part,) = baked.dark.parts
    assert (part.name, part.inwards) == ("part 0", 0)
    assert part.inside == pytest.approx(1, abs=0.02)
    assert any("inside another part or touching one ('part 0': 100%)" in line for line in baked.notes)
    assert baked.warnings == ()


def test_many_boxes_in_a_closed_room_are_a_warning():
    room = box((-9, -9, -9), (9, 9, 9))
    baked = plain(scene_of_parts((room[0], room[1][:, ::-1]), box()))
    assert baked.dark.inside + baked.dark.inwards == pytest.approx(1)
    (told,) = baked.warnings
    assert "face inwards" in told
    assert "leave it out with --exclude; else flip these faces, or use --two-sided" in told
    two_sided = plain(scene_of_parts(*[box((-i, -i, -i), (i, i, i)) for i in (1, 2, 3, 4, 5)]), two_sided=True)
    assert two_sided.dark.inside > 0.5
    assert any("leave it out with --exclude" in line for line in two_sided.warnings)


@backends
def test_an_open_sheet_about_a_ball_faces_inwards(backend):
    """Half a sphere, open, whose front looks at the box that closes it."""
    positions, faces = cap(8, radius=1.2)
    lid = quad((-1.3, -1.3, 0), (2.6, 0, 0), (0, 2.6, 0), 4)
    baked = plain(scene(*join((positions, faces[:, ::-1]), lid)), backend)
    area = 2 * np.pi * 1.2**2
    assert baked.dark.inwards == pytest.approx(area / (area + 2.6**2), abs=0.05)
    assert baked.dark.inwards == pytest.approx(baked.dark.share, abs=0.01)
    assert any("face inwards" in line and "--two-sided" in line for line in baked.warnings)
    assert not any("inwards" in line for line in plain(baked.scene, backend, two_sided=True).warnings)


def test_a_ball_wound_inside_out_faces_inwards_and_one_line_says_so():
    positions, faces = ball(2)
    baked = plain(scene(positions, faces[:, ::-1]))
    assert causes(baked) == {"inwards": 1}
    (line,) = baked.warnings
    assert "faces point inwards" in line
    assert baked.notes == ()


@backends
def test_what_faces_the_ground_rests_on_it_or_is_above_it(backend):
    """A box on the ground has one face on it, one at a height has none."""
    baked = grounded(scene(*box()), backend)
    assert causes(baked) == {"on_ground": baked.dark.share}
    areas = doubled_uv_areas(baked.atlas.uvs)  # which differ: faces of one value get fewer texels
    upward = face_normals(baked.scene.corners)[0][:, 2]
    assert baked.dark.share == pytest.approx(areas[upward < -0.5].sum() / areas.sum(), abs=0.02)
    assert baked.warnings == ()
    report = bake_report(baked, BakeOptions(), BakeOutputs(), None, {}, (*baked.warnings, *baked.notes))
    mean = np.average((1 + upward) / 2, weights=areas)  # 1 on top, 1/2 on four sides, 0 below
    assert report.ao.ground_alone == pytest.approx(mean, abs=1e-3)
    assert report.ao.mean == pytest.approx(mean, abs=0.03)
    assert report.dark.on_ground == pytest.approx(baked.dark.share, abs=1e-6)
    assert any(f"lowers the mean AO to {mean:.2f}" in line for line in report.notes)
    for height in (2, 0.1):
        pole = quad((4, 0, -1 - height), (0.5, 0, 0), (0, 0, 0.5))
        raised = grounded(scene(*join(box(), pole)), backend)
        assert causes(raised) == {"above_ground": raised.dark.share}


def test_a_plate_that_faces_the_ground_alone_asks_for_the_axis():
    plate = quad((0, 0, 0), (1, 0, 0), (0, 0, 1))
    made = scene(*join(plate, quad((0, -1, 0), (1e-3, 0, 0), (0, 0, 1e-3))))
    baked = grounded(made, up="auto")
    assert baked.dark.above_ground > 0.9
    assert any("--up" in line for line in baked.warnings)
    for known in (grounded(made, up="y"), grounded(replace(made, up="y"), up="auto")):  # there is nothing to ask
        assert known.dark.above_ground > 0.9
        assert known.warnings == ()
    assert grounded(made, up="x").warnings == ()


def test_the_bottom_of_a_well_is_narrow():
    """Seen from the floor, the opening of a well eleven radii deep has AO 1 / (1 + 11^2), below 0.01."""
    baked = plain(scene(*spun([(0, -0.1), (1.1, -0.1), (1.1, 11), (1, 11), (1, 0), (0, 0)])), directions=1024)
    assert baked.dark.narrow > 0
    assert causes(baked).keys() <= {"narrow", "inside"}
    assert baked.warnings == ()


def test_few_dark_texels_have_no_causes_and_none_are_found_without_rays(monkeypatch):
    open_box = plain(scene(*box()))
    assert (open_box.dark.share, open_box.dark.samples, open_box.notes) == (0, 0, ())
    made = scene_of_parts(box(), box((-2, -2, -2), (2, 2, 2)))
    assert plain(made, "gl").dark.samples > 0
    monkeypatch.setattr(dark_texels, "embreex_problem", lambda: "is not installed")
    baked = plain(made, "gl")
    assert (baked.dark.samples, causes(baked)) == (0, {})
    assert any(line.endswith("of texels are dark (AO below 0.01)") for line in baked.notes)
    report = bake_report(baked, BakeOptions(), BakeOutputs(), None, {}, baked.notes)
    assert (report.dark, report.ao.unseen_share) == (None, pytest.approx(baked.dark.share, abs=1e-6))


def test_a_sample_of_the_dark_texels_gives_the_same_shares_each_time(monkeypatch):
    made = scene_of_parts(box(), box((-2, -2, -2), (2, 2, 2)), quad((-3, -3, -4), (6, 0, 0), (0, 6, 0), 3))
    exact = plain(made)
    monkeypatch.setattr(dark_texels, "_MAX_SAMPLES", 50)
    first, second = plain(made), plain(replace(made))
    assert first.dark == second.dark
    assert first.dark.samples == 50
    assert first.dark.inside == pytest.approx(exact.dark.inside, abs=0.02)
