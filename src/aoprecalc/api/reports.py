"""The report of a bake, as frozen dataclasses: each has its JSON document's keys, in their order, as fields.

Numbers are rounded as the documents show them.
"""

from dataclasses import dataclass, field

from aoprecalc.api.documents import OMIT_NONE, Document, ErrorCertificate, RayTracedErrors, Report
from aoprecalc.api.high_to_low import HighToLow
from aoprecalc.errors import counted
from aoprecalc.io.outputs import SCHEMAS
from aoprecalc.options import ValueOptions


@dataclass(frozen=True)
class InputMesh(Report):
    """The mesh that was baked; vertices are distinct positions, to which corners of an STL may be moved."""

    path: str
    triangles: int
    vertices: int
    components: int
    watertight: bool
    welded_corners: int | None = field(default=None, metadata=OMIT_NONE)
    weld_tolerance: float | None = field(default=None, metadata=OMIT_NONE)


@dataclass(frozen=True)
class PartRoles(Report):
    """A part of the mesh and its roles.

    shares   index of the part whose UVs it uses
    level    its level of detail, 0 the finest; None for a part that all levels show
    hull     a collision hull
    """

    name: str
    triangles: int
    receives: bool
    occludes: bool
    shares: int | None
    glass: bool
    unlit: bool
    cut_out: bool
    level: int | None = None
    hull: bool = False


@dataclass(frozen=True)
class AoReference(Report):
    """Where the mesh file refers to the texture.

    slot        as the format calls it: occlusionTexture, baseColorTexture, map_Kd, map_Ka, TextureFile; also
                extras.aoprecalc.bentNormalTexture and sphericalHarmonicsTexture, for the pictures beside it
    materials   how many refer to it so; None for PLY, which has no materials
    uvs         as the format calls them: TEXCOORD_1, vt, s and t
    packed      the texture also holds their roughness and metalness
    strength    of the occlusion, 0 to 1; None where the slot has none
    """

    slot: str
    materials: int | None
    uvs: str
    packed: bool
    strength: float | None = None


@dataclass(frozen=True)
class BakeOutputs(Report):
    """Paths of the files, None before they are saved, and where the mesh refers to the texture.

    texture      None also where the texture is inside the mesh, a GLB; of several the first
    textures     all of them, in the order of `BakeReport.textures`
    bent_normals, sh   pictures of the bent normals and of spherical harmonics, one for each texture, if asked for
    inverted     the texture holds the occlusion 1 - AO; the mesh refers to another picture, of the AO
    others       files that go with the mesh: .mtl, .bin, images
    figures      pictures of `--figures`, their sheet last
    references   empty before the files are saved
    """

    texture: str | None = None
    inverted: bool = False
    mesh: str | None = None
    others: tuple[str, ...] = ()
    figures: tuple[str, ...] = ()
    references: tuple[AoReference, ...] = ()
    textures: tuple[str, ...] = ()
    bent_normals: tuple[str, ...] = ()
    sh: tuple[str, ...] = ()


@dataclass(frozen=True)
class UvSetCheck(Report):
    """Whether a UV set of the file can hold a bake (`fault` is empty), or why not; see `types.UvCheck`."""

    uv_set: int
    flat_faces: int
    flat_share: float
    tiles: int
    overlap: float | None
    fault: str


@dataclass(frozen=True)
class Unwrapping(Report):
    """The texture's UVs.

    method             keep, xatlas or uvunwrap
    uv_set             index of the set that was kept; None for new UVs
    lost_faces         faces with area that have no texels; lost_share: their share of the surface, 0 to 1
    used_share         share of the texture's texels that have a value, 0 to 1
    gutter             texels between charts; None for UVs that were kept
    first_unsafe_mip   first mip level at which charts may mix; None for UVs that were kept
    texel_density      texels per unit of length: the root of the covered area in texels over the surface's
    least_density      that of the chart that has the fewest
    """

    method: str
    uv_set: int | None
    checks: tuple[UvSetCheck, ...]
    charts: int
    lost_faces: int
    lost_share: float
    used_share: float
    gutter: int | None
    first_unsafe_mip: int | None
    texel_density: float
    least_density: float


@dataclass(frozen=True)
class TexelCounts(Report):
    """Size of the texture in texels, and how many have a value."""

    width: int
    height: int
    valid: int


@dataclass(frozen=True)
class SizeError(Report):
    """A size in texels, and the RMS error, as rendered, that its resolution adds, as estimated."""

    size: int
    error: float


@dataclass(frozen=True)
class SizeChoice(Report):
    """How the size was chosen: the smallest power of two whose error is at most the target.

    error    that the resolution adds, RMS as rendered: texels baked by few rays were compared with ray tracing at
             `points` points of the surface, twice, to take out the noise
    target   greatest error that was wanted
    tried    all sizes that were tried, ascending
    """

    error: float
    target: float
    points: int
    tried: tuple[SizeError, ...]


@dataclass(frozen=True)
class OcclusionStatistics(Report):
    """Over the texels that have a value, not over the surface, of which some parts get more texels: 1 is open.

    unseen_share   share of them that are dark: below 0.01
    ground_alone   mean if nothing but the ground took light; None without a ground
    """

    mean: float
    min: float
    max: float
    unseen_share: float
    ground_alone: float | None


@dataclass(frozen=True)
class VertexFit(Report):
    """Ambient occlusion at the vertices, interpolated over the faces.

    vertices            positions with one shading normal: each has a value
    rmse, traced_rmse   root mean square of the difference from the texture, and from rays (None without any)
    """

    vertices: int
    rmse: float
    traced_rmse: float | None


@dataclass(frozen=True)
class DarkPartShares(Report):
    """A part of which at least half is enclosed, or faces inwards: shares of its own texels, 0 to 1."""

    name: str
    inside: float
    inwards: float


@dataclass(frozen=True)
class DarkTexelShares(Report):
    """What keeps the light from the dark texels, AO below 0.01: shares of the texels that have a value, 0 to 1.

    inside         enclosed: neither side sees out, as inside another part or where parts touch
    inwards        only the back of the face sees out: flip these faces, or bake two-sided
    below_ground   below the ground, whose height is given
    on_ground      facing the ground and resting on it
    above_ground   facing the ground, from above it
    narrow         in a gap or hollow out of which less than 1% is seen
    parts          those of which at least half is enclosed or faces inwards
    samples        how many dark texels were looked at, by rays; the shares are estimated from them
    """

    inside: float
    inwards: float
    below_ground: float
    on_ground: float
    above_ground: float
    narrow: float
    parts: tuple[DarkPartShares, ...]
    samples: int


@dataclass(frozen=True)
class TextureReport(Report):
    """One texture of a bake; its members are as in the report.

    name        of its material, mesh or UDIM tile; empty for the only one
    triangles   whose occlusion it holds
    """

    name: str
    triangles: int
    unwrap: Unwrapping
    texels: TexelCounts
    size_choice: SizeChoice | None
    ao: OcclusionStatistics
    dark: DarkTexelShares | None


@dataclass(frozen=True)
class BakeReport(Document):
    """What a bake read, chose and measured.

    Attributes
    ----------
    input : InputMesh
        Path (or name), counts, and whether the mesh is watertight.
    parts : tuple of PartRoles
    outputs : BakeOutputs
    renderer, backend : str
        Name of the OpenGL implementation or ray tracer; ``"gl"`` or ``"ray"``.
    directions : int
        Light directions used.
    directions_per_texel : int
        How many of them a texel took itself, in the mean: fewer where neighbouring texels share what they see.
    estimated_error : float or None
        Estimated RMS sampling error of a texel, in units of ambient occlusion, from the difference of two halves of
        the directions; None up to 128 of them. What the texture's resolution adds at chart borders is not in it.
    certificate : ErrorCertificate or None
        Of the error as rendered, if `max_error` asked for one; of several textures that of the greatest bound.
    sampling : {"fibonacci", "random"}
    options : ValueOptions
        The options that define the value.
    floor : tuple of float or None
        Unit vector away from the ground plane.
    shadow_size : int or None
        Side of the depth maps, in texels; None for rays.
    unwrap : Unwrapping
        Of several textures all charts, the narrowest gutter, and every method.
    texels : TexelCounts
        Of several textures the largest size, and how many texels of all have a value.
    size_choice : SizeChoice or None
        None where the size was given, or chosen by the density of texels, and for several textures.
    ao : OcclusionStatistics
        Over the texels of all textures.
    dark : DarkTexelShares or None
        What keeps the light from the dark texels; None where less than 1% is dark.
    textures : tuple of TextureReport
        Each texture by itself.
    verify : RayTracedErrors or None
    vertex_ao : VertexFit or None
    high_to_low : HighToLow or None
        The detailed surface that was measured in place of the mesh's own, if any.
    seconds : dict of str to float
        Per stage (load, unwrap, visibility, finish, vertices, write, verify), and ``"total"``.
    warnings : tuple of str
        What may need an action.
    notes : tuple of str
        Other lines about the result.
    """

    schema: int = field(default=SCHEMAS["bake"], kw_only=True)
    input: InputMesh
    parts: tuple[PartRoles, ...]
    outputs: BakeOutputs
    renderer: str
    backend: str
    directions: int
    directions_per_texel: int
    estimated_error: float | None
    certificate: ErrorCertificate | None
    sampling: str
    options: ValueOptions
    floor: tuple[float, float, float] | None
    shadow_size: int | None
    unwrap: Unwrapping
    texels: TexelCounts
    size_choice: SizeChoice | None
    ao: OcclusionStatistics
    dark: DarkTexelShares | None
    textures: tuple[TextureReport, ...]
    verify: RayTracedErrors | None
    vertex_ao: VertexFit | None
    high_to_low: HighToLow | None
    seconds: dict[str, float]
    warnings: tuple[str, ...]
    notes: tuple[str, ...]

    @property
    def sampled(self) -> str:
        """The directions in words, such as ``"1152 directions, 437 a texel"``."""
        taken = "" if self.directions_per_texel == self.directions else f", {self.directions_per_texel} a texel"
        return counted(self.directions, "direction") + taken

    @property
    def error(self) -> float | None:
        """Estimated RMS sampling error of a texel; None where too few directions tell it (up to 128)."""
        return self.estimated_error
