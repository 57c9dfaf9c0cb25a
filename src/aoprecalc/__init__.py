"""Ambient-occlusion textures and shadow-casting spheres, precomputed for triangle meshes.

    import aoprecalc
    result = aoprecalc.bake("mesh.obj")            # writes mesh_ao.png and mesh_ao.obj
    spheres = aoprecalc.fit_spheres("mesh.obj")    # writes mesh_spheres.json

What the names stand for is loaded on first use, so that importing the package costs nothing.
"""

from importlib import import_module
from typing import Any

__version__ = "0.1.0"

_HOMES = {
    "bake": "api.bake",
    "bake_scene": "api.bake",
    "batch": "pipeline",
    "compare": "api.compare",
    "doctor": "api.doctor",
    "fit_spheres": "api.spheres",
    "measure_spheres": "api.spheres",
    "verify": "api.verify",
    "BakeOptions": "options",
    "BatchOptions": "options",
    "CompareOptions": "options",
    "SphereOptions": "options",
    "VerifyOptions": "options",
    "BatchResult": "pipeline",
    "AssetResult": "pipeline",
    "BatchProgress": "pipeline",
    "Progress": "progress",
    "Scene": "types",
    "Atlas": "types",
    "Baked": "types",
    "Texture": "types",
    "SphereSet": "types",
    "load_scene": "io",
    "AoprecalcError": "errors",
    "ArgumentError": "errors",
    "InputError": "errors",
    "OutputError": "errors",
    "RendererError": "errors",
    "UsageError": "errors",
}

__all__ = ["__version__", *_HOMES]


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_HOMES[name]}"), name)


def __dir__() -> list[str]:
    return sorted(__all__)
