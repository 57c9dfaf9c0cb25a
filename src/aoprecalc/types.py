"""The values that travel through a job, each an immutable record over NumPy arrays.

    file -> Scene -> Atlas -> Texels -> visibility sums -> Texture -> files     (bake)
    file -> Scene -> samples -> SphereSet -> files                              (spheres)

Everything that differs along a seam (normals, UVs) is kept on the corners of faces, never on
vertices, so that no step has to split or weld anything. Sizes in the docstrings: v distinct
positions, f faces, k texels.
"""

from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

Float32Array = NDArray[np.float32]
Float64Array = NDArray[np.float64]
Int32Array = NDArray[np.int32]
Int64Array = NDArray[np.int64]
BoolArray = NDArray[np.bool_]
Wrap = Literal["repeat", "mirror", "clamp"]

REVERSED_WINDING = [0, 2, 1]  # corners of a face, where a mirrored placement would turn it inside out


@dataclass(frozen=True, eq=False)
class AlphaMask:
    """The holes of a part whose material cuts out what is too transparent.

    alpha     (h, w) float32, row 0 at v = 1
    uvs       (n, 3, 2) float64 at the corners of the part's faces, v upwards
    factors   (n, 3) float64 at the corners: by what the picture's alpha is multiplied there
    cutoff    there is a hole where the product is less
    wraps     what the picture does beyond [0, 1] along u and v: repeat, mirror or clamp
    """

    alpha: Float32Array
    uvs: Float64Array
    factors: Float64Array
    cutoff: float
    wraps: tuple[Wrap, Wrap] = ("repeat", "repeat")


@dataclass(frozen=True, eq=False)
class Material:
    """What light does at a part, as its material says.

    transparent  light passes through
    unlit    ambient light has no part in its colour
    foliage  a thin sheet that is seen from both sides, such as a leaf
    cutout   None where it has no holes
    """

    transparent: bool = False
    unlit: bool = False
    foliage: bool = False
    alpha_mask: AlphaMask | None = None


@dataclass(frozen=True, eq=False)
class Part:
    """A run of faces of a Scene that were one piece in the file (a group, a glTF primitive).

    name          as in the file, or made up
    start, stop   the faces scene.faces[start:stop]
    vertices      (stop - start, 3) int32: which of the piece's own vertices in the file stands at each corner
    source        what the reader of that kind of file needs to find the piece again; opaque to others
    names         what else a user may call it by: its groups, the nodes above it, its mesh, its material
    material      what its material says
    instance_of   the number of the first part that shows the same piece of the file elsewhere; None for that itself
    duplicate_of  the same for parts that the file cannot tell apart; None for the first of them and where it can
    receives      it gets ambient occlusion
    occludes      it is in the light's way
    two_sided     its texels have the larger of the two sides' values
    uv_owner      the number of the part whose place in the texture it has; None where that is its own
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

    @property
    def faces(self) -> slice:
        """The run as a slice."""
        return slice(self.start, self.stop)


@dataclass(frozen=True, eq=False)
class Scene:
    """All triangles of one file, in world placement and in the file's units.

    path       where it was read
    format     lower-case extension without the dot: obj, ply, stl, off, gltf, glb
    positions  (v, 3) float64: no two are equal, every one is used by a face, all finite
    faces      (f, 3) int32 into positions, f >= 1, counter-clockwise seen from the front
    normals    (f, 3, 3) float32, unit length: the shading normal at each corner; None where the file has none
    uv_sets    each (f, 3, 2) float64, v upwards (v = 1 is the first row of the picture), (0, 0) where a face has none
    parts      consecutive runs of faces that cover them all
    document   the original file as its reader keeps it, for writing it back; opaque to others
    warnings   lines that the user should see about the input
    floor      the unit vector away from the endless floor that the scene stands on; None where there is none
    """

    path: Path
    format: str
    positions: Float64Array
    faces: Int32Array
    normals: Float32Array | None
    uv_sets: tuple[Float64Array, ...]
    parts: tuple[Part, ...]
    document: object = None
    warnings: tuple[str, ...] = ()
    ground_normal: tuple[float, float, float] | None = None

    @property
    def corners(self) -> Float64Array:
        """(f, 3, 3) float64: the positions of each face's corners."""
        return self.positions[self.faces]

    @property
    def uvs(self) -> Float64Array | None:
        """The first set of UVs; None where the file has none."""
        return self.uv_sets[0] if self.uv_sets else None

    def per_face(self, values: Iterable[bool]) -> BoolArray:
        """Give each face what its part has, (f,) bool."""
        sizes = [part.stop - part.start for part in self.parts]
        return np.repeat(np.fromiter(values, bool), sizes)

    @property
    def receives(self) -> BoolArray:
        """(f,) bool: the faces that get ambient occlusion."""
        return self.per_face(part.receives for part in self.parts)

    @property
    def occludes(self) -> BoolArray:
        """(f,) bool: the faces that are in the light's way, but for the holes of cut-outs."""
        return self.per_face(part.occludes for part in self.parts)

    @property
    def two_sided(self) -> BoolArray:
        """(f,) bool: the faces whose texels have the larger of the two sides' values."""
        return self.per_face(part.two_sided for part in self.parts)


@dataclass(frozen=True)
class UvCheck:
    """Whether a set of UVs can hold a bake.

    uv_set       its number
    flat_faces   how many faces with area have none in UV space
    tiles        on how many repeats of the texture, along an axis, a face lies at most
    overlap      share of the covered texels that lie inside two triangles; None where something else ruled it out
    fault        why it cannot, in words; empty where it can
    """

    uv_set: int
    flat_faces: int
    tiles: int
    overlap: float | None
    fault: str


@dataclass(frozen=True, eq=False)
class Atlas:
    """Where each face lies in the texture.

    method     keep, xatlas or uvunwrap
    uvs        (f, 3, 2) float64, v upwards; in [0, 1] unless `wraps`
    mapped     (f,) bool: faces that have a place of their own in the texture; those without area have none
    charts     how many connected islands there are
    wraps      some uvs lie outside [0, 1]: the texture repeats
    gutter     texels kept free between charts when they were packed; None for UVs that were kept
    uv_set     the number of the set that was kept; None for new UVs
    checks     what was found about the file's own sets, as far as they were checked
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
    """The texels that some part of the surface covers.

    width, height   of the texture, in texels
    index           (k,) int32, each once, in any order: row * width + column; row 0 is the picture's first (v = 1)
    """

    width: int
    height: int
    index: Int32Array

    def __len__(self) -> int:
        return len(self.index)

    def select(self, chosen: slice | BoolArray) -> "Texels":
        """Return those of a run, or of a (k,) mask."""
        return Texels(self.width, self.height, self.index[chosen])


@dataclass(frozen=True, eq=False)
class Texture:
    """A finished picture of ambient occlusion.

    values   (height, width) float32 in [0, 1], 1 = open; 0 where nothing was measured, padded or filled
    valid    (height, width) bool: texels that the surface covers and whose value was measured
    """

    values: Float32Array
    valid: BoolArray


@dataclass(frozen=True, eq=False)
class Baked:
    """What a bake makes of a scene.

    scene         that was baked, with the roles that its parts had
    texture       the finished picture
    atlas         the UVs that it belongs to
    normals       (f, 3, 3) float32: the shading normals that were used
    directions    light directions that were used
    error         the estimated sampling error of a texel, RMS; None where it cannot be told (up to 128 directions)
    unseen        the share of the measured texels that see next to no direction (below 0.01)
    backend       gl or ray
    renderer      what the OpenGL implementation, or the ray tracer, calls itself
    shadow_size   side of the near/far maps in texels; None without maps
    warnings      what the user should know about the result
    """

    scene: Scene
    texture: Texture
    atlas: Atlas
    normals: Float32Array
    directions: int
    sampling_error: float | None
    occluded_share: float
    backend: str
    renderer: str
    shadow_size: int | None
    warnings: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class SphereSet:
    """Spheres that stand in for a mesh.

    centers      (n, 3) float64, in the mesh's coordinates
    radii        (n,) float64, in the mesh's units
    iterations   how many times every sample was given to its best sphere
    converged    the last iteration changed no sample's sphere; true of shadow and collision, which take a fixed way
    method       how the spheres were fitted: lloyd, algebraic, shadow or collision
    radius_rule  how the radii were chosen: mean, uniform or cover; own for the methods that have their own
    samples      how many surface samples were used
    seed         of the samples and of every random choice
    guarded      how often a guard decided instead of the least squares (algebraic)
    coarser      the next coarser level, where there are several
    parents      (n,) int32: the number of the coarser sphere to which each sphere belongs; None without a coarser level
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
