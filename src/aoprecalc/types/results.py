"""What is made of a scene: an atlas of UVs, the texture, pictures of both, and spheres."""

from dataclasses import dataclass

from aoprecalc.notebook import figure, spheres_drawing
from aoprecalc.options import ValueOptions
from aoprecalc.types.scene import BoolArray, Float32Array, Float64Array, Int32Array, Scene, UInt8Array

SizeEstimates = tuple[tuple[int, float], ...]  # sizes of a texture, and the error that the resolution of each adds


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

    def select(self, chosen: slice | BoolArray | Int32Array) -> "Texels":
        """Return those of a slice, of a (k,) bool mask, or of rows in 0 .. k - 1."""
        return Texels(self.width, self.height, self.index[chosen])


@dataclass(frozen=True, eq=False)
class Padding:
    """The texels around the charts of a texture that have the value of another one, the nearest in a chart.

    texels, sources   (p,) int32: they and the others, row * width + column
    """

    texels: Int32Array
    sources: Int32Array


@dataclass(frozen=True, eq=False)
class Texture:
    """A finished ambient-occlusion texture.

    values   (height, width) float32 in [0, 1], 1 is open; row 0 is at v = 1; 0 where not measured, padded or filled
    valid    (height, width) bool: texels that the surface covers and whose value was measured
    known    (height, width) bool: texels that have a value before padding: those, and what else a look-up there reads
    vectors  (height, width, 3) float32: the visibility vectors, see `Integrand`, 0 where not known; None unless wanted
    padding  how the values were padded; None for several textures as one
    """

    values: Float32Array
    valid: BoolArray
    known: BoolArray
    vectors: Float32Array | None = None
    padding: Padding | None = None


CONFIDENCE = 0.95  # of certificates


@dataclass(frozen=True)
class Certificate:
    """How sure it is that the error of a texture, as rendered, is at most a bound.

    Attributes
    ----------
    max_error : float
        The greatest RMS error that was asked for, in units of ambient occlusion.
    error : float
        The RMS error over the surface at full resolution, as measured, without the noise of the rays.
    bound : float
        The RMS error is at most this, with the confidence.
    confidence : float
        Least probability, in [0, 1], that the bound is right, whatever the texture and the surface.
    points, rays : int
        Points on the surface, none of which the texture was fitted to, and rays from each.
    seed : int
        Seed of both.
    """

    max_error: float
    error: float
    bound: float
    confidence: float
    points: int
    rays: int
    seed: int

    @property
    def holds(self) -> bool:
        """Whether the error is at most `max_error`, with the confidence."""
        return self.bound <= self.max_error

    def __str__(self) -> str:
        return (
            f"RMS error at most {self.bound:.4g} with {self.confidence:.0%} confidence "
            f"({self.error:.4f} measured at {self.points} points)"
        )


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
    below_ground   below the ground, whose height is given
    on_ground      facing the ground and resting on it; above_ground: from above, nothing else keeps the light away
    narrow         in a gap or hollow out of which less than 1% is seen
    parts          those of which at least half is enclosed or faces inwards, those with the most such texels first
    """

    share: float
    samples: int = 0
    inside: float = 0.0
    inwards: float = 0.0
    below_ground: float = 0.0
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
    directions_per_texel   how many of them a texel took itself, in the mean: fewer where neighbours share what they see
    missed          texels without a value as their points are not on the detailed surface
    certificate     of its error, if one was asked for; of several textures that of the greatest bound
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
    directions_per_texel: float
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
    missed: int = 0
    certificate: Certificate | None = None


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
