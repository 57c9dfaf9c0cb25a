"""Shader programs from the `.glsl` files that lie beside the code that uses them."""

import re
from importlib.resources import files

import moderngl

_HEADER = "#version 430 core\n"
_INCLUDE = re.compile(r'^#include "(.+)"$', re.MULTILINE)


def source(package: str, name: str, **constants: float | str) -> str:
    """Return the text of shader `name` in `package`, made complete.

    Gives it the version line, a #define for each constant, and, for each line `#include "x.glsl"`, the text of
    that file beside the shader or in this folder.
    """
    defines = "".join(f"#define {key} {value}\n" for key, value in constants.items())
    return _HEADER + defines + _text(package, name)


def _text(package: str, name: str) -> str:
    beside = files(package) / name
    text = (beside if beside.is_file() else files("aoprecalc.gl") / name).read_text(encoding="utf-8")
    return _INCLUDE.sub(lambda line: _text(package, line[1]), text)


def draw_program(
    context: moderngl.Context, package: str, vertex: str, fragment: str, **constants: float | str
) -> moderngl.Program:
    """Compile a vertex and a fragment shader of `package` into a program."""
    return context.program(
        vertex_shader=source(package, vertex, **constants), fragment_shader=source(package, fragment, **constants)
    )


def compute_program(
    context: moderngl.Context, package: str, name: str, **constants: float | str
) -> moderngl.ComputeShader:
    """Compile a compute shader of `package`."""
    return context.compute_shader(source(package, name, **constants))
