"""Tables of options, as manifests hold them and command lines give them."""

import random
import shlex
from dataclasses import fields, replace
from typing import get_args, get_type_hints

import pytest

from aoprecalc.cli.bake import bake as bake_command
from aoprecalc.cli.spheres import spheres as spheres_command
from aoprecalc.errors import UsageError
from aoprecalc.io import IMAGE_EXTENSIONS, OUTPUT_MESH_EXTENSIONS
from aoprecalc.io.sphere_files import SPHERE_EXTENSIONS
from aoprecalc.options import BakeOptions, SphereOptions
from aoprecalc.options.fields import as_words, option_field
from aoprecalc.pipeline.jobs import Asset, JobSpec
from aoprecalc.pipeline.option_tables import Tables, arguments_of, convert, make_job_spec
from aoprecalc.pipeline.report import AssetResult, reproduce_commands
from pipeline.helpers import BAKE, SPHERES, said

# What people write -> what it means, where these are not the same.
WRITTEN = {
    "memory_limit": {"1.5G": 3 << 29, 4096: 4096},
    "shadow_size": {"512": 512, "auto": None, 64: 64},
    "levels": {"2,8,32": (2, 8, 32)},
    "max_distance": {"10%": "10%", "2.5": 2.5, 2.5: 2.5, "none": None},
    "only": {"roof": ("roof",)},
    "occluder": {"wall.obj": ("wall.obj",)},
    "sky": {"overcast": "overcast", "sky.hdr": "sky.hdr"},
    "pose": {"walk@0.5": ("walk@0.5",)},
    "high": {"wall.obj": ("wall.obj",)},
    "cage": {"auto": "auto", "2%": "2%", "0.5": 0.5, 0.5: 0.5, "cage.obj": "cage.obj"},
    "bit_depth": {"16": "16", 16: "16"},
}
NUMBERS = {
    "crease_angle": 30.5,
    "cone": 120,
    "ground_height": -2.5,
    "strength": 0.5,
    "max_error": 0.01,
    "target_error": 0.01,
    "tolerance": 0.05,
    "unwrap_timeout": 2.5,
}


def read_job_spec(bake, spheres):
    """The job spec of two tables as a manifest holds them."""
    return make_job_spec(*map(arguments_of, convert({"bake": bake, "spheres": spheres}, Tables).choices()))


def said_of(kind):
    """(field, what a table says, what the options hold) for every field but those that others set."""
    for field in fields(kind):
        if not option_field(kind, field.name).on_command_line:
            continue
        hint = get_type_hints(kind)[field.name]
        for written, meant in WRITTEN.get(field.name, {}).items():
            yield field.name, written, meant
        if choices := [choice for choice in get_args(hint) if isinstance(choice, str)]:
            yield from ((field.name, choice, choice) for choice in choices)
        elif hint is bool:
            yield from ((field.name, choice, choice) for choice in (True, False))
        elif field.name in NUMBERS:
            yield field.name, NUMBERS[field.name], NUMBERS[field.name]
            highest = option_field(kind, field.name).option.range[1]
            yield field.name, highest, highest
        elif option_field(kind, field.name).option.range and field.name not in WRITTEN:
            yield field.name, 197, 197
        elif field.name == "levels":
            yield field.name, [3, 9], (3, 9)
        elif option_field(kind, field.name).kind in ("names", "files"):
            names = ["walk@0.5", "run@1"] if field.name == "pose" else ["roof", "wall *"]
            yield field.name, names, tuple(names)


def beside(key, value):
    """What has to be said, too, for an option to mean something."""
    if key == "falloff" and value != "none":
        return {"max_distance": 2.5}
    if key in ("cage", "match"):
        return {"high": ("rock.obj",)}
    if key == "ground_height":
        return {"ground": True}
    return {"ground": True} if key == "up" and value != "auto" else {}


@pytest.mark.parametrize("spell", [str, lambda key: key.replace("_", "-")], ids=["_", "-"])
def test_every_field_of_a_bake_can_be_said(spell):
    told = set()
    for key, written, meant in said_of(BakeOptions):
        table = {spell(key): written, **beside(key, written), "output": ".tif"}  # which has every bit depth
        options = BakeOptions(**{key: meant, **beside(key, written)})
        assert read_job_spec(table, None) == JobSpec(bake=options, bake_output=(".tif",)), key
        told.add(key)
    assert told == {field.name for field in fields(BakeOptions)} - {"width", "height", "bent_normals"}


@pytest.mark.parametrize("spell", [str, lambda key: key.replace("_", "-")], ids=["_", "-"])
def test_every_field_of_a_fit_can_be_said(spell):
    told = set()
    for key, written, meant in said_of(SphereOptions):
        spec = read_job_spec(None, {spell(key): written})
        assert spec == JobSpec(spheres=SphereOptions(**{key: meant})), key
        told.add(key)
    assert told == {field.name for field in fields(SphereOptions)}


@pytest.mark.parametrize(("written", "size"), [(512, (512, 512)), ("512", (512, 512)), ("96x48", (96, 48))])
def test_a_size_is_one_number_or_two(written, size):
    assert read_job_spec({"size": written}, None).bake == BakeOptions(size=size)


def test_kinds_of_files_are_said_too():
    for kind in (*IMAGE_EXTENSIONS, *OUTPUT_MESH_EXTENSIONS):
        assert read_job_spec({"output": kind}, None).bake_output == (kind,)
    assert read_job_spec({"output": [".exr", ".gltf"]}, None).bake_output == (".exr", ".gltf")
    for kind in SPHERE_EXTENSIONS:
        assert read_job_spec(None, {"output": kind}).spheres_output == (kind,)
    assert read_job_spec(None, {"output": [*SPHERE_EXTENSIONS]}).spheres_output == SPHERE_EXTENSIONS
    assert read_job_spec({"verify": True}, None).verify
    directional = read_job_spec({"bent-normals": ".tif", "sh": ".exr"}, None)
    assert (directional.bent_normals, directional.sh, directional.bake.bent_normals) == (".tif", ".exr", True)


WRONG = {
    "an option of no command": ({"sise": 9}, None, ["unknown key 'bake.sise'; did you mean 'size'?"]),
    "an option of the other": ({"radius": "mean"}, None, ["unknown key 'bake.radius'; expected one of", "directions"]),
    "the other way round": (None, {"directions": 64}, ["unknown key 'spheres.directions'; expected one of", "samples"]),
    "width and height, which are the size": (
        {"width": 64},
        None,
        ["unknown key 'bake.width'; expected one of", "size"],
    ),
    "a number for a switch": ({"two-sided": 1}, None, ["two-sided is 1", "true or false"]),
    "a text for a switch": ({"ground": "yes"}, None, ["ground is 'yes'", "true or false"]),
    "a number for verify": ({"verify": 1}, None, ["verify is 1", "true or false"]),
    "a text for a number": ({"directions": "many"}, None, ["directions is 'many'", "whole number"]),
    "a fraction of a direction": ({"directions": 1.5}, None, ["directions is 1.5", "whole number"]),
    "a switch for a number": ({"padding": True}, None, ["padding is True", "whole number"]),
    "no directions": ({"directions": 0}, None, ["directions is 0", "from 1 to"]),
    "not a number": ({"crease-angle": float("nan")}, None, ["crease_angle is nan", "from 0 to 180"]),
    "no such choice": ({"fill": "red"}, None, ["fill is 'red'", "pushpull"]),
    "a number for a choice": ({"normals": 1}, None, ["normals is 1", "smooth"]),
    "a depth of no file": ({"bit_depth": 12}, None, ["bit-depth is 12", "half"]),
    "a list for a choice": ({"fill": ["mean"]}, None, ["fill is ['mean']", "pushpull"]),
    "a size of letters": ({"size": "big"}, None, ["'big'", "2048x1024"]),
    "a size of nothing": ({"size": 0}, None, ["size is 0", "from 1 to"]),
    "a size as a list": ({"size": [64, 64]}, None, ["size is [64, 64]", "whole number"]),
    "an amount without its unit": ({"memory_limit": "1500"}, None, ["'1500'", "1.5G"]),
    "a shadow size of letters": ({"shadow-size": "huge"}, None, ["'huge'", "auto"]),
    "numbers for names": ({"only": [1]}, None, ["only is [1]", "list of names"]),
    "a number for names": ({"only": 1}, None, ["only is 1", "list of names"]),
    "a way up without a floor": ({"up": "z"}, None, ["up is 'z'", "ground"]),
    "a texture of no kind": ({"output": "png"}, None, ["output is 'png'", ".png"]),
    "a mesh that holds no UVs": ({"output": ".stl"}, None, ["output is '.stl'", ".glb"]),
    "two textures": ({"output": [".png", ".exr"]}, None, ["output names the images", "one image, one mesh or both"]),
    "two meshes": ({"output": [".obj", ".glb"]}, None, ["output names the meshes", "one image, one mesh or both"]),
    "a depth that the texture lacks": ({"output": ".jpg", "bit_depth": 16}, None, [".jpg has no bit depth 16"]),
    "a packing that the mesh lacks": ({"output": ".obj", "pack": "orm"}, None, ["pack is orm", ".gltf or .glb"]),
    "a sphere set of no kind": (None, {"output": ".txt"}, ["output is '.txt'", ".urdf"]),
    "one of no kind in a list": (None, {"output": [".csv", ".txt"]}, ["output is ['.csv', '.txt']", ".urdf"]),
    "levels of letters": (None, {"levels": "few"}, ["'few'", "8,32,128"]),
    "levels that are texts": (None, {"levels": ["8", "32"]}, ["levels is ['8', '32']", "list of whole numbers"]),
    "levels that are switches": (None, {"levels": [True, 8]}, ["levels is [True, 8]", "list of whole numbers"]),
    "levels that fall": (None, {"levels": [32, 8]}, ["levels is 32,8", "ascending"]),
    "two numbers of spheres": (None, {"spheres": 8, "tolerance": 0.1}, ["spheres and tolerance", "use one of them"]),
    "two other numbers of them": (None, {"levels": "2,8", "tolerance": 0.1}, ["levels and tolerance", "use one"]),
    "more spheres than samples": (None, {"spheres": 50, "samples": 20}, ["50 spheres", "at least 50 samples"]),
    "one option in two spellings": ({"shadow-size": 64, "shadow_size": 32}, None, ["shadow-size", "twice"]),
    "nothing at all": (None, None, ["neither bake nor spheres"]),
}


@pytest.mark.parametrize("case", WRONG)
def test_what_is_wrong_is_named_with_what_was_expected(case):
    bake, spheres, words = WRONG[case]
    message, code = said(read_job_spec, bake, spheres)
    assert code == 2
    for word in words:
        assert word in message


def spoken(command, words):
    """The options that the real command makes of words of its command line."""
    given = command.make_context("it", ["mesh.obj", *words]).params
    if command is bake_command:
        return BakeOptions(**{key: given[key] for key in given if key in hints(BakeOptions) and key != "bent_normals"})
    return SphereOptions(**{key: given[key] for key in hints(SphereOptions)} | {"levels": given["levels"] or ()})


def hints(kind):
    return get_type_hints(kind)


def drawn(kind, chance):
    """Options of which some are drawn by chance; what cannot be together is drawn again."""
    possible = {}
    for key, _, meant in said_of(kind):
        possible.setdefault(key, []).append(meant)
    while True:
        keys = chance.sample(sorted(possible), chance.randrange(len(possible)))
        chosen = {key: chance.choice(possible[key]) for key in keys}
        if kind is BakeOptions:
            chosen |= {"width": chance.choice((64, 1024)), "height": chance.choice((64, 1024))}
        try:
            return kind(**chosen)
        except UsageError:
            continue


@pytest.mark.parametrize(("kind", "command"), [(BakeOptions, bake_command), (SphereOptions, spheres_command)])
@pytest.mark.parametrize("seed", range(4))
def test_words_mean_the_options_that_they_were_made_from(seed, kind, command):
    chance = random.Random(seed)
    for _ in range(100):
        options = drawn(kind, chance)
        words = as_words(options)
        assert spoken(command, shlex.split(shlex.join(words))) == as_the_command_has_it(options), words


def as_the_command_has_it(options):
    """The same, without a number of spheres that nothing comes of."""
    if isinstance(options, SphereOptions) and (options.levels or options.tolerance is not None):
        return replace(options, spheres=SphereOptions.spheres)
    return options


def test_defaults_need_no_words():
    assert as_words(BakeOptions()) == as_words(SphereOptions()) == []


def test_names_of_parts_may_be_anything():
    options = BakeOptions(only=("--all", "a b", "it's", "-n", 'say "hi"', "*", ""))
    assert spoken(bake_command, shlex.split(shlex.join(as_words(options)))) == options


@pytest.mark.parametrize("limit", [1, 1023, 1500, 1 << 40, (1 << 50) - 1, 1 << 50])
def test_a_memory_limit_of_any_amount_is_one_that_the_command_takes(limit):
    found = spoken(bake_command, as_words(BakeOptions(memory_limit=limit))).memory_limit
    assert abs(found - limit) <= max(1024, limit / 1000)


@pytest.mark.parametrize("mesh", ["rock.obj", "-rock.obj", "a folder/it's.obj"])
def test_the_commands_of_a_result_make_the_same_files(mesh, tmp_path):
    outputs = {
        "bake_output": (".exr", ".glb"),
        "spheres_output": (".csv", ".urdf"),
        "bent_normals": ".png",
        "sh": ".exr",
    }
    spec = JobSpec(BAKE, SPHERES, verify=True, **outputs)
    bake, spheres = (
        shlex.split(line) for line in reproduce_commands(AssetResult(Asset("props/stone", mesh, spec), "made"))
    )
    given = bake_command.make_context("bake", bake[2:]).params
    assert bake[:2] == ["aoprecalc", "bake"]
    assert (given["mesh"], given["output"]) == (mesh, ("stone_ao.exr", "stone_ao.glb"))
    assert (given["verify"], given["bent_normals"], given["sh"]) == (True, "stone_bent.png", "stone_sh.exr")
    assert given["size"] == (64, 64)
    given = spheres_command.make_context("spheres", spheres[2:]).params
    assert spheres[:2] == ["aoprecalc", "spheres"]
    assert given["output"] == ("stone_spheres.csv", "stone_spheres.urdf")
    assert (given["mesh"], given["spheres"]) == (mesh, 8)
