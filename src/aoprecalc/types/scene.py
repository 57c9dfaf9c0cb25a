"""What is baked: a scene of parts with their materials; and the types of arrays."""

from collections.abc import Iterable, Mapping
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
UInt8Array = NDArray[np.uint8]
Picture = UInt8Array  # (height, width, 3) sRGB, row 0 on top
Wrap = Literal["repeat", "mirror", "clamp"]

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
    double_sided  its faces are visible from behind, too
    alpha_mask    None where it has no holes
    """

    transparent: bool = False
    unlit: bool = False
    foliage: bool = False
    double_sided: bool = False
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
    file_object   the number of its object in the file, file_material: of its material; None where none is known
    self_occluded   parts with this number, and those without any, are all that occludes it; None: every part does
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
    file_object: int | None = None
    file_material: int | None = None
    self_occluded: int | None = None
    lod: tuple[int, int] | None = None
    levels: range | None = None
    hull: bool = False

    @property
    def faces(self) -> slice:
        """The run as a slice."""
        return slice(self.start, self.stop)


@dataclass(frozen=True)
class Ground:
    """An infinite plane, from below which no light comes.

    normal   the unit vector away from it
    height   along the normal; None: that of the lowest point of all that receives or occludes
    """

    normal: tuple[float, float, float]
    height: float | None = None


@dataclass(frozen=True, eq=False)
class Surroundings:
    """What surrounds a scene; nothing unless it is stated, and light comes from everywhere alike.

    occluders   (o, 3, 3) float64: triangles of other files that occlude, too
    ground      None where there is none
    sky         (h, w) float32 > 0: an image of the light from all around, see `ImageSky`; None without one
    """

    occluders: Float64Array = field(default_factory=lambda: np.zeros((0, 3, 3)))
    ground: Ground | None = None
    sky: Float32Array | None = None


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
    detail         the surface whose light is measured in the place of its own, see `mesh/detail.py`; None as a rule
    around         what surrounds it where it will stand
    backs_occlude  faces occlude what is behind them, too; else only those of double-sided materials do
    baked_only     (f,) bool: the only faces that receive, those of one of several textures; None for all
    poses          by name the same faces elsewhere, with their shading normals: light is measured in these, if any
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
    detail: object = None
    around: Surroundings = field(default_factory=Surroundings)
    backs_occlude: bool = True
    baked_only: BoolArray | None = None
    poses: Mapping[str, "Scene"] = field(default_factory=dict)

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
        received = self.per_face(part.receives for part in self.parts)
        return received if self.baked_only is None else received & self.baked_only

    @property
    def occludes(self) -> BoolArray:
        """(f,) bool: the faces that occlude, except in the holes of alpha masks."""
        return self.per_face(part.occludes for part in self.parts)

    @property
    def two_sided(self) -> BoolArray:
        """(f,) bool: the faces whose texels have the greater of both sides' values."""
        return self.per_face(part.two_sided for part in self.parts)
