"""Options in Python: each is stated once, checked when it is given, and documented."""

import pickle
import re
from dataclasses import fields, replace

import numpy as np
import pytest

import aoprecalc
from aoprecalc.cli import main
from aoprecalc.cli.options import option_name
from aoprecalc.errors import ArgumentError
from aoprecalc.options import (
    BakeOptions,
    BatchOptions,
    CompareOptions,
    LightOptions,
    PreviewOptions,
    SphereOptions,
    VerifyOptions,
)
from aoprecalc.options.fields import option_field, option_fields
from aoprecalc.options.quantities import LEVELS, SIZE

CLASSES = {
    "bake": BakeOptions,
    "spheres": SphereOptions,
    "verify": VerifyOptions,
    "compare": CompareOptions,
    "preview": PreviewOptions,
    "batch": BatchOptions,
}


@pytest.mark.parametrize("kind", [*CLASSES.values(), LightOptions])
def test_every_field_is_documented(kind):
    section = kind.__doc__.split("    Parameters\n    ----------\n")[1]
    assert re.findall(r"^    (\w+) : .+, default .+$", section, re.MULTILINE) == [it.name for it in option_fields(kind)]
    assert {field.name for field in fields(kind)} == {it.name for it in option_fields(kind) if not it.init_only}
    for field in option_fields(kind):
        assert field.option.help.endswith("."), field.name
        assert field.option.help.count(". ") <= 1, "one or two sentences"
        assert all(
            name in vars(kind) or option_field(kind, name) for name in re.findall(r"`([a-z_]+)`", field.option.help)
        )


@pytest.mark.parametrize("command", CLASSES)
def test_every_field_is_an_option_of_the_command(command):
    names = {name for entry in main.commands[command].params for name in entry.opts}
    assert {option_name(field.name) for field in option_fields(CLASSES[command]) if field.on_command_line} <= names


@pytest.mark.parametrize("command", CLASSES)
def test_a_command_without_options_has_the_defaults_of_the_class(command):
    given = main.commands[command].make_context(command, ["a.obj", "b.obj"][: 1 + (command == "compare")]).params
    for field in option_fields(CLASSES[command]):
        if field.on_command_line:
            value = given[field.name]
            assert value == field.default or (not value and field.kind in ("names", "files", "integers")), field.name


@pytest.mark.parametrize("size", [(2048, 1024), [2048, 1024], tuple(np.array([2048, 1024]))])
def test_a_size_sets_width_and_height(size):
    options = aoprecalc.BakeOptions(size=size)
    assert (options.width, options.height) == options.size == (2048, 1024)
    assert options == BakeOptions(size=(2048, 1024)) == BakeOptions(width=2048, height=1024)


def test_a_size_may_be_one_number_and_takes_precedence():
    assert BakeOptions(size=64) == BakeOptions(size=64) == BakeOptions(width=32, height=32, size=64)
    assert BakeOptions().size == (1024, 1024)


def test_replace_changes_what_it_is_given():
    options = BakeOptions(size=(64, 32), directions=8)
    assert replace(options, width=16).size == (16, 32)
    assert replace(options, size=16).size == (16, 16)
    assert replace(options, padding=2) == BakeOptions(size=(64, 32), directions=8, padding=2)


@pytest.mark.parametrize("options", [BakeOptions(size=(64, 32)), SphereOptions(levels=(2, 4)), BatchOptions(jobs=2)])
def test_options_travel_to_other_processes(options):
    assert pickle.loads(pickle.dumps(options)) == options
    assert hash(options) == hash(replace(options))


def test_numbers_of_numpy_and_lists_become_plain_values():
    options = BakeOptions(size=np.int64(64), padding=np.int32(3), two_sided=np.True_, only=["a"], crease_angle=40)
    assert options == BakeOptions(size=64, padding=3, two_sided=True, only=("a",), crease_angle=40)
    assert type(options.width) is type(options.padding) is int
    assert type(options.two_sided) is bool
    assert type(VerifyOptions(tolerance=np.float32(0.5)).tolerance) is float
    assert SphereOptions(levels=[np.int64(2), 4]).levels == (2, 4)
    assert BakeOptions(only="roof").only == ("roof",)


WRONG = [
    (BakeOptions, {"width": 0}, "width is 0; expected a whole number from 1 to 32768"),
    (BakeOptions, {"height": 1.5}, "height is 1.5; expected a whole number"),
    (BakeOptions, {"size": 0}, "size is 0; expected a whole number from 1 to 32768, or a width and a height"),
    (BakeOptions, {"size": (64, 0)}, "size is 64x0; expected"),
    (BakeOptions, {"size": (1, 2, 3)}, "size is (1, 2, 3); expected"),
    (BakeOptions, {"size": "64"}, "size is '64'; expected"),
    (BakeOptions, {"padding": True}, "padding is True; expected a whole number from 0 to 256"),
    (BakeOptions, {"crease_angle": float("nan")}, "crease_angle is nan; expected a number from 0 to 180"),
    (BakeOptions, {"crease_angle": "40"}, "crease_angle is '40'; expected a number"),
    (BakeOptions, {"unwrap_timeout": 0}, "unwrap_timeout is 0; expected a number above 0, at most 1000000"),
    (BakeOptions, {"directions": "many"}, "directions is 'many'; expected a whole number from 1 to 1000000, or 'auto'"),
    (BakeOptions, {"fill": "red"}, "fill is 'red'; expected one of mean, pushpull, none"),
    (BakeOptions, {"fill": ["mean"]}, "fill is ['mean']; expected one of"),
    (BakeOptions, {"two_sided": 1}, "two_sided is 1; expected true or false"),
    (BakeOptions, {"only": (1,)}, "only is (1,); expected a list of names"),
    (BakeOptions, {"only": None}, "only is None; expected a list of names"),
    (BakeOptions, {"occluder": (1,)}, "occluder is (1,); expected a list of paths of files"),
    (BakeOptions, {"occluder": ""}, "occluder is ''; expected a list of paths of files"),
    (BakeOptions, {"sky": "cloudy"}, "sky is 'cloudy'; expected the path of a file, or 'uniform', or 'overcast'"),
    (BakeOptions, {"cage": "2cm"}, "cage is '2cm'; expected the path of a file, or a length, or a share of the"),
    (BakeOptions, {"cage": "-0.5"}, "cage is '-0.5'; expected the path of a file, or a length, or a share of the"),
    (BakeOptions, {"up": "z"}, "up is 'z', but there is no ground and no sky; add ground or sky, or omit up"),
    (BakeOptions, {"ground_height": 0}, "ground_height is 0, but there is no ground; add ground"),
    (BakeOptions, {"memory_limit": "1.5G"}, "memory_limit is '1.5G'; expected a whole number"),
    (SphereOptions, {"levels": ("2", "4")}, "levels is ('2', '4'); expected a list of whole numbers"),
    (VerifyOptions, {"rays": 4}, "rays is 4; expected a whole number from 64 to"),
    (CompareOptions, {"tolerance": -1}, "tolerance is -1; expected a number from 0 to 1"),
    (BatchOptions, {"scheduler": 8786}, "scheduler is 8786; expected a text"),
    (BatchOptions, {"timeout": 0}, "timeout is 0; expected a number above 0"),
    (BatchOptions, {"split": True}, "split is for the workers of a scheduler, which was not given"),
]


@pytest.mark.parametrize(("kind", "given", "message"), WRONG)
def test_a_wrong_value_names_the_argument(kind, given, message):
    with pytest.raises(ArgumentError, match=f"^{re.escape(message)}") as failure:
        kind(**given)
    assert failure.value.exit_code == 2
    assert "--" not in str(failure.value)
    assert str(pickle.loads(pickle.dumps(failure.value))) == str(failure.value)


def test_the_command_line_names_the_option_instead():
    with pytest.raises(ArgumentError) as failure:
        SphereOptions(method="shadow", max_iterations=5)
    assert failure.value.worded(option_name).startswith("--max-iterations is not for --method shadow")


@pytest.mark.parametrize(("quantity", "value"), [(SIZE, (64, 64)), (SIZE, (64, 32)), (LEVELS, (2, 8))])
def test_quantities_are_read_as_they_are_written(quantity, value):
    assert quantity.read(quantity.write(value)) == value
