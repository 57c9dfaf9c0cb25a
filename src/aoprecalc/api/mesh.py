"""Meshes from arrays, files and trimesh, and back to trimesh."""

import re
import sys
from dataclasses import dataclass, field, replace
from os import PathLike
from typing import TYPE_CHECKING, Any, Self, TypeVar, Union

import numpy as np
from numpy.typing import ArrayLike, NDArray

from aoprecalc.errors import ArgumentError, counted
from aoprecalc.io import load_scene, scene_from_arrays, texture_values
from aoprecalc.mesh.roles import without_surroundings
from aoprecalc.mesh.topology import corners_to_vertices
from aoprecalc.options import ValueOptions
from aoprecalc.types import Baked, Float32Array, Float64Array, Int32Array, Scene

if TYPE_CHECKING:
    from trimesh import Trimesh

OptionsT = TypeVar("OptionsT")
MeshLike = Union["Mesh", "Trimesh", str, PathLike[str]]


@dataclass(frozen=True, eq=False, init=False)
class Mesh:
    """A triangle mesh, checked; its arrays are read-only.

    V is the number of vertices, F of faces. Vertices at equal positions are treated as one, as in every file that is
    read: a triangle soup bakes like the welded mesh.

    Parameters
    ----------
    vertices : array_like, (V, 3)
        Positions: finite, in any unit.
    faces : array_like of int, (F, 3)
        Vertex indices, counter-clockwise seen from the front. At least one face has an area.
    normals : array_like, optional
        Shading normals of any length, per vertex (V, 3) or per face corner (F, 3, 3). Without any, a bake makes its
        own, see `BakeOptions.normals`.
    uvs : array_like, optional
        UVs with v upwards, per vertex (V, 2) or per face corner (F, 3, 2). A bake keeps them if they can hold a
        texture, see `BakeOptions.unwrap`.
    name : str
        Stem of the names of the files that are saved.

    Attributes
    ----------
    vertices : ndarray, (V, 3) float64
    faces : ndarray, (F, 3) int32
    normals : ndarray, (F, 3, 3) float32, or None
        Unit length.
    uvs : ndarray, (F, 3, 2) float64, or None
        Of a file with several UV sets, the first.
    name : str
    ao : ndarray, (H, W) float32, or None
        Ambient occlusion in [0, 1], row 0 at v = 1, of a mesh that `bake` returned; its UVs are `uvs`.

    Raises
    ------
    ArgumentError
        If an array has the wrong shape or type, is not finite, or a face refers to a vertex that does not exist.
    InputError
        If no face has an area.

    Examples
    --------
    >>> import aoprecalc as ao
    >>> mesh = ao.Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])
    >>> mesh.faces.shape
    (1, 3)
    """

    vertices: Float64Array
    faces: Int32Array
    normals: Float32Array | None
    uvs: Float64Array | None
    name: str
    ao: Float32Array | None
    _scene: Scene = field(repr=False)
    _options: ValueOptions | None = field(repr=False)  # those of the bake of `ao`

    def __init__(
        self,
        vertices: ArrayLike,
        faces: ArrayLike,
        *,
        normals: ArrayLike | None = None,
        uvs: ArrayLike | None = None,
        name: str = "mesh",
    ) -> None:
        """Check the arrays and copy them."""
        if not isinstance(name, str) or not re.fullmatch(r"[^/\\\0]+", name):
            raise ArgumentError("name", f"is {name!r}, a file name without slashes was expected")
        scene = scene_from_arrays(vertices, faces, normals=normals, uvs=uvs, name=name)
        self._set(scene, np.array(vertices, np.float64), np.array(faces, np.int32), name)

    @classmethod
    def _of(
        cls,
        scene: Scene,
        vertices: Float64Array,
        faces: Int32Array,
        name: str,
        ao: Float32Array | None = None,
        options: ValueOptions | None = None,
    ) -> Self:
        mesh = cls.__new__(cls)
        mesh._set(scene, vertices, faces, name, ao, options)
        return mesh

    def _set(
        self,
        scene: Scene,
        vertices: Float64Array,
        faces: Int32Array,
        name: str,
        ao: Float32Array | None = None,
        options: ValueOptions | None = None,
    ) -> None:
        arrays: dict[str, NDArray[Any] | None]
        arrays = {"vertices": vertices, "faces": faces, "normals": scene.normals, "uvs": scene.uvs, "ao": ao}
        for attribute, array in arrays.items():
            object.__setattr__(self, attribute, None if array is None else _read_only(array))
        object.__setattr__(self, "name", name)
        object.__setattr__(self, "_scene", scene)
        object.__setattr__(self, "_options", options)

    def __repr__(self) -> str:
        """Name and size."""
        return f"Mesh({self.name!r}, {len(self.vertices)} vertices, {counted(len(self.faces), 'face')})"

    @classmethod
    def from_trimesh(cls, mesh: "Trimesh", *, normals: bool = False, name: str = "mesh") -> "Mesh":
        """Take a `trimesh.Trimesh` with the UVs of its `TextureVisuals`.

        Parameters
        ----------
        mesh : trimesh.Trimesh
            A mesh, with or without UVs.
        normals : bool
            Take `mesh.vertex_normals` too. By default a bake makes its own, as trimesh computes normals where a file
            has none and does not tell the two apart.
        name : str
            Stem of the names of the files that are saved.

        Returns
        -------
        Mesh

        Raises
        ------
        ArgumentError, InputError
            As from `Mesh`.
        """
        if not _is_trimesh(mesh):
            hint = "; use scene.to_mesh()" if type(mesh).__name__ == "Scene" else ""
            raise ArgumentError("mesh", f"is of type {type(mesh).__name__}, a trimesh.Trimesh was expected{hint}")
        uvs = getattr(mesh.visual, "uv", None)
        vertex_normals = mesh.vertex_normals if normals else None
        return cls(mesh.vertices, mesh.faces, normals=vertex_normals, uvs=uvs, name=name)

    def to_trimesh(self, ao: ArrayLike | None = None) -> "Trimesh":
        """Return a `trimesh.Trimesh` with the UVs, the normals and the ambient occlusion as its picture.

        Faces keep their order. Vertices are split where UVs or normals differ, as trimesh has one of each per vertex.

        Parameters
        ----------
        ao : array_like, (H, W), optional
            Texture values in [0, 1], row 0 at v = 1. By default the mesh's own, see `Mesh.ao`. In the picture they are
            rounded to 8 bits.

        Returns
        -------
        trimesh.Trimesh
            Its `visual` is a `trimesh.visual.TextureVisuals` if the mesh has UVs.

        Raises
        ------
        ArgumentError
            If `ao` is not a texture, or the mesh has no UVs for it.
        """
        import trimesh

        values = self.ao if ao is None else texture_values("ao", ao)
        if ao is not None and self.uvs is None:
            raise ArgumentError("ao", "needs UVs, which the mesh lacks; give `Mesh` some, or use the mesh of a bake")
        corners = [values for values in (self.normals, self.uvs) if values is not None]
        if not corners:
            return trimesh.Trimesh(self.vertices, self.faces, process=False)
        split = corners_to_vertices(self.faces, *corners)
        visual = None
        if self.uvs is not None:
            uv = self.uvs.reshape(-1, 2)[split.corner]
            image = None if values is None else _picture(values)
            visual = trimesh.visual.TextureVisuals(uv=uv, image=image)  # type: ignore[no-untyped-call]  # has no types
        return trimesh.Trimesh(
            self.vertices[self.faces.reshape(-1)[split.corner]],
            split.triangles,
            vertex_normals=None if self.normals is None else self.normals.reshape(-1, 3)[split.corner],
            visual=visual,
            process=False,
        )


@dataclass(frozen=True, eq=False, init=False, repr=False)
class BakedMesh(Mesh):
    """The mesh of a bake, which has normals, UVs and a texture."""

    normals: Float32Array
    uvs: Float64Array
    ao: Float32Array

    @classmethod
    def of(cls, mesh: Mesh, baked: Baked, uvs: Float64Array) -> Self:
        """Return a mesh with the texture of its bake and the normals that were used, without the rest of its file.

        uvs   (f, 3, 2) float64: those of the texture
        """
        own = replace(
            without_surroundings(baked.scene),
            format="",
            uv_sets=(uvs,),
            normals=baked.normals,
            document=None,
            warnings=(),
            notes=(),
        )
        return cls._of(own, mesh.vertices, mesh.faces, mesh.name, baked.texture.values, baked.options)


def load(path: str | PathLike[str]) -> Mesh:
    """Read a mesh file.

    Parameters
    ----------
    path : str or path-like
        An .obj, .ply, .stl, .off, .gltf or .glb file; with the extra `formats` also .dae, .zae or .3mf, with
        `usd` .usd, .usda, .usdc or .usdz. The page on file formats says what is read of each.

    Returns
    -------
    Mesh
        With everything else that the file holds, so that `BakeResult.save` can give it back.

    Raises
    ------
    UsageError
        If the extension is unknown.
    InputError
        If the file is missing, damaged, or has no face with an area.
    """
    if not isinstance(path, str | PathLike):
        raise ArgumentError("path", f"is of type {type(path).__name__}, the path of a mesh file was expected")
    scene = load_scene(path)
    return Mesh._of(scene, scene.positions, scene.faces, scene.path.stem)


def as_mesh(mesh: MeshLike) -> Mesh:
    """Return what a job takes for a mesh as one; raises ArgumentError where it is none, and what `load` raises."""
    if isinstance(mesh, Mesh):
        return mesh
    if isinstance(mesh, str | PathLike):
        return load(mesh)
    if _is_trimesh(mesh):
        return Mesh.from_trimesh(mesh)
    hint = "; use scene.to_mesh()" if type(mesh).__name__ == "Scene" else ""
    expected = f"a Mesh, a path or a trimesh.Trimesh was expected{hint}"
    raise ArgumentError("mesh", f"is of type {type(mesh).__name__}, {expected}")


def given_or_default(options: OptionsT | None, kind: type[OptionsT]) -> OptionsT:
    """Return the options of a job; raises ArgumentError where they are of another kind."""
    if options is not None and not isinstance(options, kind):
        raise ArgumentError("options", f"is of type {type(options).__name__}, {kind.__name__} was expected")
    return kind() if options is None else options


def _is_trimesh(mesh: object) -> bool:
    module = sys.modules.get("trimesh")  # not imported here: that takes half a second
    return module is not None and isinstance(mesh, module.Trimesh)


def _read_only(array: NDArray[Any]) -> NDArray[Any]:
    view = array.view()
    view.flags.writeable = False
    return view


def _picture(values: Float32Array) -> Any:
    from PIL import Image

    return Image.fromarray(np.floor(255 * values + 0.5).astype(np.uint8))
