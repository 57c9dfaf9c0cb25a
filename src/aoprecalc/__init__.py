"""Ambient-occlusion textures and shadow-casting spheres, precomputed for triangle meshes.

    import aoprecalc as ao
    result = ao.bake("mesh.obj")           # result.ao is the texture, result.mesh has its UVs
    result.save("build/")                  # writes build/mesh_ao.png and build/mesh_ao.obj
    spheres = ao.fit_spheres("mesh.obj")   # spheres.centers, spheres.radii
    spheres.save("build/")                 # writes build/mesh_spheres.json

A mesh may also be `ao.Mesh(vertices, faces)`, from arrays, or a `trimesh.Trimesh`. Modules are imported on first use of
their names, so that importing the package takes no time; type checkers see the imports below.
"""

from importlib import import_module
from typing import TYPE_CHECKING

__version__ = "0.2.0"

__all__ = [
    "AoprecalcError",
    "ArgumentError",
    "AssetResult",
    "BakeFigures",
    "BakeFiles",
    "BakeOptions",
    "BakeReport",
    "BakeResult",
    "BatchOptions",
    "BatchProgress",
    "BatchReport",
    "BatchResult",
    "CompareOptions",
    "CompareReport",
    "DoctorReport",
    "Figures",
    "InputError",
    "Mesh",
    "OutputError",
    "PageReport",
    "PreviewOptions",
    "PreviewReport",
    "PreviewResult",
    "Progress",
    "RendererError",
    "SphereOptions",
    "SphereQuality",
    "SphereResult",
    "SphereSet",
    "UsageError",
    "ValueOptions",
    "VerifyOptions",
    "VerifyReport",
    "__version__",
    "bake",
    "batch",
    "compare",
    "doctor",
    "fit_spheres",
    "load",
    "load_spheres",
    "measure_spheres",
    "preview",
    "verify",
    "write_report",
]

if TYPE_CHECKING:
    from aoprecalc.api.bake import BakeResult, bake
    from aoprecalc.api.bake_files import BakeFiles
    from aoprecalc.api.compare import CompareReport, compare
    from aoprecalc.api.doctor import DoctorReport, doctor
    from aoprecalc.api.figures import BakeFigures, Figures
    from aoprecalc.api.mesh import Mesh, load
    from aoprecalc.api.preview import PreviewReport, PreviewResult, preview
    from aoprecalc.api.report import PageReport, write_report
    from aoprecalc.api.reports import BakeReport
    from aoprecalc.api.sphere_quality import SphereQuality
    from aoprecalc.api.spheres import SphereResult, fit_spheres, load_spheres, measure_spheres
    from aoprecalc.api.verify import verify
    from aoprecalc.api.verify_report import VerifyReport
    from aoprecalc.errors import AoprecalcError, ArgumentError, InputError, OutputError, RendererError, UsageError
    from aoprecalc.options import (
        BakeOptions,
        BatchOptions,
        CompareOptions,
        PreviewOptions,
        SphereOptions,
        ValueOptions,
        VerifyOptions,
    )
    from aoprecalc.pipeline import AssetResult, BatchProgress, BatchReport, BatchResult, batch
    from aoprecalc.progress import Progress
    from aoprecalc.types import SphereSet
else:
    _MODULES = {
        "api.bake": ("BakeResult", "bake"),
        "api.bake_files": ("BakeFiles",),
        "api.compare": ("CompareReport", "compare"),
        "api.doctor": ("DoctorReport", "doctor"),
        "api.figures": ("BakeFigures", "Figures"),
        "api.mesh": ("Mesh", "load"),
        "api.preview": ("PreviewReport", "PreviewResult", "preview"),
        "api.report": ("PageReport", "write_report"),
        "api.reports": ("BakeReport",),
        "api.sphere_quality": ("SphereQuality",),
        "api.spheres": ("SphereResult", "fit_spheres", "load_spheres", "measure_spheres"),
        "api.verify": ("verify",),
        "api.verify_report": ("VerifyReport",),
        "errors": ("AoprecalcError", "ArgumentError", "InputError", "OutputError", "RendererError", "UsageError"),
        "options": (
            "BakeOptions",
            "BatchOptions",
            "CompareOptions",
            "PreviewOptions",
            "SphereOptions",
            "ValueOptions",
            "VerifyOptions",
        ),
        "pipeline": ("AssetResult", "BatchProgress", "BatchReport", "BatchResult", "batch"),
        "progress": ("Progress",),
        "types": ("SphereSet",),
    }
    _MODULE_OF = {name: module for module, names in _MODULES.items() for name in names}

    def __getattr__(name):
        if name not in _MODULE_OF:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        value = getattr(import_module(f"{__name__}.{_MODULE_OF[name]}"), name)
        globals()[name] = value
        return value

    def __dir__():
        return sorted(__all__)
