"""The jobs as a whole, each the story of one job in a screenful: bake, fit_spheres, verify, compare, doctor."""

from aoprecalc.recipes.baking import BakeResult, bake, bake_scene
from aoprecalc.recipes.checkup import Checkup, doctor
from aoprecalc.recipes.comparing import CompareResult, compare
from aoprecalc.recipes.fitting import MeasureResult, SpheresResult, fit_spheres, measure_spheres
from aoprecalc.recipes.verifying import VerifyResult, verify, verify_scene

__all__ = [
    "BakeResult",
    "Checkup",
    "CompareResult",
    "MeasureResult",
    "SpheresResult",
    "VerifyResult",
    "bake",
    "bake_scene",
    "compare",
    "doctor",
    "fit_spheres",
    "measure_spheres",
    "verify",
    "verify_scene",
]
