"""Formats that are read through trimesh; a bake of them is written as GLB.

Only geometry is read: triangles, the placement of each instance, and for COLLADA the normals and the first UV set.
"""

import logging
from collections.abc import Iterator
from io import BytesIO
from pathlib import Path
from typing import Any, ClassVar
from zipfile import ZipFile

import numpy as np

from aoprecalc.errors import InputError
from aoprecalc.io.formats.base import MeshFormat
from aoprecalc.io.formats.builder import MeshPiece, build_scene, cofactors
from aoprecalc.types import REVERSED_WINDING, Atlas, Scene

_MAX_UNPACKED = 1 << 30  # bytes; as XML that is more triangles than a bake can use


class TrimeshFormat(MeshFormat):
    """A format for which trimesh has a loader.

    packages   which that loader needs, beside trimesh; the extra `formats` installs them
    """

    packages: ClassVar[tuple[str, ...]]

    def read(self, path: Path, data: bytes) -> Scene:
        """Read every instance of every mesh as a part; raises InputError where a package is missing."""
        from trimesh import available_formats  # takes half a second, which other formats should not pay
        from trimesh.exchange.load import mesh_loaders

        kind = path.suffix.lower().removeprefix(".")
        if kind not in available_formats():
            needed = " and ".join(self.packages)
            raise InputError(f"{path}: {self.name} needs the package {needed}; `pip install 'aoprecalc[formats]'`")
        logging.getLogger("trimesh").addHandler(logging.NullHandler())  # else its errors go to stderr
        _check_unpacked_size(path, data)
        load: Any = mesh_loaders[kind]
        loaded = load(file_obj=BytesIO(data), file_type=kind, resolver=None)
        return build_scene(path, kind, list(_pieces(loaded)))

    def output_extension(self, scene: Scene, atlas: Atlas | None) -> tuple[str, str]:
        """Return .glb."""
        return ".glb", f"{self.name} is not written, so the mesh becomes a GLB"


def _check_unpacked_size(path: Path, data: bytes) -> None:
    """Raise InputError for a ZIP that would fill the memory, as a few megabytes of it may."""
    if not data.startswith(b"PK"):
        return
    with ZipFile(BytesIO(data)) as archive:
        size = sum(entry.file_size for entry in archive.infolist())
    if size > _MAX_UNPACKED:
        expected = f"at most {_MAX_UNPACKED >> 30} GiB were expected; use a smaller model"
        raise InputError(f"{path}: is a ZIP of {size / (1 << 30):.1f} GiB when unpacked, {expected}")


def _pieces(loaded: dict[str, Any]) -> Iterator[MeshPiece]:
    """Yield each instance of a geometry, placed in the world, from what a loader of trimesh returns."""
    from trimesh.scene.transforms import SceneGraph

    graph: Any = SceneGraph(base_frame=loaded.get("base_frame", "world"))
    for edge in loaded["graph"]:
        graph.update(**edge)
    for node in graph.nodes_geometry:
        matrix, name = graph.get(node)
        mesh, linear = loaded["geometry"][name], matrix[:3, :3]
        faces = np.asarray(mesh["faces"], np.int64).reshape(-1, 3)
        mirrored = np.linalg.det(linear) < 0
        if mirrored:
            faces = faces[:, REVERSED_WINDING]
        positions = np.asarray(mesh["vertices"], np.float64).reshape(-1, 3) @ linear.T + matrix[:3, 3]
        normals, uvs = mesh.get("vertex_normals"), getattr(mesh.get("visual"), "uv", None)
        if normals is not None:
            normals = (normals @ cofactors(linear).T * (-1 if mirrored else 1))[faces]
        yield MeshPiece(str(node), positions, faces, normals, () if uvs is None else (uvs[faces],), names=(str(name),))


class ColladaFormat(TrimeshFormat):
    """COLLADA, plain or zipped."""

    name = "COLLADA"
    extensions = (".dae", ".zae")
    packages = ("pycollada",)
    not_read = "its materials, other UV sets, skins, animations, cameras and lights"

    def sniff(self, data: bytes) -> bool:
        """Tell whether there is a COLLADA element, or a ZIP with a .dae in it."""
        return b"<COLLADA" in data[:4096] or (data.startswith(b"PK") and b".dae" in data)


class ThreeMfFormat(TrimeshFormat):
    """3D Manufacturing Format."""

    name = "3MF"
    extensions = (".3mf",)
    packages = ("networkx", "lxml")
    not_read = "its materials, colours, beams and print settings"

    def sniff(self, data: bytes) -> bool:
        """Tell whether it is a ZIP with a 3D model in it."""
        return data.startswith(b"PK") and b"3dmodel.model" in data.lower()
