"""The jobs as a whole, each the story of one job in a screenful: bake, fit_spheres."""

from aoprecalc.recipes.baking import BakeResult, bake, bake_scene
from aoprecalc.recipes.fitting import SpheresResult, fit_spheres

__all__ = ["BakeResult", "SpheresResult", "bake", "bake_scene", "fit_spheres"]
