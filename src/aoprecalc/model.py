"""The values that travel through a job, each an immutable record over NumPy arrays.

    file -> Scene -> Atlas -> Texels -> visibility sums -> Texture -> files     (bake)
    file -> Scene -> samples -> SphereSet -> files                              (spheres)

Everything that differs along a seam (normals, UVs) is kept on the corners of faces, never on
vertices, so that no step has to split or weld anything. Sizes in the docstrings: v distinct
positions, f faces, k texels.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float32]
Doubles = NDArray[np.float64]
Ints = NDArray[np.int32]
Mask = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Part:
    """A run of faces of a Scene that were one piece in the file (a group, a glTF primitive).

    name      as in the file, or made up
    start, stop   the faces scene.faces[start:stop]
    vertices  (stop - start, 3) int32: which of the piece's own vertices in the file stands at each corner
    source    what the reader of that kind of file needs to find the piece again; opaque to others
    """

    name: str
    start: int
    stop: int
    vertices: Ints
    source: object = None


@dataclass(frozen=True, eq=False)
class Scene:
    """All triangles of one file, in world placement and in the file's units.

    path       where it was read
    kind       lower-case extension without the dot: obj, ply, stl, off, gltf, glb
    positions  (v, 3) float64: no two are equal, every one is used by a face, all finite
    faces      (f, 3) int32 into positions, f >= 1, counter-clockwise seen from the front
    normals    (f, 3, 3) float32, unit length: the shading normal at each corner; None where the file has none
    uvs        (f, 3, 2) float64, v upwards (v = 1 is the first row of the picture); None where the file has none
    parts      consecutive runs of faces that cover them all
    document   the original file as its reader keeps it, for writing it back; opaque to others
    warnings   lines that the user should see about the input
    """

    path: Path
    kind: str
    positions: Doubles
    faces: Ints
    normals: Floats | None
    uvs: Doubles | None
    parts: tuple[Part, ...]
    document: object = None
    warnings: tuple[str, ...] = ()

    @property
    def corners(self) -> Doubles:
        """(f, 3, 3) float64: the positions of each face's corners."""
        return self.positions[self.faces]


@dataclass(frozen=True, eq=False)
class Atlas:
    """Where each face lies in the texture.

    method     keep, xatlas or uvunwrap
    uvs        (f, 3, 2) float64, v upwards; in [0, 1] unless `wraps`
    covers     (f,) bool: faces that have a place in the texture; those without area have none
    charts     how many connected islands there are
    wraps      some uvs lie outside [0, 1]: the texture repeats
    gutter     texels kept free between charts when they were packed; None for UVs that were kept
    """

    method: str
    uvs: Doubles
    covers: Mask
    charts: int
    wraps: bool = False
    gutter: int | None = None


@dataclass(frozen=True, eq=False)
class Texels:
    """The texels that some part of the surface covers.

    width, height   of the texture, in texels
    index           (k,) int32, each once, in any order: row * width + column; row 0 is the picture's first (v = 1)
    """

    width: int
    height: int
    index: Ints

    def __len__(self) -> int:
        return len(self.index)


@dataclass(frozen=True, eq=False)
class Texture:
    """A finished picture of ambient occlusion.

    values   (height, width) float32 in [0, 1], 1 = open; 0 where nothing was measured, padded or filled
    valid    (height, width) bool: texels that the surface covers and whose value was measured
    """

    values: Floats
    valid: Mask


@dataclass(frozen=True, eq=False)
class Baked:
    """What a bake makes of a scene.

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

    texture: Texture
    atlas: Atlas
    normals: Floats
    directions: int
    error: float | None
    unseen: float
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

    centers: Doubles
    radii: Doubles
    iterations: int
    converged: bool
    method: str
    radius_rule: str
    samples: int
    seed: int
    guarded: int = 0
    coarser: "SphereSet | None" = None
    parents: Ints | None = None

    def __len__(self) -> int:
        return len(self.radii)
