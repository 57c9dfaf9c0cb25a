"""Options of `bake` and `verify`: the texture, its visibility, and the scene."""

from dataclasses import InitVar, dataclass
from typing import Annotated, Literal

from aoprecalc.errors import ArgumentError
from aoprecalc.options.fields import BYTES, SHADOW_SIZE, SIZE, Option, Validated, documented, option_field

Sampling = Literal["fibonacci", "random"]
Estimator = Literal["ratio", "mean"]
Backend = Literal["auto", "gl", "ray"]
Unwrap = Literal["auto", "keep", "xatlas", "uvunwrap"]
Fill = Literal["mean", "pushpull", "none"]
Normals = Literal["auto", "file", "smooth", "flat"]
BitDepth = Literal["auto", "8", "16", "half", "float"]
Instances = Literal["bake", "share"]
Pack = Literal["none", "orm"]
Up = Literal["auto", "x", "y", "z"]

# Above this many triangles `unwrap="auto"` prefers uvunwrap, 10 to 40 times faster than xatlas on large surfaces.
LARGE_MESH = 30_000

_MAX_SIZE = 32768
_NAMES = "A name may contain `*` and `?`."

EstimatorField = Annotated[
    Estimator,
    Option(
        "ratio: the visible share of the cosine-weighted directions; mean: the plain Monte Carlo sum.",
        more="The ratio is exactly 1 on an open point; the sum is clamped to 1.",
        group="Visibility",
    ),
]
NormalsField = Annotated[
    Normals,
    Option(
        "Shading normals. auto: the file's, else smooth ones.",
        more="A glTF file without normals gets flat ones.",
        group="Mesh",
    ),
]
CreaseAngleField = Annotated[
    float | None,
    Option(
        "Edges that bend more than this are hard where smooth normals are computed.",
        group="Mesh",
        range=(0, 180),
        unit="degrees",
        metavar="DEG",
        default_text="180; STL 40",
    ),
]
ThreadsField = Annotated[
    int,
    Option(
        "Threads for software rendering and rays; 0: all cores.",
        more="A process keeps the number that its first bake asked for.",
        group="Run",
        range=(0, 1024),
    ),
]


@documented
@dataclass(frozen=True, kw_only=True)
class LightOptions(Validated):
    """Which parts of a scene receive light and which occlude it."""

    only: Annotated[
        tuple[str, ...],
        Option("Parts that are baked; the others still occlude.", more=_NAMES, group="Scene"),
    ] = ()
    exclude: Annotated[
        tuple[str, ...],
        Option("Parts to leave out: they neither receive nor occlude.", more=_NAMES, group="Scene"),
    ] = ()
    occluders_only: Annotated[
        tuple[str, ...], Option("Parts that occlude but are not baked.", more=_NAMES, group="Scene")
    ] = ()
    glass_occludes: Annotated[
        bool,
        Option(
            "Transparent materials occlude too.",
            more="Without it they are baked, but light passes through them (glTF: BLEND, transmission).",
            group="Scene",
        ),
    ] = False
    two_sided: Annotated[
        bool,
        Option(
            "Take the lighter value of the two sides of every face.",
            more="Without it only double-sided glTF materials with an alpha mask, such as leaves, do so.",
            group="Scene",
        ),
    ] = False
    ground: Annotated[bool, Option("Put the scene on an endless floor: no light comes from below.", group="Scene")] = (
        False
    )
    up: Annotated[Up, Option("Axis that points up from the floor of `ground`. auto: y; z for STL.", group="Scene")] = (
        "auto"
    )

    def __post_init__(self) -> None:
        """Check every value; raise ArgumentError where one is wrong."""
        super().__post_init__()
        if self.up != "auto" and not self.ground:
            raise ArgumentError(
                "up", f"is {self.up!r}, but there is no floor; add {{ground}}, or omit {{up}}", "ground", "up"
            )


class _TextureSize:
    """Gives the size of a texture as one value."""

    @property
    def size(self) -> tuple[int, int]:
        """Width and height in texels."""
        return self.__dict__["width"], self.__dict__["height"]


@documented
@dataclass(frozen=True)
class BakeOptions(_TextureSize, LightOptions):
    """How to bake an ambient-occlusion texture.

    `size` sets `width` and `height`, and takes precedence over them.
    """

    width: Annotated[int, Option("Width of the texture.", range=(1, _MAX_SIZE), unit="texels", part_of="size")] = 1024
    height: Annotated[int, Option("Height of the texture.", range=(1, _MAX_SIZE), unit="texels", part_of="size")] = 1024
    directions: Annotated[
        int,
        Option(
            "Light directions, uniform on the sphere.",
            short="-n",
            more="They come in pairs, so an odd number is rounded up.",
            group="Visibility",
            range=(1, 1_000_000),
        ),
    ] = 1000
    sampling: Annotated[
        Sampling,
        Option(
            "Choose the directions on an even lattice, or at random.",
            more="Random directions are antithetic pairs drawn from `seed`.",
            group="Visibility",
        ),
    ] = "fibonacci"
    seed: Annotated[int, Option("Seed of the random directions.", group="Visibility", range=(0, 2**32 - 1))] = 0
    estimator: EstimatorField = "ratio"
    shadow_size: Annotated[
        int | None,
        Option(
            "Side of a depth map.",
            more="auto: 512 to 2048, so that its texels are somewhat smaller than the texture's on the surface, "
            "larger with fewer than 1000 directions.",
            group="Visibility",
            range=(16, 8192),
            unit="texels",
            quantity=SHADOW_SIZE,
            default_text="auto",
        ),
    ] = None
    backend: Annotated[
        Backend,
        Option(
            "Measure visibility by depth maps in OpenGL (gl) or by rays (ray). auto: gl, else ray.",
            more="Rays are traced by Embree (the extra `ray`), need no OpenGL and take four to eight times as long.",
            group="Visibility",
        ),
    ] = "auto"
    unwrap: Annotated[
        Unwrap,
        Option(
            "Keep the file's UVs, or make new ones. auto keeps UVs that can hold a bake.",
            more="Else auto takes xatlas, or uvunwrap above 30,000 triangles.",
            group="Mesh",
        ),
    ] = "auto"
    unwrap_timeout: Annotated[
        float | None,
        Option(
            "Stop xatlas or uvunwrap after this time; the bake then fails.",
            group="Mesh",
            range=(0, 1_000_000),
            above_min=True,
            unit="seconds",
            metavar="SECONDS",
            default_text="no limit",
        ),
    ] = None
    padding: Annotated[
        int,
        Option(
            "Texels by which charts are extended into the gutters around them.",
            more="Gutters are packed twice as wide where there is room.",
            group="Texture",
            range=(0, 256),
            unit="texels",
        ),
    ] = 8
    fill: Annotated[
        Fill,
        Option(
            "Fill the texels beyond the padding with the mean, smoothly (pushpull), or with 0 (none).",
            more="The mean is that of the covered texels.",
            group="Texture",
        ),
    ] = "mean"
    bit_depth: Annotated[
        BitDepth,
        Option("Bits of a channel, or a float type. auto: half for EXR, 8 for other formats.", group="Texture"),
    ] = "auto"
    normals: NormalsField = "auto"
    crease_angle: CreaseAngleField = None
    target_error: Annotated[
        float | None,
        Option(
            "Stop before `directions` once the estimated sampling error is at most E.",
            more="The error is the RMS error of a texel; it is estimated after every multiple of 256 directions.",
            group="Visibility",
            range=(0, 1),
            metavar="E",
            default_text="never stop early",
        ),
    ] = None
    threads: ThreadsField = 0
    memory_limit: Annotated[
        int | None,
        Option(
            "Stay within this much memory, such as 1.5G: the same texture in more time.",
            more="The unwrapper is not limited. A limit that is too low is refused, with one that suffices, once the "
            "number of covered texels is known. K, M, G and T are powers of 1024.",
            group="Run",
            range=(1, 1 << 50),
            unit="bytes",
            quantity=BYTES,
            default_text="no limit",
        ),
    ] = None
    instances: Annotated[
        Instances,
        Option(
            "Bake each instance of a mesh into texels of its own, or let them share texels.",
            more="Shared texels hold the mean of the instances' values.",
            group="Mesh",
        ),
    ] = "bake"
    pack: Annotated[
        Pack,
        Option(
            "orm: put occlusion into one picture with glTF's roughness and metalness.",
            more="This needs materials that have these on the same UVs.",
            group="Texture",
        ),
    ] = "none"
    size: InitVar[
        Annotated[
            int | tuple[int, int] | None,
            Option(
                "Size of the texture in texels: one number for a square, or width and height.",
                group="Texture",
                range=(1, _MAX_SIZE),
                unit="texels",
                quantity=SIZE,
            ),
        ]
    ] = None

    def __post_init__(self, size: int | tuple[int, int] | None) -> None:
        """Check every value; raise ArgumentError where one is wrong."""
        if size is not None:
            width, height = option_field(BakeOptions, "size").check(size)
            object.__setattr__(self, "width", width)
            object.__setattr__(self, "height", height)
        super().__post_init__()


@documented
@dataclass(frozen=True)
class VerifyOptions(LightOptions):
    """How to measure a texture against ray tracing; normals and the scene must be those of the bake."""

    points: Annotated[
        int, Option("Points, uniform by area on the surface.", group="Measurement", range=(1, 10_000_000))
    ] = 20_000
    rays: Annotated[
        int,
        Option(
            "Rays from each point.",
            more="They are stratified in a square grid, so the number is rounded up to a square; 2304 leave a noise "
            "of about 0.002.",
            group="Measurement",
            range=(64, 1_000_000),
        ),
    ] = 48 * 48
    seed: Annotated[int, Option("Seed of the points and the rays.", group="Measurement", range=(0, 2**32 - 1))] = 0
    estimator: EstimatorField = "ratio"
    normals: NormalsField = "auto"
    crease_angle: CreaseAngleField = None
    tolerance: Annotated[
        float | None,
        Option(
            "Largest RMS error at full resolution that passes; beyond it the exit code is 1.",
            more="The outputs stay.",
            group="Measurement",
            range=(0, 1),
            metavar="E",
            default_text="any error passes",
        ),
    ] = None
    threads: ThreadsField = 0
