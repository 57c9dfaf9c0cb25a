"""The values that travel through a job, each an immutable record over NumPy arrays.

    file | arrays -> Scene -> Atlas -> Texels -> visibility sums -> Texture -> files     (bake)
    file | arrays -> Scene -> samples -> SphereSet -> files                              (spheres)

Normals and UVs, which differ along seams, are stored at the corners of faces, never at vertices, so that no step has to
split or weld anything. Sizes in the docstrings: v distinct positions, f faces, k texels.
"""

from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from aoprecalc.notebook import figure, spheres_drawing
from aoprecalc.options import ValueOptions

Float32Array = NDArray[np.float32]
Float64Array = NDArray[np.float64]
Int32Array = NDArray[np.int32]
Int64Array = NDArray[np.int64]
BoolArray = NDArray[np.bool_]
UInt8Array = NDArray[np.uint8]
Picture = UInt8Array  # (height, width, 3) sRGB, row 0 on top
Wrap = Literal["repeat", "mirror", "clamp"]
SizeEstimates = tuple[tuple[int, float], ...]  # sizes of a texture, and the error that the resolution of each adds

REVERSED_WINDING = [0, 2, 1]  # order of a face's corners under a mirroring transform


@dataclass(frozen=True, eq=False)
class AlphaMask:
    """The alpha mask of a part's material (glTF alphaMode MASK).

    alpha     (h, w) float32 in [0, 1], row 0 at v = 1
    uvs       (n, 3, 2) float64 at the corners of the part's n faces, v upwards
    factors   (n, 3) float64 at the corners, by which the alpha is multiplied
    cutoff    there is a hole where the product is less
    wraps     the wrap modes along u and v, beyond [0, 1]
    """

    alpha: Float32Array
    uvs: Float64Array
    factors: Float64Array
    cutoff: float
    wraps: tuple[Wrap, Wrap] = ("repeat", "repeat")


@dataclass(frozen=True, eq=False)
class Material:
    """The properties of a part's material that matter to visibility.

    transparent   light passes through
    unlit         its colour does not depend on light, so that it needs no ambient occlusion
    foliage       a thin sheet that is visible from both sides, such as a leaf
    alpha_mask    None where it has no holes
    """

    transparent: bool = False
    unlit: bool = False
    foliage: bool = False
    alpha_mask: AlphaMask | None = None


@dataclass(frozen=True, eq=False)
class Part:
    """Consecutive faces of a Scene that were one object in the file (a group, a glTF primitive).

    name          as in the file, or generated
    start, stop   the faces scene.faces[start:stop]
    vertices      (stop - start, 3) int32: the index of the file's own vertex at each corner, within the object
    source        what the reader of the format needs to find the object again; opaque to others
    names         other names that select it: its groups, the nodes above it, its mesh, its material
    material      the material's properties
    instance_of   index of the first part that is an instance of the same mesh; None for that part itself
    duplicate_of  as instance_of, but only among parts that the file cannot tell apart, so that they share UVs
    receives      it gets ambient occlusion; occludes: it blocks light
    two_sided     its texels have the greater of both sides' values
    uv_owner      index of the part whose UV region it shares; None where it has its own
    lod           the level of detail that the file says it is (MSFT_lod): of which node, and which, 0 the finest
    levels        the levels of detail of the scene that show it, without gaps; None: all of them
    hull          a collision hull, which is not part of the picture
    """

    name: str
    start: int
    stop: int
    vertices: Int32Array
    source: object = None
    names: frozenset[str] = frozenset()
    material: Material = field(default_factory=Material)
    instance_of: int | None = None
    duplicate_of: int | None = None
    receives: bool = True
    occludes: bool = True
    two_sided: bool = False
    uv_owner: int | None = None
    lod: tuple[int, int] | None = None
    levels: range | None = None
    hull: bool = False

    @property
    def faces(self) -> slice:
        """The run as a slice."""
        return slice(self.start, self.stop)


@dataclass(frozen=True, eq=False)
class Scene:
    """All triangles of one file, in world space and in the file's units.

    path           the file
    format         lower-case extension without the dot, such as obj, ply or glb; empty for arrays
    positions      (v, 3) float64, finite, distinct, each used by a face
    faces          (f, 3) int32 indices into positions, f >= 1, counter-clockwise seen from the front
    normals        (f, 3, 3) float32, unit length: the shading normal at each corner; None where the file has none
    uv_sets        each (f, 3, 2) float64, v upwards (row 0 of an image is at v = 1), (0, 0) where a face has none
    parts          consecutive faces that cover the scene
    document       the original file as its reader keeps it, to write it back; opaque to others
    up, unit       the axis that points up, and the metres that 1 is, where the file says them
    polygons       (f,) int32: the polygon of each face, which no seam of new UVs may cut; None where they may be cut
    welded         corners of a file without shared vertices that were moved to meet, and by how much at most
    warnings, notes   lines for the user about the input: those that may need an action, those that need none
    surroundings   (o, 3, 3) float64: triangles of other files that occlude, too; None where there are none
    ground_normal  the unit vector away from the infinite ground plane below the scene; None where there is none
    """

    path: Path
    format: str
    positions: Float64Array
    faces: Int32Array
    normals: Float32Array | None
    uv_sets: tuple[Float64Array, ...]
    parts: tuple[Part, ...]
    document: object = None
    up: Literal["y", "z"] | None = None
    unit: float | None = None
    polygons: Int32Array | None = None
    welded: tuple[int, float] | None = None
    warnings: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    surroundings: Float64Array | None = None
    ground_normal: tuple[float, float, float] | None = None

    @property
    def corners(self) -> Float64Array:
        """(f, 3, 3) float64: the positions of each face's corners."""
        return self.positions[self.faces]

    @property
    def uvs(self) -> Float64Array | None:
        """The first UV set, (f, 3, 2) float64; None where the file has none."""
        return self.uv_sets[0] if self.uv_sets else None

    @property
    def levels(self) -> int:
        """The number of its levels of detail, at least 1."""
        return max((part.levels.stop for part in self.parts if part.levels), default=1)

    def per_face(self, values: Iterable[bool]) -> BoolArray:
        """Return the value of each face's part, (f,) bool, from one value for each part."""
        return np.repeat(np.fromiter(values, bool), [part.stop - part.start for part in self.parts])

    @property
    def receives(self) -> BoolArray:
        """(f,) bool: the faces that get ambient occlusion."""
        return self.per_face(part.receives for part in self.parts)

    @property
    def occludes(self) -> BoolArray:
        """(f,) bool: the faces that occlude, except in the holes of alpha masks."""
        return self.per_face(part.occludes for part in self.parts)

    @property
    def two_sided(self) -> BoolArray:
        """(f,) bool: the faces whose texels have the greater of both sides' values."""
        return self.per_face(part.two_sided for part in self.parts)


@dataclass(frozen=True)
class UvCheck:
    """Whether a UV set of the file can hold a bake.

    uv_set       its index
    flat_faces   number of faces that have area, but none in UV space; flat_share: their share of the surface, in [0, 1]
    tiles        the most repeats of the texture, along an axis, that a face spans; 0 where none has area in UV space
    overlap      share of the covered texels that lie inside two triangles, in [0, 1]; None if not measured
    fault        why it cannot, in words; empty if it can
    """

    uv_set: int
    flat_faces: int
    flat_share: float
    tiles: int
    overlap: float | None
    fault: str


@dataclass(frozen=True, eq=False)
class Atlas:
    """The UVs of a bake.

    method     keep, xatlas or uvunwrap
    uvs        (f, 3, 2) float64, v upwards; in [0, 1] unless `repeats`
    mapped     (f,) bool: faces with UVs of their own; not those without area, also in the UVs, or that share another's
    charts     number of connected UV islands; repeats: some uvs lie outside [0, 1], so that the texture repeats
    gutter     texels kept free between charts by the packer; None for UVs that were kept
    uv_set     index of the UV set that was kept; None for new UVs
    checks     of the file's UV sets, as far as they were checked
    """

    method: str
    uvs: Float64Array
    mapped: BoolArray
    charts: int
    repeats: bool = False
    gutter: int | None = None
    uv_set: int | None = None
    checks: tuple[UvCheck, ...] = ()


@dataclass(frozen=True, eq=False)
class Texels:
    """The texels that the surface covers, at least in part.

    width, height   of the texture, in texels
    index           (k,) int32, distinct, in any order: row * width + column; row 0 is at v = 1
    """

    width: int
    height: int
    index: Int32Array

    def __len__(self) -> int:
        return len(self.index)

    def select(self, chosen: slice | BoolArray) -> "Texels":
        """Return those of a slice, or of a (k,) bool mask."""
        return Texels(self.width, self.height, self.index[chosen])


@dataclass(frozen=True, eq=False)
class Texture:
    """A finished ambient-occlusion texture.

    values   (height, width) float32 in [0, 1], 1 is open; row 0 is at v = 1; 0 where not measured, padded or filled
    valid    (height, width) bool: texels that the surface covers and whose value was measured
    """

    values: Float32Array
    valid: BoolArray


@dataclass(frozen=True)
class DarkPart:
    """A part of which at least half is enclosed, or faces inwards: see DarkTexels; shares of its own texels."""

    name: str
    inside: float
    inwards: float


@dataclass(frozen=True)
class DarkTexels:
    """Texels that (nearly) no light reaches, AO below 0.01, by cause; shares of the texels that have a value, 0 to 1.

    share          all of them; samples: from how many of them rays were cast, 0 where no causes were looked for
    inside         enclosed: neither side sees out, as inside another part or where parts touch
    inwards        only the back of the face sees out
    on_ground      facing the ground and resting on it; above_ground: from above, nothing else keeps the light away
    narrow         in a gap or hollow out of which less than 1% is seen
    parts          those of which at least half is enclosed or faces inwards, those with the most such texels first
    """

    share: float
    samples: int = 0
    inside: float = 0.0
    inwards: float = 0.0
    on_ground: float = 0.0
    above_ground: float = 0.0
    narrow: float = 0.0
    parts: tuple[DarkPart, ...] = ()


@dataclass(frozen=True, eq=False)
class Baked:
    """The result of a bake.

    scene           the scene, with the roles of its parts; texture, atlas: the finished texture and its UVs
    normals         (f, 3, 3) float32: the shading normals that were used; vertex_ao: (f, 3) AO of vertices, if asked
    directions      number of light directions that were used
    sampling_error  the estimated sampling error of a texel, RMS; None where there is no estimate (up to 128 directions)
    dark            its texels that get no light, and why
    backend         gl or ray; renderer: name of the OpenGL renderer, or of the ray tracer
    shadow_size     side of the depth maps in texels, None without maps; size_estimates: empty where none was made
    options         those that define the value, as they were used: the axis that points up, the crease angle of STL
    warnings, notes   lines for the user about the result: those that may need an action, those that need none
    """

    scene: Scene
    texture: Texture
    atlas: Atlas
    normals: Float32Array
    directions: int
    sampling_error: float | None
    dark: DarkTexels
    backend: str
    renderer: str
    shadow_size: int | None
    size_estimates: SizeEstimates
    options: ValueOptions
    warnings: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    vertex_ao: Float32Array | None = None


@dataclass(frozen=True, eq=False)
class BaseColor:
    """The base colour of a part's material: `factor` times the texture and the colours of the corners, if any.

    factor    (r, g, b), linear, in [0, 1]
    texture   (height, width, 3) uint8 sRGB, row 0 at v = 1; None without one
    uvs       (faces of the part, 3, 2) float64, v upwards, the texture repeats; None without a texture
    corners   (faces of the part, 3, 3) float32, linear, in [0, 1]; None without vertex colours
    """

    factor: tuple[float, float, float] = (1.0, 1.0, 1.0)
    texture: UInt8Array | None = None
    uvs: Float64Array | None = None
    corners: Float32Array | None = None


@dataclass(frozen=True, eq=False)
class TexturedMesh:
    """A mesh with its ambient-occlusion texture, as pictures show it.

    scene         its positions, faces, parts and materials; base_colors: one for each part, or none
    normals       (f, 3, 3) float64: unit shading normals at the corners
    uvs           (f, 3, 2) float64, v upwards; None without a texture
    ao            (height, width) float32 in [0, 1], 1 is open, row 0 at v = 1; None without a texture
    textured      (f,) bool: faces that the texture covers; the others are drawn as open
    strengths     (f,) float32 in [0, 1]: 1 + strength * (AO - 1) is drawn; None: 1 everywhere
    """

    scene: Scene
    normals: Float64Array
    uvs: Float64Array | None
    ao: Float32Array | None
    textured: BoolArray
    base_colors: tuple[BaseColor, ...] = ()
    strengths: Float32Array | None = None


@dataclass(frozen=True, eq=False)
class SphereSet:
    """Spheres that approximate a mesh, and how they were fitted.

    Attributes
    ----------
    centers : ndarray, (n, 3) float64
        In the mesh's coordinates.
    radii : ndarray, (n,) float64
        In the mesh's units.
    iterations : int
        Pairings of the samples with the spheres, or steps of the optimiser.
    converged : bool
        The last iteration changed no pairing; always True for shadow and collision.
    method : {"lloyd", "algebraic", "shadow", "collision"}
    radius_rule : {"mean", "uniform", "cover", "own"}
        How the radii were chosen; own: by the method (shadow, collision).
    samples, seed : int
        Number of surface samples; seed of the samples and of every random choice.
    guarded : int
        How often a guard replaced the least-squares sphere (algebraic).
    coarser : SphereSet or None
        The next coarser level, if several were asked for.
    parents : ndarray, (n,) int32, or None
        Index of the coarser sphere to which each sphere belongs.
    """

    centers: Float64Array
    radii: Float64Array
    iterations: int
    converged: bool
    method: str
    radius_rule: str
    samples: int
    seed: int
    guarded: int = 0
    coarser: "SphereSet | None" = None
    parents: Int32Array | None = None

    def __len__(self) -> int:
        return len(self.radii)

    def _repr_html_(self) -> str:
        """Draw the spheres for a notebook."""
        line = f"{len(self)} spheres by {self.method}, radii {self.radii.min():.4g} to {self.radii.max():.4g}"
        return figure([spheres_drawing(self.centers.tolist(), self.radii.tolist(), line)], line)
