"""The jobs as a whole, each the story of one job in a screenful: bake, fit_spheres, verify."""

from aoprecalc.recipes.baking import BakeResult, bake, bake_scene
from aoprecalc.recipes.fitting import MeasureResult, SpheresResult, fit_spheres, measure_spheres
from aoprecalc.recipes.verifying import VerifyResult, verify, verify_scene

__all__ = [
    "BakeResult",
    "MeasureResult",
    "SpheresResult",
    "VerifyResult",
    "bake",
    "bake_scene",
    "fit_spheres",
    "measure_spheres",
    "verify",
    "verify_scene",
]
