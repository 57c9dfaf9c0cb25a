"""How the visibility of a bake is gathered: the side of its depth maps, and how many texels fit in memory at a time."""

from dataclasses import dataclass

from aoprecalc.errors import ArgumentError, format_bytes
from aoprecalc.mesh.detail import detail_of
from aoprecalc.mesh.roles import in_poses
from aoprecalc.raster.layout import BAND_TEXELS
from aoprecalc.system import resident_memory
from aoprecalc.visibility.directions import MIN_SHADOW_SIZE, auto_shadow_size
from aoprecalc.visibility.setup import BakeSetup

FIT_CHUNK = 1 << 20  # texels added to the least-squares image at a time, at any chunk size: no sum depends on that

# Without a limit. More would save little time: rendering the maps twice for 4096^2 texels takes a tenth longer and
# saves 400 MB.
_MAX_FIT_CHUNKS = 8

# Memory that a bake takes beyond what is resident before it; measured, rounded up. In bytes:
_PER_TEXTURE_TEXEL = 24  # the planes of the least-squares image
_PER_WAITING_TEXEL = 16  # samples at one offset, in at most _WAITING texels, and room for more
_PER_COVERED_TEXEL = 24  # its index, and the sums of both halves
_PER_CHUNK_TEXEL = 72  # by rays the samples of three chunks and the sums of two; else a sample, its receiver, sums
_PER_TEXTURE_TEXEL_SOLVING = 58  # while the least-squares image is solved and no visibility is computed
_PER_CHUNK_TEXEL_SOLVING = 16  # freed memory that the allocator keeps during the solve
# More where visibility vectors are gathered too: three values for each one.
_VECTORS = {"texture": 12, "waiting": 24, "covered": 24, "chunk": 40, "solving": 48}
# More where neighbouring texels take different directions: their groups and sums, and their faces or rows of requests.
_INTERLEAVED = {"covered": 16, "vectors": 12}
_WAITING = 3 * BAND_TEXELS
_PER_MAP_TEXEL = 8  # the near and the far depth along an axis
_PER_TRIANGLE = 400  # while occluders are sorted and uploaded
_MAPS = 1 << 26  # a batch of depth maps, unless a single axis takes more
_REST = 80 << 20  # that batch, and what the renderer compiles and keeps
_VARIATION = 16  # megabytes by which the resident memory differs from one run to the next


@dataclass(frozen=True)
class GatherPlan:
    """How the visibility of a bake is gathered.

    shadow_size   side of the depth maps, in texels; not used by rays
    chunk_size    texels of a side that are processed at a time, at most
    passes        the chunks of all sides: how many times all directions are gone through, in each pose
    """

    shadow_size: int
    chunk_size: int
    passes: int


def plan_gather(setup: BakeSetup) -> GatherPlan:
    """Return what suits the texels of a setup, within its limit of memory; raises what `texels_per_chunk` raises."""
    options, detail = setup.inputs.options, detail_of(setup.inputs.scene)
    # Rays need no maps: the side that suits is not looked for.
    by_rays = setup.backend.kind == "ray"
    shadow_size = options.shadow_size or (MIN_SHADOW_SIZE if by_rays else _auto_shadow_size(setup))
    chunk_size = texels_per_chunk(
        options.memory_limit,
        f"{options.width} x {options.height}",
        options.width * options.height,
        len(setup.texels),
        shadow_size,
        triangles=len(setup.sides[0].surface.occluders) + (0 if detail is None else len(detail.scene.faces)),
        vectors=options.bent_normals,
        interleaved=setup.interleaved,
    )
    return GatherPlan(shadow_size, chunk_size, sum(len(chunks(len(side.texels), chunk_size)) for side in setup.sides))


def _auto_shadow_size(setup: BakeSetup) -> int:
    """Return the greatest side that a pose of a side needs, see `auto_shadow_size`."""
    inputs, texels = setup.inputs, len(setup.texels)
    detailed = detail_of(inputs.scene) is not None
    return max(
        auto_shadow_size(posed, inputs.atlas, texels, setup.directions.count, side.scene if detailed else None)
        for side in setup.sides
        for posed, _ in in_poses(setup.textured(side), inputs.normals)
    )


def texels_per_chunk(
    memory_limit: int | None,
    size: str,
    texture_texels: int,
    covered_texels: int,
    shadow_size: int,
    triangles: int,
    *,
    vectors: bool = False,
    interleaved: bool = False,
) -> int:
    """Return how many texels can be processed at a time within `memory_limit` bytes; None is no limit.

    It is a multiple of FIT_CHUNK, or all covered texels. The result of a bake does not depend on it; with smaller
    chunks the depth maps are rendered more often.

    size              of the texture, for messages
    texture_texels    of which the surface covers `covered_texels`
    shadow_size       side of the depth maps, in texels
    triangles         of the mesh
    vectors           visibility vectors are gathered too
    interleaved       neighbouring texels take different directions
    Raises UsageError where not even FIT_CHUNK texels fit.
    """
    largest = _MAX_FIT_CHUNKS * FIT_CHUNK
    if memory_limit is None:
        return min(largest, covered_texels)
    map_bytes = _PER_MAP_TEXEL * shadow_size**2
    present = _resident() + _REST + max(0, map_bytes - _MAPS) + triangles * _PER_TRIANGLE

    def needed(chunk: int) -> int:
        gathering = texture_texels * _PER_TEXTURE_TEXEL + covered_texels * _PER_COVERED_TEXEL + chunk * _PER_CHUNK_TEXEL
        waiting = min(texture_texels, _WAITING)
        gathering += waiting * _PER_WAITING_TEXEL
        solving = texture_texels * _PER_TEXTURE_TEXEL_SOLVING + chunk * _PER_CHUNK_TEXEL_SOLVING
        if interleaved:
            gathering += covered_texels * (_INTERLEAVED["covered"] + vectors * _INTERLEAVED["vectors"])
        if vectors:
            gathering += texture_texels * _VECTORS["texture"] + covered_texels * _VECTORS["covered"]
            gathering += chunk * _VECTORS["chunk"] + waiting * _VECTORS["waiting"]
            solving += texture_texels * _VECTORS["solving"]
        return present + max(gathering, solving)

    for chunk in range(largest, 0, -FIT_CHUNK):
        if needed(min(chunk, covered_texels)) <= memory_limit:
            return min(chunk, covered_texels)
    advice = "use a higher limit or a smaller {size}" if present < memory_limit else "use a higher limit"
    enough = (needed(min(FIT_CHUNK, covered_texels)) >> 20) + _VARIATION
    raise ArgumentError(
        "memory_limit",
        f"is {format_bytes(memory_limit)}; {size} texels of this mesh need {enough}M; {advice}",
        "size",
    )


def chunks(count: int, chunk_size: int) -> list[slice]:
    """Cut `count` texels into chunks of `chunk_size`, the last one possibly smaller."""
    return [slice(start, min(start + chunk_size, count)) for start in range(0, count, chunk_size)]


def _resident() -> int:
    """Return the memory of this process in bytes; raises UsageError where the system does not tell."""
    memory = resident_memory()
    if memory is None:
        raise ArgumentError(
            "memory_limit", "needs to know how much memory is used, which this system does not tell; omit it"
        )
    return memory
