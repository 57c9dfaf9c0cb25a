"""What can be chosen about a job, with the defaults. Standard library only, so that `aoprecalc --help` is instant.

`fields` says how an option is stated; each class here states the options of one command.
"""

from aoprecalc.options.bake import (  # fmt: skip
    LARGE_MESH,
    Backend,
    BakeOptions,
    BitDepth,
    Estimator,
    Fill,
    Instances,
    LightOptions,
    Normals,
    Pack,
    Sampling,
    Unwrap,
    Up,
    ValueOptions,
    VerifyOptions,
)
from aoprecalc.options.others import BatchOptions, CompareOptions, Init, Method, Radius, Ship, SphereOptions

__all__ = [
    "LARGE_MESH", "Backend", "BakeOptions", "BatchOptions", "BitDepth", "CompareOptions", "Estimator", "Fill", "Init",
    "Instances", "LightOptions", "Method", "Normals", "Pack", "Radius", "Sampling", "Ship", "SphereOptions", "Unwrap",
    "Up", "ValueOptions", "VerifyOptions",
]  # fmt: skip
