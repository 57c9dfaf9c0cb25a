"""The report of a bake: what was read, chosen and measured, of each texture and of all as one."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from aoprecalc.api.bake_messages import ground_alone
from aoprecalc.api.documents import ErrorCertificate, RayTracedErrors
from aoprecalc.api.high_to_low import high_to_low
from aoprecalc.api.reports import (
    BakeOutputs,
    BakeReport,
    DarkPartShares,
    DarkTexelShares,
    InputMesh,
    OcclusionStatistics,
    PartRoles,
    SizeChoice,
    SizeError,
    TexelCounts,
    TextureReport,
    Unwrapping,
    UvSetCheck,
    VertexFit,
)
from aoprecalc.api.texture_size import resolution_target
from aoprecalc.api.vertex_ao import VertexErrors, vertex_errors
from aoprecalc.mesh.topology import topology
from aoprecalc.metrics.difference import rounded
from aoprecalc.metrics.errors import TextureErrors
from aoprecalc.metrics.resolution import POINTS
from aoprecalc.options import BakeOptions
from aoprecalc.progress import notes_of, warnings_of
from aoprecalc.types import Baked, DarkTexels, Float32Array, Part, UvCheck
from aoprecalc.uv.checks import TexelDensity, needs_uvs, surface_share
from aoprecalc.uv.pack import first_unsafe_mip

NamedBakes = Sequence[tuple[str, Baked]]  # textures of a bake: their names and bakes


def bake_report(
    baked: Baked,
    options: BakeOptions,
    outputs: BakeOutputs,
    verified: TextureErrors | None,
    seconds: dict[str, float],
    messages: tuple[str, ...],
    textures: NamedBakes = (),
) -> BakeReport:
    """Return the report of a bake; only `seconds` differs between equal runs.

    textures   of the bake, each by itself; none where there is one
    """
    scene, mesh = baked.scene, topology(baked.scene.faces)
    of_each = tuple(texture_report(name, one, options) for name, one in textures or (("", baked),))
    whole = of_each[0] if len(of_each) == 1 else _of_all(texture_report("", baked, options), textures, of_each)
    return BakeReport(
        input=InputMesh(
            str(scene.path),
            len(scene.faces),
            len(scene.positions),
            mesh.components,
            mesh.watertight,
            *(scene.welded or ()),
        ),
        parts=tuple(_part_roles(part) for part in scene.parts),
        outputs=outputs,
        renderer=baked.renderer,
        backend=baked.backend,
        directions=baked.directions,
        directions_per_texel=round(baked.directions_per_texel),
        estimated_error=None if baked.sampling_error is None else round(baked.sampling_error, 6),
        certificate=ErrorCertificate.of(baked.certificate),
        sampling=options.sampling,
        options=baked.options,
        floor=None if scene.around.ground is None else scene.around.ground.normal,
        shadow_size=baked.shadow_size,
        unwrap=whole.unwrap,
        texels=whole.texels,
        size_choice=whole.size_choice,
        ao=whole.ao,
        dark=whole.dark,
        textures=of_each,
        verify=None if verified is None else RayTracedErrors.of(verified),
        vertex_ao=_vertex_fit(vertex_errors(baked, verified)),
        high_to_low=high_to_low(scene, baked.missed, whole.texels.valid + baked.missed),
        seconds=seconds,
        warnings=warnings_of(messages),
        notes=notes_of(messages),
    )


def texture_report(name: str, baked: Baked, options: BakeOptions) -> TextureReport:
    """Return what is reported of one texture."""
    scene, atlas, texture = baked.scene, baked.atlas, baked.texture
    height, width = texture.values.shape
    valid = int(np.count_nonzero(texture.valid))
    lost = needs_uvs(scene) & ~atlas.mapped
    density = TexelDensity.of(scene, atlas, width, height)
    return TextureReport(
        name=name,
        triangles=int(np.count_nonzero(scene.receives)),
        unwrap=Unwrapping(
            method=atlas.method,
            uv_set=atlas.uv_set,
            checks=tuple(_uv_set_check(check) for check in atlas.checks),
            charts=atlas.charts,
            lost_faces=int(np.count_nonzero(lost)),
            lost_share=round(surface_share(scene, lost), 6),
            used_share=round(valid / texture.valid.size, 4),
            gutter=atlas.gutter,
            first_unsafe_mip=None if atlas.gutter is None else first_unsafe_mip(atlas.gutter, options.padding),
            texel_density=rounded(density.mean),
            least_density=rounded(density.least),
        ),
        texels=TexelCounts(width, height, valid),
        size_choice=_size_choice(baked, options),
        ao=_statistics(texture.values[texture.valid], baked),
        dark=_dark_texel_shares(baked.dark),
    )


def _of_all(joined: TextureReport, textures: NamedBakes, of_each: Sequence[TextureReport]) -> TextureReport:
    """Return what is reported of several textures, from what is reported of their bakes as one."""
    counts, whole = [one.texels for one in of_each], [baked.texture for _, baked in textures]
    valid = sum(count.valid for count in counts)
    values = np.concatenate([texture.values[texture.valid] for texture in whole])
    mean = round(float(values.mean(dtype=np.float64)), 6)
    used = round(valid / sum(texture.valid.size for texture in whole), 4)
    return replace(
        joined,
        unwrap=replace(joined.unwrap, used_share=used),
        texels=TexelCounts(max(count.width for count in counts), max(count.height for count in counts), valid),
        ao=replace(joined.ao, mean=mean),
    )


def _statistics(values: Float32Array, baked: Baked) -> OcclusionStatistics:
    alone = ground_alone(baked)
    return OcclusionStatistics(
        mean=round(float(values.mean(dtype=np.float64)), 6),
        min=round(float(values.min()), 6),
        max=round(float(values.max()), 6),
        unseen_share=round(baked.dark.share, 6),
        ground_alone=None if alone is None else round(alone, 6),
    )


def _size_choice(baked: Baked, options: BakeOptions) -> SizeChoice | None:
    if not baked.size_estimates:
        return None
    tried = tuple(SizeError(size, rounded(error)) for size, error in baked.size_estimates)
    error = dict(baked.size_estimates)[len(baked.texture.values)]
    return SizeChoice(rounded(error), rounded(resolution_target(options)), POINTS, tried)


def _dark_texel_shares(dark: DarkTexels) -> DarkTexelShares | None:
    if not dark.samples:
        return None
    names = ("inside", "inwards", "below_ground", "on_ground", "above_ground", "narrow")
    shares = {name: round(getattr(dark, name), 6) for name in names}
    parts = tuple(DarkPartShares(part.name, round(part.inside, 6), round(part.inwards, 6)) for part in dark.parts)
    return DarkTexelShares(**shares, parts=parts, samples=dark.samples)


def _vertex_fit(errors: VertexErrors | None) -> VertexFit | None:
    if errors is None:
        return None
    traced = None if errors.traced is None else round(errors.traced, 6)
    return VertexFit(errors.vertices, round(errors.rmse, 6), traced)


def _part_roles(part: Part) -> PartRoles:
    return PartRoles(
        name=part.name,
        triangles=part.stop - part.start,
        receives=part.receives,
        occludes=part.occludes,
        shares=part.uv_owner,
        glass=part.material.transparent,
        unlit=part.material.unlit,
        cut_out=part.material.alpha_mask is not None,
        level=None if part.levels is None else part.levels.start,
        hull=part.hull,
    )


def _uv_set_check(check: UvCheck) -> UvSetCheck:
    overlap = None if check.overlap is None else round(check.overlap, 6)
    share = round(check.flat_share, 6)
    return UvSetCheck(check.uv_set, check.flat_faces, share, check.tiles, overlap, check.fault)
