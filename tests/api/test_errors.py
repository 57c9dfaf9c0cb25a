"""Messages name the Python argument in Python and the option on the command line."""

import subprocess
import sys

import pytest

import aoprecalc as ao
from aoprecalc.errors import InputError, option_name
from shapes import ball


def test_only_whole_options_are_renamed():
    error = InputError("my--file.obj: raise --unwrap-timeout, or pass -o and --size (--no-cache); see a--b")
    assert str(error) == "my--file.obj: raise unwrap_timeout, or pass -o and size (no_cache); see a--b"
    assert "raise --unwrap-timeout, or pass -o and --size" in error.worded(option_name)


@pytest.mark.parametrize(
    ("options", "argument"),
    [({"unwrap": "keep"}, "use unwrap auto or xatlas"), ({"normals": "file"}, "use normals auto or smooth")],
)
def test_advice_names_arguments_in_python_and_options_on_the_command_line(options, argument, tmp_path):
    mesh = ao.Mesh(*ball(0))
    with pytest.raises(InputError) as raised:
        ao.bake(mesh, ao.BakeOptions(size=64, **options))
    assert argument in str(raised.value)
    assert "--" not in str(raised.value)

    mesh.to_trimesh().export(tmp_path / "ball.obj", include_normals=False)
    words = [word for name, value in options.items() for word in (option_name(name), value)]
    command = [sys.executable, "-m", "aoprecalc", "bake", "ball.obj", *words]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert argument.replace("use ", "use --") in done.stderr
