"""Options of `bake`: what the value is, and the texture that holds it."""

import re
from dataclasses import InitVar, dataclass
from functools import partial
from typing import Annotated, Literal

from aoprecalc.errors import ArgumentError
from aoprecalc.options.fields import Option, Validated, documented, option_field
from aoprecalc.options.quantities import AUTO, BYTES, DIRECTIONS, LIMIT, NONE, SHADOW_SIZE, TEXTURE_SIZE

Sampling = Literal["fibonacci", "random"]
Estimator = Literal["ratio", "mean"]
Backend = Literal["auto", "gl", "ray"]
Unwrap = Literal["auto", "keep", "xatlas", "uvunwrap"]
Fill = Literal["mean", "pushpull", "none"]
Normals = Literal["auto", "file", "smooth", "flat"]
BitDepth = Literal["auto", "8", "16", "half", "float"]
Instances = Literal["bake", "share"]
Pack = Literal["none", "orm"]
BentSpace = Literal["tangent", "object", "world"]
Green = Literal["up", "down"]
VertexAo = Literal["none", "attribute", "color"]
Textures = Literal["one", "material", "mesh"]
SelfOcclusion = Literal["all", "part", "material"]
Backfaces = Literal["occlude", "ignore"]
Up = Literal["auto", "x", "y", "z"]
Falloff = Literal["none", "linear", "smooth"]
Weight = Literal["cosine", "uniform"]
Match = Literal["name", "nothing"]
Distance = float | str  # in the units of the mesh, or such as "10%"

# Above this many triangles `unwrap="auto"` prefers uvunwrap, 10 to 40 times faster than xatlas on large surfaces.
LARGE_MESH = 30_000

AUTO_DIRECTIONS = 1152  # nine groups of 64 pairs

_MAX_SIZE = 32768
_NAMES = "A name may contain `*` and `?`."

_visibility = partial(Option, group="Visibility")
_mesh = partial(Option, group="Mesh")
_run = partial(Option, group="Run")
_scene = partial(Option, group="Scene")
_texture = partial(Option, group="Texture")
_detail = partial(Option, group="High to low")
_output = partial(Option, group="Output")

# fmt: off
# One paragraph an option: its type, help, range, what the documentation adds, and its default.
EstimatorField = Annotated[Estimator, _visibility(
    "ratio: the visible share of the cosine-weighted directions; mean: the plain Monte Carlo sum.",
    more="The ratio is exactly 1 on an open point; the sum is clamped to 1.")]
MaxDistanceField = Annotated[Distance | None, _visibility(
    "Farther occluders do not count: a length in the units of the mesh, or a share of its diagonal such as 10%.",
    common=True, default_text="no limit", quantity=LIMIT, none=NONE,
    more="none: they count at any distance. The diagonal is that of the bounding box of what is baked. Rays are "
    "traced: depth maps do not tell how far away an occluder is.")]
FalloffField = Annotated[Falloff, _visibility(
    "How the effect of an occluder falls up to `max_distance`: not (none), linearly or smoothly.",
    more="At the share x of the maximum distance an occluder takes 1, 1 - x or 1 - 3x^2 + 2x^3 of the light.")]
ConeField = Annotated[float, _visibility(
    "Opening angle of the cone of directions about the normal; 180 is the hemisphere.", range=(1, 180),
    unit="degrees", metavar="DEG")]
WeightField = Annotated[Weight, _visibility(
    "Weight of a direction: its cosine with the normal, or the same for all.")]
NormalsField = Annotated[Normals, _mesh(
    "Shading normals. auto: the file's, else smooth ones.", common=True,
    more="A glTF file without normals gets flat ones.")]
CreaseAngleField = Annotated[float | None, _mesh(
    "Edges that bend more than this are hard where smooth normals are computed.", range=(0, 180), unit="degrees",
    metavar="DEG", default_text="180, for STL 40")]
OnlyField = Annotated[tuple[str, ...], _scene("Parts that are baked; the others still occlude.", more=_NAMES)]
ExcludeField = Annotated[tuple[str, ...], _scene(
    "Parts to leave out: they neither receive nor occlude.", common=True, more=_NAMES)]
OccluderField = Annotated[tuple[str, ...], _scene(
    "A mesh file that occludes and is not baked: the surroundings, where the mesh will stand.", path=True,
    more="It is placed as its own file says, in the units and axes of the mesh.")]
OccludersOnlyField = Annotated[tuple[str, ...], _scene("Parts that occlude but are not baked.", more=_NAMES)]
HighField = Annotated[tuple[str, ...], _detail(
    "A mesh file with the details: its ambient occlusion goes into the texture of the mesh, which is simpler.",
    common=True, path=True,
    more="Rays from the cage find the points of it that belong to the texels. It alone occludes.")]
CageField = Annotated[Distance, _detail(
    "Where these rays begin: at a length, or a share of the diagonal such as 2%, from the mesh; a file; or auto.",
    path=True, metavar="auto|X|FILE", keywords=("auto",),
    more="They end as far behind the mesh. A file has the faces of the mesh, around it. auto finds for each vertex a "
    "distance that reaches what belongs there, and nothing else.")]
MatchField = Annotated[Match, _detail(
    "Parts get the details of parts of the same name (wheel_low, wheel_high), or of all (nothing).",
    more="A name ends in, or begins with, low, lo or lp, and high, hi or hp, in any case; or has none of them. Where "
    "no names match, every part gets the details of all.")]
GlassOccludesField = Annotated[bool, _scene(
    "Transparent materials occlude too.",
    more="Without it they are baked, but light passes through them (glTF: BLEND, transmission).")]
TwoSidedField = Annotated[bool, _scene(
    "Take the lighter value of the two sides of every face.",
    more="Without it only double-sided glTF materials with an alpha mask, such as leaves, do so.")]
SkyField = Annotated[str, _scene(
    "Where light comes from: the same from everywhere, an overcast sky, or an equirectangular image (.hdr, .exr).",
    metavar="uniform|overcast|FILE", path=True, keywords=("uniform", "overcast"),
    more="Directions count by their light; open is 1. Overcast is the CIE's sky, three times as bright at the "
    "zenith as at the horizon. Images have the zenith in the top row, and +X in the middle.")]
SelfOcclusionField = Annotated[SelfOcclusion, _scene(
    "What occludes a part: all parts, that part alone, or the faces of its material alone.",
    more="A part is a whole object of the file. The ground, `occluder` and `occluders_only` always occlude.")]
GroundField = Annotated[bool, _scene("Put the scene on an endless ground plane: no light from below.", common=True)]
BackfacesField = Annotated[Backfaces, _scene(
    "Whether faces occlude from behind, too, or only what is in front of them.",
    more="Faces of double-sided materials always occlude from both sides.")]
GroundHeightField = Annotated[float | None, _scene(
    "Height of the ground of `ground` along the axis that points up.", range=(-1_000_000_000, 1_000_000_000),
    unit="units of the mesh", metavar="X", default_text="the lowest point", more="What lies below the ground is dark.")]
UpField = Annotated[Up, _scene("Axis that points up, for `ground` and `sky`. auto: y; z for STL, or as USD says.")]
AllPartsField = Annotated[bool, _scene(
    "Treat levels of detail and collision hulls as ordinary parts.",
    more="Without it each level of detail is baked as if the others were not there (MSFT_lod, names like tree_LOD1), "
    "and collision hulls (names like UCX_tree, COL_tree, tree-colonly) neither receive nor occlude.")]
PoseField = Annotated[tuple[str, ...], _mesh(
    "Pose in which light is measured: an animation of a glTF at a time, such as walk@0.5.", metavar="NAME@SECONDS",
    more="A number stands for an animation without a name. In several poses visibility is summed over all of them. UVs "
    "and the mesh that is written are those of the rest pose.")]
ThreadsField = Annotated[int, _run(
    "Threads for software rendering and rays; 0: all cores.", range=(0, 1024),
    more="A process keeps the number that its first bake asked for.")]


def plain_pose(pose: str) -> str:
    """Return an animation and a time in one spelling, walk@1 for walk@1.0; raises ArgumentError for other texts."""
    name, at, seconds = pose.rpartition("@")
    if not (name and at and re.fullmatch(r"\d+(\.\d*)?|\.\d+", seconds)):
        expected = "an animation and seconds such as 'walk@0.5' were expected"
        raise ArgumentError("pose", f"has {pose!r}; {expected}")
    return f"{name}@{repr(float(seconds)).removesuffix('.0')}"


@documented
@dataclass(frozen=True, kw_only=True)
class LightOptions(Validated):
    """Where light comes from, which parts of a scene receive it, and what occludes it."""

    only: OnlyField = ()
    exclude: ExcludeField = ()
    occluders_only: OccludersOnlyField = ()
    occluder: OccluderField = ()
    glass_occludes: GlassOccludesField = False
    all_parts: AllPartsField = False
    two_sided: TwoSidedField = False
    sky: SkyField = "uniform"
    self_occlusion: SelfOcclusionField = "all"
    backfaces: BackfacesField = "occlude"
    ground: GroundField = False
    ground_height: GroundHeightField = None
    up: UpField = "auto"

    def __post_init__(self) -> None:
        """Check every value; raise ArgumentError where one is wrong."""
        super().__post_init__()
        if self.up != "auto" and not self.has_up:
            raise ArgumentError(
                "up",
                f"is {self.up!r}, but there is no ground and no sky; add {{ground}} or {{sky}}, or omit {{up}}",
                "ground",
                "sky",
                "up",
            )
        if self.ground_height is not None and not self.ground:
            found = f"is {self.ground_height:g}, but there is no ground; add {{ground}}"
            raise ArgumentError("ground_height", found, "ground")

    @property
    def has_up(self) -> bool:
        """Whether it matters which axis points up."""
        return self.ground or self.sky != "uniform"


@documented
@dataclass(frozen=True, kw_only=True)
class ValueOptions(LightOptions):
    """What the value of a surface point is, whatever the texture: these options travel with a result.

    Two bakes with the same ones differ by sampling and resolution alone.
    """

    estimator: EstimatorField = "ratio"
    max_distance: MaxDistanceField = None
    falloff: FalloffField = "none"
    cone: ConeField = 180
    weight: WeightField = "cosine"
    normals: NormalsField = "auto"
    crease_angle: CreaseAngleField = None
    instances: Annotated[Instances, _mesh(
        "Bake each instance of a mesh into texels of its own, or let them share texels.",
        more="Shared texels hold the mean of the instances' values.")] = "bake"
    pose: PoseField = ()
    high: HighField = ()
    cage: CageField = "auto"
    match: MatchField = "name"

    def __post_init__(self) -> None:
        """Check every value; raise ArgumentError where one is wrong."""
        super().__post_init__()
        if self.falloff != "none" and self.max_distance is None:
            raise ArgumentError(
                "falloff",
                f"is {self.falloff!r}, but occluders count at any distance; add {{max_distance}}",
                "max_distance",
            )
        if self.sky != "uniform" and self.estimator == "mean":
            raise ArgumentError(
                "estimator", "is 'mean', whose divisor is that of a uniform sky; omit it, or {sky}", "sky"
            )
        object.__setattr__(self, "pose", tuple(dict.fromkeys(map(plain_pose, self.pose))))
        if self.pose and self.high:
            raise ArgumentError("pose", "is of the mesh, but light is measured on the one of {high}; omit one", "high")


class _TextureSize:
    """Gives the size of a texture as one value."""

    @property
    def size(self) -> tuple[int, int] | Literal["auto"]:
        """Width and height in texels; auto where the bake chooses them."""
        width, height = self.__dict__["width"], self.__dict__["height"]
        return (width, height) if width else "auto"


@documented
@dataclass(frozen=True, kw_only=True)
class BakeOptions(_TextureSize, ValueOptions):
    """How to bake an ambient-occlusion texture.

    `size` sets `width` and `height`, and takes precedence over them.
    """

    width: Annotated[int, Option(
        "Width of the texture; 0 where `size` is auto.", range=(0, _MAX_SIZE), unit="texels", part_of="size")] = 1024
    height: Annotated[int, Option(
        "Height of the texture; 0 where `size` is auto.", range=(0, _MAX_SIZE), unit="texels", part_of="size")] = 1024
    directions: Annotated[int | None, _visibility(
        "Light directions, uniform on the sphere. auto: 1152, by rays fewer where more would not pay.", "-n",
        common=True, range=(1, 1_000_000), default_text="auto", quantity=DIRECTIONS, none=AUTO,
        more="auto, by rays: 288 to 1152, fewer where the texture is too coarse to show more; a texel takes a ninth of "
        "them and shares what it sees with its neighbours, or takes all where they differ. A number: every texel takes "
        "as many. They come in pairs, so an odd number is rounded up.")] = None
    sampling: Annotated[Sampling, _visibility(
        "Take directions on a spherical Fibonacci lattice, or at random.",
        more="Random directions are antithetic pairs drawn from `seed`.")] = "fibonacci"
    seed: Annotated[int, _visibility("Seed of the random directions.", range=(0, 2**32 - 1))] = 0
    shadow_size: Annotated[int | None, _visibility(
        "Side of the depth maps in texels.", range=(16, 8192), unit="texels", default_text="auto", none=AUTO,
        quantity=SHADOW_SIZE,
        more="auto: 512 to 2048, so that its texels are somewhat smaller than the texture's on the surface, "
        "larger with fewer than 1000 directions.")] = None
    backend: Annotated[Backend, _visibility(
        "Measure visibility by depth maps in OpenGL (gl) or by rays (ray). auto: gl on a GPU, else what is faster.",
        common=True,
        more="Rays are traced by Embree and need no OpenGL. On a processor they are faster than maps with `directions` "
        "auto, and take 0.9 to 1.7 times as long with a number.")] = "auto"
    unwrap: Annotated[Unwrap, _mesh(
        "Keep the file's UVs, or make new ones. auto keeps UVs that can hold a bake.", common=True,
        more="keep keeps them also where they overlap, and warns. Else auto takes xatlas, or uvunwrap above 30,000 "
        "triangles and where xatlas is not installed.")] = "auto"
    unwrap_timeout: Annotated[float | None, _mesh(
        "Stop xatlas or uvunwrap after this time; the bake then fails.", range=(0, 1_000_000), above_min=True,
        unit="seconds", metavar="SECONDS", default_text="no limit")] = None
    texel_density: Annotated[float | None, _texture(
        "Give every chart of new UVs this many texels per unit of the mesh.",
        range=(0, 1_000_000_000), above_min=True, unit="texels per unit", metavar="X",
        default_text="as many as the texture has room for, more where they are needed",
        more="The shorter side of the texture counts. A size that has no room for it is refused. UVs that are kept "
        "have a density of their own.")] = None
    textures: Annotated[Textures, _texture(
        "Bake one texture, or one for each material or mesh of the file; `size` is that of each.",
        more="All parts occlude each other as in one texture. Several are named after their material or mesh, as "
        "`<name>_ao.<material>.png`. UVs of a material or mesh that can hold its own bake are kept. "
        "UVs on UDIM tiles make one texture a tile, `<name>_ao.1001.png`.")] = "one"
    padding: Annotated[int, _texture(
        "Texels by which charts are extended into the gutters around them.", range=(0, 256), unit="texels",
        more="Gutters are packed twice as wide where there is room.")] = 8
    fill: Annotated[Fill, _texture(
        "Fill the texels beyond the padding with the mean, smoothly (pushpull), or with 0 (none).",
        more="The mean is that of the covered texels.")] = "mean"
    bit_depth: Annotated[BitDepth, _texture(
        "Bits of a channel, or a float type. auto: half for EXR, 8 for other formats.")] = "auto"
    target_error: Annotated[float | None, _visibility(
        "Stop before `directions` once the estimated sampling error is at most E.", range=(0, 1), metavar="E",
        default_text="never stop early",
        more="The error is the RMS error of a texel; it is estimated after every multiple of 256 directions. Where "
        "`size` is auto, E holds for the sum of its square and that of the error that the resolution adds.")] = None
    max_error: Annotated[float | None, _visibility(
        "Bake until the RMS error, as rendered, is at most E with 95% confidence, or say that it cannot be.",
        common=True, range=(0.001, 1), metavar="E", default_text="no certificate",
        more="The error is measured by rays at points that the texture was not fitted to. Directions are added as long "
        "as they help, at most `directions`, then texels where `size` is auto. The picture, a glTF and the report hold "
        "the certificate, which `verify` confirms. Where it cannot be, the files are written and the exit code is 1; "
        "a batch warns.")] = None
    threads: ThreadsField = 0
    memory_limit: Annotated[int | None, _run(
        "Stay within this much memory, such as 1.5G: the same texture in more time.", range=(1, 1 << 50), unit="bytes",
        default_text="no limit", quantity=BYTES,
        more="The unwrapper is not limited. A limit that is too low is refused, with one that suffices, once "
        "the number of covered texels is known. K, M, G and T are powers of 1024.")] = None
    pack: Annotated[Pack, _texture(
        "orm: put occlusion into one picture with glTF's roughness and metalness.",
        more="This needs materials that have these on the same UVs.")] = "none"
    strength: Annotated[float, _texture(
        "Strength that a glTF gives its occlusion: viewers show 1 + X (AO - 1).", range=(0, 1), metavar="X",
        more="The texture stays as it is. Other formats have no strength, as a warning says.")] = 1
    invert: Annotated[bool, _texture(
        "Write the occlusion 1 - AO, 0 where it is open, as the picture.",
        more="The picture says so: every command reads it back as AO. The mesh gets a picture of the AO itself, "
        "inside it or beside it as `<name>_open.png`, since this is what its format means by occlusion.")] = False
    vertex_ao: Annotated[VertexAo, _output(
        "Write the AO at the vertices as well: as an attribute (glTF: _AO, PLY: ao), or as color (glTF: COLOR_0).",
        more="It is that whose interpolation over the faces is nearest to the texture, by least squares. PLY has ao "
        "either way; other formats hold neither.")] = "none"
    bent_normals: Annotated[bool, _output(
        "Measure bent normals and spherical harmonics as well.",
        more="Files of a bake that hold them switch it on.", hidden=True)] = False
    bent_space: Annotated[BentSpace, _texture(
        "Space of bent normals and spherical harmonics: tangent to the surface, the part's own, or the world.",
        more="tangent: the file's tangents, else those of MikkTSpace, which a glTF then gets. object: that of the glTF "
        "node, before it is placed; world: that of the positions. Arrays in Python are in world.")] = "tangent"
    green: Annotated[Green, _texture(
        "Where the green of bent normals and spherical harmonics points: up (OpenGL, glTF) or down (DirectX).")] = "up"
    size: InitVar[Annotated[int | tuple[int, int] | Literal["auto"] | None, _texture(
        "Size of the texture in texels: one number for a square, width and height, or auto.", common=True,
        range=(1, _MAX_SIZE), unit="texels", quantity=TEXTURE_SIZE,
        more="auto: the smallest power of two from 64 to 8192 that holds `texel_density`; without that, at which the "
        "resolution adds an RMS error of at most 0.005, 0.7 of `target_error`, or half of `max_error`, as "
        "estimated by ray tracing.")]] = None

    @property
    def direction_count(self) -> int:
        """Number of light directions, before it is rounded up to pairs."""
        return AUTO_DIRECTIONS if self.directions is None else self.directions

    @property
    def interleaves(self) -> bool:
        """Whether texels may take fewer directions than there are, where rays are traced."""
        return (self.directions is None or self.max_error is not None) and self.target_error is None

    def __post_init__(self, size: int | tuple[int, int] | Literal["auto"] | None) -> None:
        """Check every value; raise ArgumentError where one is wrong."""
        if size is not None:
            checked = option_field(BakeOptions, "size").check(size)
            width, height = (0, 0) if checked == AUTO else checked
            object.__setattr__(self, "width", width)
            object.__setattr__(self, "height", height)
        super().__post_init__()
        if self.backend == "gl" and self.max_distance is not None:
            raise ArgumentError(
                "backend",
                "is 'gl', but depth maps do not tell how far away an occluder is, as {max_distance} needs; omit one",
                "max_distance",
            )
        if self.max_error is not None and self.target_error is not None:
            raise ArgumentError(
                "max_error", "and {target_error} both say when the bake ends; omit one of them", "target_error"
            )
        if self.max_error is not None and self.sampling == "random":
            raise ArgumentError(
                "sampling", "is 'random', which takes far too many directions for {max_error}; omit one", "max_error"
            )
        if (self.width == 0) != (self.height == 0):
            name = "width" if self.width == 0 else "height"
            raise ArgumentError(name, f"is 0; expected a whole number from 1 to {_MAX_SIZE}")
