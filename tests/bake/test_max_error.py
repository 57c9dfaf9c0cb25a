"""`max_error`: a bake goes on until its error as rendered is certain, or says that it cannot be."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest
from pygltflib import GLTF2

import aoprecalc as ao
from aoprecalc.api.bake_scene import bake_scene
from aoprecalc.api.bake_textures import bake_textures
from aoprecalc.api.certified_bake import COUNTS, Attempt, next_count, resolution_part, until_certain
from aoprecalc.api.prepared_scene import PreparedScene
from aoprecalc.api.verify import measure_texture
from aoprecalc.errors import ArgumentError, UsageError
from aoprecalc.io import read_image, write_image
from aoprecalc.io.baked_options import baked_certificate
from aoprecalc.io.formats.files import ImageSource
from aoprecalc.io.images import read_text, stored
from aoprecalc.options import BakeOptions, VerifyOptions
from aoprecalc.progress import Progress
from aoprecalc.types import Certificate
from aoprecalc.visibility.directions import DirectionPlan
from shapes import box, clutter, join, notch, quad, scene, scene_of_parts, torus

RING = torus(around=24, across=12)


def box_on_floor():
    """A box that stands on a floor, whose border is under it."""
    return join(quad((-4, -4, -1), (8, 0, 0), (0, 8, 0), 8), box())


def bake(shape, **options):
    return bake_scene(scene(*shape), BakeOptions(**{"size": 64, "backend": "ray", **options}))


def measured(baked, depth="8"):
    """The RMS error, with the noise of 2304 rays."""
    prepared = PreparedScene(baked.scene, baked.normals)
    texture = stored(baked.texture.values, depth)
    how = VerifyOptions(points=20_000, seed=3)
    return measure_texture(prepared, baked.atlas, texture, how, Progress(), value=baked.options).levels[0].rmse


# How many directions the next texture takes.


def error_with(resolution, sampling, counts):
    """Attempts whose squared error is that of the resolution, and that of sampling with one direction over N^3/2."""
    return [Attempt(count, resolution**2 + sampling**2 * count**-1.5) for count in counts]


def test_two_textures_tell_the_part_of_the_resolution():
    assert math.sqrt(resolution_part(error_with(0.004, 0.5, [288, 1152]))) == pytest.approx(0.004)
    assert resolution_part(error_with(0.0, 0.5, [288, 576])) == pytest.approx(0, abs=1e-12)


def test_the_next_texture_has_the_fewest_directions_that_suffice():
    wanted = 0.01
    attempts = error_with(0.004, 0.9, [144, 288])
    count = next_count(attempts, COUNTS, wanted)
    errors = {count: error_with(0.004, 0.9, [count])[0].squared_error for count in COUNTS}
    assert errors[count] <= 0.7 * wanted**2 < errors[count // 2]


def test_no_more_are_taken_where_the_resolution_alone_is_too_much():
    assert next_count(error_with(0.0099, 0.5, [144, 288]), COUNTS, 0.01) is None
    assert next_count(error_with(0.05, 0.5, [144]), COUNTS, 0.01) is None
    assert next_count(error_with(0.001, 5.0, [144, COUNTS[-1]]), COUNTS, 0.01) is None  # none are left
    assert next_count(error_with(0.001, 20.0, [144, 288]), COUNTS, 0.01) == COUNTS[-1]


def test_all_certificates_together_are_right_with_the_confidence():
    asked = []

    def measure(made, confidence, attempt):
        asked.append((made, confidence, attempt))
        return Certificate(0.01, 0.6 * made**-0.75, 0.03, confidence, 1, 1, 0)

    found = until_certain(lambda directions: directions.count, measure, 0.01, COUNTS, doubt=0.04)
    assert [attempt for _, _, attempt in asked] == list(range(len(asked)))
    assert [1 - confidence for _, confidence, _ in asked] == pytest.approx(
        [0.04 / 2 ** (k + 1) for k in range(len(asked))]
    )
    counts = [made for made, _, _ in asked]
    assert [one.directions for one in found.attempts] == counts == sorted(set(counts))
    assert found.certificate.confidence == 0.95
    assert found.made == asked[-1][0] == COUNTS[-1]


# Bakes.


def test_a_certified_texture_has_at_most_that_error():
    baked = bake(RING, max_error=0.03)
    certificate = baked.certificate
    assert certificate.holds
    assert certificate.max_error == 0.03
    assert certificate.error <= certificate.bound <= 0.03
    found = measured(baked)
    assert found <= 0.03
    assert certificate.error == pytest.approx(found, rel=0.15)
    assert not any("RMS error" in line for line in baked.warnings)


@pytest.mark.slow
@pytest.mark.parametrize(("backend", "wanted"), [("gl", 0.02), ("ray", 0.01)])
@pytest.mark.parametrize("shape", [RING, box_on_floor(), notch(60, 2.0)], ids=["ring", "box", "notch"])
def test_by_both_backends_of_any_shape(shape, wanted, backend):
    baked = bake(shape, max_error=wanted, size="auto", backend=backend)
    assert baked.certificate.holds
    assert measured(baked) <= wanted


def test_a_smaller_error_takes_more_directions():
    counts = [bake(RING, max_error=wanted).directions for wanted in (0.05, 0.015)]
    assert counts[0] < counts[1]
    assert set(counts) <= set(COUNTS)


def test_what_a_size_cannot_hold_is_told_with_what_it_reached():
    baked = bake(clutter(0), size=24, max_error=0.002)
    certificate = baked.certificate
    assert not certificate.holds
    assert certificate.bound > certificate.error > 0.002
    (line,) = (line for line in baked.warnings if "RMS error" in line)
    assert f"as rendered, {certificate}; 0.002 was wanted" in line
    assert "(0." in str(certificate)
    assert "the resolution alone adds about" in line
    assert "use a larger --size, or auto" in line


def test_directions_are_the_most():
    baked = bake(RING, max_error=0.01, directions=20)
    assert baked.directions == 20
    assert not baked.certificate.holds
    assert any("allow more --directions" in line for line in baked.warnings)
    assert baked.directions_per_texel == 20  # fewer than neighbours can share


@pytest.mark.slow
def test_auto_takes_a_size_at_which_it_is_certain():
    baked = bake(clutter(0), size="auto", max_error=0.02)
    assert baked.certificate.holds
    assert dict(baked.size_estimates)[len(baked.texture.values)] <= 0.01


def test_the_bytes_do_not_depend_on_threads():
    bakes = [bake(RING, max_error=0.05, threads=threads) for threads in (1, 2)]
    assert bakes[0].texture.values.tobytes() == bakes[1].texture.values.tobytes()
    assert bakes[0].certificate == bakes[1].certificate


def test_it_is_the_texture_as_it_is_stored_that_is_certified():
    """Of 8 bits, unless more are asked for."""
    errors = {depth: bake(RING, max_error=0.05, bit_depth=depth).certificate.error for depth in ("8", "auto", "16")}
    assert errors["8"] == errors["auto"] != errors["16"]


def test_of_several_textures_that_of_the_greatest_bound_is_told():
    made = scene_of_parts(RING, notch(60, 2.0))
    options = BakeOptions(size=64, backend="ray", max_error=0.05, textures="mesh", unwrap="xatlas")
    bakes = bake_textures(made, options)
    bounds = [one.baked.certificate.bound for one in bakes.textures]
    assert len(set(bounds)) == 2
    assert bakes.whole.certificate.bound == max(bounds)


# What says so, and who confirms it.


@pytest.fixture(scope="module")
def certified(tmp_path_factory):
    """A folder with the picture, the OBJ and the GLB of a certified bake."""
    folder = tmp_path_factory.mktemp("certified")
    result = ao.bake(ao.Mesh(*RING), BakeOptions(size=64, backend="ray", max_error=0.03))
    result.save(folder / "ring.png", mesh_output=folder / "ring.obj")
    result.save(folder / "inside.glb")
    return folder, result.report.certificate


QUICK = VerifyOptions(points=500, rays=64)


@pytest.mark.parametrize("name", ["ring.obj", "inside.glb"])
def test_verify_confirms_it_at_other_points(certified, name):
    folder, claimed = certified
    report = ao.verify(folder / name, options=QUICK)
    assert report.passed
    assert report.certificate.certified
    assert report.certificate.max_error == claimed.max_error == 0.03
    assert report.certificate.error != claimed.error
    assert report.certificate.error == pytest.approx(claimed.error, rel=0.2)


def test_the_picture_and_the_extras_of_a_gltf_say_it(certified):
    folder, claimed = certified
    in_picture = json.loads(read_text(folder / "ring.png"))["certificate"]
    document = GLTF2().load(folder / "inside.glb")
    in_extras = document.materials[0].occlusionTexture.extras["aoprecalc"]["certificate"]
    expected = {key: value for key, value in claimed.to_dict().items() if key != "certified"}
    assert in_picture == in_extras == expected


def test_a_text_that_holds_no_certificate_is_none(tmp_path):
    right = {"max_error": 0.01, "error": 0.005, "bound": 0.009, "confidence": 0.95, "points": 9, "rays": 9, "seed": 0}
    wrong = [
        {"max_error": 1e-9},
        {"max_error": "x"},
        {"confidence": 1},
        {"confidence": 0},
        {"bound": -1},
        {"points": []},
    ]
    assert Certificate(**right) == said_by(tmp_path, right)
    for said in (*({**right, **one} for one in wrong), 0.1, None, [1], {}):
        assert said_by(tmp_path, said) is None


def said_by(folder, certificate):
    write_image(
        folder / "a.png", np.ones((4, 4), np.float32), "8", json.dumps({"schema": 1, "certificate": certificate})
    )
    return baked_certificate(ImageSource.of(folder / "a.png"))


def test_a_picture_that_was_changed_is_not_confirmed(certified, tmp_path):
    folder, _ = certified
    for name in ("ring.obj", "ring.mtl"):
        (tmp_path / name).write_bytes((folder / name).read_bytes())
    lighter = np.clip(read_image(folder / "ring.png") + 0.2, 0, 1)
    write_image(tmp_path / "ring.png", lighter, "8", read_text(folder / "ring.png"))
    report = ao.verify(tmp_path / "ring.obj", options=QUICK)
    assert not report.passed
    assert not report.certificate.certified


def test_another_value_than_that_of_the_bake_has_no_certificate(certified):
    folder, _ = certified
    report = ao.verify(folder / "ring.obj", options=replace(QUICK, cone=90))
    assert report.certificate is None
    assert report.passed


# What is refused.


def test_pictures_with_losses_are_refused(tmp_path):
    result = ao.bake(ao.Mesh(*RING), BakeOptions(size=64, backend="ray", max_error=0.05))
    with pytest.raises(UsageError, match=r"max_error is 0.05, but .*x.jpg is written with losses"):
        result.save(tmp_path / "x.jpg")


def test_random_directions_are_refused():
    with pytest.raises(ArgumentError, match="sampling is 'random', which takes far too many directions for max_error"):
        BakeOptions(max_error=0.01, sampling="random")


def test_one_end_only():
    with pytest.raises(ArgumentError, match="max_error and target_error both say when the bake ends"):
        BakeOptions(max_error=0.01, target_error=0.01)


def test_few_directions_are_shared_by_all_texels_alike():
    assert DirectionPlan.from_options(BakeOptions()) == DirectionPlan(1152, True)
    assert DirectionPlan.from_options(BakeOptions(directions=64)) == DirectionPlan(64, False)
