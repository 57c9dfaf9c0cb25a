"""What a bake tells the user: warnings of what may need an action, notes of the rest."""

import math
from collections.abc import Iterable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import TypeVar

import numpy as np

from aoprecalc.errors import counted, listed, one_or_many, option_name
from aoprecalc.mesh.detail import detail_of
from aoprecalc.mesh.roles import surrounding_part
from aoprecalc.mesh.surface import area_vectors, default_crease_angle, geometric_normals, share_at_bends
from aoprecalc.mesh.topology import closed_faces, topology
from aoprecalc.options import BakeOptions
from aoprecalc.progress import Note
from aoprecalc.raster.layout import doubled_uv_areas
from aoprecalc.texture_lookup import bilinear
from aoprecalc.types import Atlas, Baked, Float64Array, Part, Scene
from aoprecalc.uv.checks import MAX_OVERLAP, needs_uvs, surface_share
from aoprecalc.uv.pack import first_unsafe_mip
from aoprecalc.visibility.sky import ImageSky, sky_of

_MIN_DARK = 0.01  # of the texels: a note tells the causes where as many are dark
_MIN_INWARDS = 0.02  # of the texels: a warning where as many are dark and face inwards
_MIN_CAUSE = 0.0005  # of the texels: rarer causes are not told; 0.1% when rounded
_MANY = 0.5  # of the texels: a warning where as many are enclosed, or face the ground
_BEND, _MIN_BENT = 40.0, 0.1  # degrees; share of the surface along edges that bend more: they may be meant to be hard
_FEW_TEXELS = 64  # 8 x 8
_SUN, _SUN_OVER_MEAN = 0.05, 10  # share of a sky's light from one direction that adds as much error as all the others
_ONE_VALUE = 0.1  # by which the AO of a part may differ and still count as one value

_OF_DIRECTIONS = "bent_space", "green"  # options of bent normals and spherical harmonics

_Value = TypeVar("_Value")


def describe_uvs(atlas: Atlas, padding: int) -> str:
    """Return a line about the UVs of a bake: whose they are, their charts, and what lies between these."""
    charts = counted(atlas.charts, "chart")
    if atlas.method == "keep":
        return f"unwrap: the file's own UVs, {charts}"
    last_safe = first_unsafe_mip(atlas.gutter or 0, padding) - 1
    if has_narrow_gutters(atlas, padding):  # a warning says so
        return f"unwrap: new UVs by {atlas.method}, {charts}"
    gutters = f"gutters of {counted(atlas.gutter or 0, 'texel')}: no charts mix up to mip level {last_safe}"
    return f"unwrap: new UVs by {atlas.method}, {charts}, {gutters}"


def has_narrow_gutters(atlas: Atlas, padding: int) -> bool:
    """Tell whether charts mix from mip level 1 on because their gutters are narrower than was wanted."""
    return atlas.gutter is not None and atlas.gutter < padding and first_unsafe_mip(atlas.gutter, padding) == 1


def messages_on(baked: Baked, options: BakeOptions, overlap: float) -> list[str]:
    """Return warnings and notes; `overlap` is the share of texels whose centre lies inside two faces."""
    scene, atlas = baked.scene, baked.atlas
    lines: list[str] = [*_notes_on_materials(scene), *_notes_on_names(scene)]
    if baked.directions - 1 == options.directions:
        lines.append(Note(f"{baked.directions} directions instead of {options.directions}: they come in pairs"))
    lines += _notes_on_unused_options(options)
    lines += _notes_on_normals(scene, options)
    lines += _warnings_on_backs(scene, options)
    lines += _warn_of_error(baked, options)
    lines += _warn_of_sun(baked, options)
    lines += _warnings_on_uvs(scene, atlas, overlap)
    texels = doubled_uv_areas(atlas.uvs) / 2 * atlas.mapped * baked.texture.values.size
    surroundings = None if atlas.method == "keep" else _surroundings(scene, texels)
    lines += _warnings_on_few_texels(baked, texels, surroundings)
    if has_narrow_gutters(atlas, options.padding):
        gutters = counted(atlas.gutter or 0, "texel")
        lines.append(
            f"{counted(atlas.charts, 'chart')}, and room for gutters of {gutters} only: charts may mix "
            "from mip level 1 on. Use a larger --size for wider gutters."
        )
    buried = _warnings_on_buried(scene, options, texels)
    lines += buried or _notes_on_ground(baked)
    return [*lines, *_messages_on_dark_texels(baked, options, surroundings, buried=bool(buried))]


def _notes_on_materials(scene: Scene) -> list[Note]:
    transparent = [part.name for part in scene.parts if part.material.transparent and not part.occludes]
    unlit = [part.name for part in scene.parts if part.material.unlit]
    lines = []
    if transparent:
        lines.append(Note(f"{_list(transparent)} transparent: baked, but light passes through; see --glass-occludes"))
    if unlit:
        lines.append(Note(f"{_list(unlit)} unlit: not baked"))
    return lines


def _notes_on_names(scene: Scene) -> list[Note]:
    """Return notes on the parts whose names give them another role."""
    hulls = [part.name for part in scene.parts if part.hull and not part.occludes and not part.receives]
    lines = []
    if scene.levels > 1:
        coarse = [part.name for part in scene.parts if part.levels and part.levels.start and part.receives]
        told = f"{scene.levels} levels of detail, each baked as if the others were not there"
        lines.append(Note(f"{told}; {_list(coarse)} coarser; see --all-parts"))
    if hulls:
        what = one_or_many(len(hulls), "a collision hull", "collision hulls")
        lines.append(Note(f"{_list(hulls)} {what}: neither baked nor in the way of light; see --all-parts"))
    return lines


def _notes_on_unused_options(options: BakeOptions) -> list[Note]:
    """Note that options of pictures were given which are not asked for."""
    unused = (
        []
        if options.bent_normals
        else [name for name in _OF_DIRECTIONS if getattr(options, name) != getattr(BakeOptions, name)]
    )
    if not unused:
        return []
    names, have = " and ".join(map(option_name, unused)), one_or_many(len(unused), "has", "have")
    return [Note(f"{names} {have} no effect without --bent-normals or --sh")]


def _notes_on_normals(scene: Scene, options: BakeOptions) -> list[Note]:
    """Note that normals were computed smooth where edges were perhaps meant to be hard."""
    if scene.normals is not None or options.normals != "auto" or options.crease_angle is not None:
        return []
    if default_crease_angle(scene) <= _BEND or (share := share_at_bends(scene, _BEND)) < _MIN_BENT:
        return []
    return [
        Note(
            f"the mesh has no normals: smooth ones were computed, also over edges that bend more than {_BEND:g} "
            f"degrees, along which {share:.0%} of the surface lies; if these are hard, use --crease-angle {_BEND:g}"
        )
    ]


def _warnings_on_backs(scene: Scene, options: BakeOptions) -> list[str]:
    """Warn that the inner side of a closed surface is the lighter one, where it sees out through backs."""
    if not options.two_sided or options.backfaces != "ignore":
        return []
    detail = detail_of(scene)
    measured = scene if detail is None else detail.scene
    single = measured.per_face(
        part.receives and not (part.material.foliage or part.material.double_sided) for part in measured.parts
    )
    if not single.any():
        return []
    areas = np.linalg.norm(area_vectors(measured.corners[single]), axis=1)
    share = float(areas[closed_faces(measured.faces[single])].sum() / max(float(areas.sum()), 1e-30))
    if share < _MIN_CAUSE:
        return []
    light = f"{share:.0%} of the surface is closed and too light: the inner side, which sees out through backs, counts"
    return [f"{light} with --two-sided and --backfaces ignore; omit one of them"]


def _list(parts: list[str]) -> str:
    names = listed([named for named, _ in _by_name((part, None) for part in parts)])
    return f"{counted(len(parts), 'part')} ({names}) {one_or_many(len(parts), 'is', 'are')}"


def _by_name(parts: Iterable[tuple[str, _Value]]) -> Iterator[tuple[str, list[_Value]]]:
    """Yield each name of some parts, quoted, with how many parts share it, and their values."""
    values: dict[str, list[_Value]] = {}
    for name, value in parts:
        values.setdefault(name, []).append(value)
    for name, found in values.items():
        yield (repr(name) if len(found) == 1 else f"{name!r}, {len(found)} times"), found


def _percentages(parts: Iterable[tuple[str, float]]) -> str:
    """Return names of parts with their shares, in brackets; of parts of one name the mean. Empty for no parts."""
    found = listed([f"{named}: {np.mean(shares):.0%}" for named, shares in _by_name(parts)])
    return f" ({found})" if found else ""


def _warn_of_error(baked: Baked, options: BakeOptions) -> list[str]:
    error, target = baked.sampling_error, options.target_error
    if target is None or (error is not None and error <= target):
        return []
    if error is None:
        return ["the sampling error cannot be estimated from 128 directions or fewer; use more --directions"]
    return [
        f"the estimated sampling error is {error:.4f} after {baked.directions} directions, more than the target of "
        f"{target:.4g}; use more --directions"
    ]


def _warn_of_sun(baked: Baked, options: BakeOptions) -> list[str]:
    """Warn of a sky of which one direction has so much light that its hard shadow is most of the error."""
    sky, count = sky_of(baked.scene, options), baked.directions
    if not isinstance(sky, ImageSky) or (share := sky.share_in_one(count)) <= max(_SUN, _SUN_OVER_MEAN / count):
        return []
    off = math.degrees(math.acos(1 - 2 / count))
    found = f"{Path(options.sky).name}: {share:.0%} of its light comes from one of {count} directions, as from a sun"
    return [
        f"{found}: its shadow is hard and up to {off:.0f} degrees off; use an image without it, or more --directions"
    ]


def _warnings_on_uvs(scene: Scene, atlas: Atlas, overlap: float) -> list[str]:
    """Return warnings of what has no texels, or not its own."""
    lines, kept = [], atlas.method == "keep"
    lost = needs_uvs(scene) & ~atlas.mapped
    if count := int(np.count_nonzero(lost)):
        share = f"{count} of {counted(len(lost), 'face')} ({surface_share(scene, lost):.2g} of the surface)"
        why = one_or_many(count, "has no area", "have no area") + " in the file's UVs" if kept else "got no UVs"
        lines.append(f"{share} {why}, so no texels{'; --unwrap xatlas makes new UVs' if kept else ''}")
    if overlap > (0.0 if kept else MAX_OVERLAP):
        least = "less than 0.1%" if overlap < MAX_OVERLAP else f"{overlap:.1%}"
        whose = "they have the value of the face that comes first in the file; --unwrap xatlas makes new UVs"
        own = "they have the value of one of them"
        lines.append(f"{least} of the texels lie inside two faces: {whose if kept else own}")
    return lines


def _surroundings(scene: Scene, texels: Float64Array) -> Part | None:
    """Return the part that leaves the others little of the texture, as it is far larger than all that is baked.

    texels   (f,) the area of each face in the texture, which may be one of several: see `Scene.baked_only`
    """
    largest = surrounding_part(scene, texels)
    if largest is None or scene.baked_only is None:
        return largest
    areas = np.linalg.norm(area_vectors(scene.corners), axis=1)
    return largest if surrounding_part(scene, areas * replace(scene, baked_only=None).receives) is largest else None


def _warnings_on_few_texels(baked: Baked, texels: Float64Array, surroundings: Part | None) -> list[str]:
    """Warn of a part that takes most of the texture, and of others that have too few texels to show their AO.

    texels         (f,) the area of each face in the texture
    surroundings   the part that takes most of it as it is far larger than the rest
    """
    few = list(_parts_with_few_texels(baked, texels))
    names = listed([f"{named}: {max(found):.0f}" for named, found in _by_name(few)])
    too_few = f"fewer than {_FEW_TEXELS} texels ({names}), too few to show {one_or_many(len(few), 'its', 'their')} AO"
    if surroundings is not None:
        taken = texels[surroundings.faces].sum() / texels.sum()
        far = f"{surroundings.name!r}: {taken:.0%} of the texture, as it is far larger than the rest"
        left = f", and leaves {counted(len(few), 'part')} {too_few}" if few else ""
        needs = "if it needs none, --exclude it, or use --occluders-only if it shall still keep out light"
        return [f"{far}{left}; {needs}"]
    if not few:
        return []
    have = f"{counted(len(few), 'part')} {one_or_many(len(few), 'has', 'have')} {too_few}"
    return [f"{have}; use a larger --size, or bake {one_or_many(len(few), 'it', 'them')} alone with --only"]


def _parts_with_few_texels(baked: Baked, texels: Float64Array) -> Iterator[tuple[str, float]]:
    """Yield the names and texels of parts with few of them, and different values at them: one value needs no more."""
    atlas = baked.atlas
    inside = (atlas.uvs + atlas.uvs.mean(axis=1, keepdims=True)) / 2
    for part in baked.scene.parts:
        mapped, own = atlas.mapped[part.faces], float(texels[part.faces].sum())
        if mapped.any() and own < _FEW_TEXELS:
            places = inside[part.faces][mapped].reshape(-1, 2)
            if np.ptp(bilinear(baked.texture.values, places, repeats=atlas.repeats)) > _ONE_VALUE:
                yield part.name, own


def _warnings_on_buried(scene: Scene, options: BakeOptions, texels: Float64Array) -> list[str]:
    """Warn of what lies below the ground; `texels` are the (f,) areas of the faces in the texture."""
    ground = scene.around.ground
    if ground is None or ground.height is None:
        return []
    heights = scene.corners @ np.asarray(ground.normal)
    share = float(texels @ (heights.mean(axis=1) < ground.height)) / max(float(texels.sum()), 1e-30)
    if share < _MIN_CAUSE:
        return []
    low, high = float(heights[scene.receives].min()), float(heights[scene.receives].max())
    axis = "xyz"[int(np.argmax(ground.normal))]
    found = f"{share:.1%} of texels lie below the ground at {ground.height:g} and are dark"
    reach = f"the mesh reaches from {low:g} to {high:g} along {axis}"
    other = ", or name another axis with --up" if options.up == "auto" and scene.up is None and share >= _MANY else ""
    return [f"{found}: {reach}; use a --ground-height of at most {low:g}{other}"]


def _notes_on_ground(baked: Baked) -> list[Note]:
    alone = ground_alone(baked)
    if alone is None:
        return []
    return [
        Note(
            f"the ground alone lowers the mean AO to {alone:.2f}: no light comes from below, so upright walls get at "
            "most 0.5, and faces that point down 0"
        )
    ]


def ground_alone(baked: Baked) -> float | None:
    """Return the mean AO of the texels if nothing but the ground took light from them.

    None without a ground, and where its distance matters, or not all directions count by their cosine alone.

    It is the mean of (1 + n.u) / 2 with the normals n of the faces and the upward vector u, weighted by their areas in
    the texture; of (1 + |n.u|) / 2 where a face is two-sided.
    """
    scene, atlas, options = baked.scene, baked.atlas, baked.options
    ground = scene.around.ground
    if ground is None or (options.max_distance, options.cone, options.weight, options.sky) != (
        None,
        180,
        "cosine",
        "uniform",
    ):
        return None
    upward = geometric_normals(scene, baked.normals) @ np.asarray(ground.normal)
    upward = np.where(scene.two_sided, np.abs(upward), upward)
    areas = doubled_uv_areas(atlas.uvs) * atlas.mapped
    return float((areas * (1 + upward) / 2).sum() / max(areas.sum(), 1e-30))


def _messages_on_dark_texels(
    baked: Baked, options: BakeOptions, surroundings: Part | None, *, buried: bool
) -> list[str]:
    """Return what keeps texels dark; `surroundings` and what is `buried` are told already, with what to do."""
    dark, parts = baked.dark, baked.dark.parts
    named = surroundings is not None and any(part.name == surroundings.name for part in parts)
    may_be_flipped, encloses = not named and not options.two_sided, dark.inside >= _MIN_DARK
    if may_be_flipped and not encloses and topology(baked.scene.faces).watertight and _signed_volume(baked) < 0:
        return [
            "the mesh is closed and its faces point inwards: its inside was baked; flip the faces, or use --two-sided"
        ]
    if dark.share - (dark.below_ground if buried else 0) < _MIN_DARK:
        return []
    facing_inwards = _percentages((part.name, part.inwards) for part in parts if part.inwards >= part.inside)
    enclosed = _percentages((part.name, part.inside) for part in parts if part.inside > part.inwards)
    causes = [
        (dark.inside, f"enclosed, as inside another part or touching one{enclosed}"),
        (dark.inwards, f"facing inwards{facing_inwards}"),
        (dark.below_ground, "below the ground"),
        (dark.on_ground, "resting on the ground"),
        (dark.above_ground, "facing the ground"),
        (dark.narrow, "in narrow gaps"),
    ]
    found = [(share, cause) for share, cause in causes if share >= _MIN_CAUSE]
    told = ", ".join(f"{share:.1%} {cause}" if len(found) > 1 else cause for share, cause in found)
    lines: list[str] = [Note(f"{dark.share:.1%} of texels are dark (AO below 0.01){f': {told}' if told else ''}")]
    leave_out = "if a part surrounds the others, such as a sky or a room, leave it out with --exclude"
    if may_be_flipped and dark.inwards >= _MIN_INWARDS:
        what = "face inwards: the front of their faces is enclosed, only the back sees out"
        advice = f"{leave_out}; else flip these faces" if encloses else "flip these faces"
        lines.append(f"{dark.inwards:.1%} of texels {what}{facing_inwards}; {advice}, or use --two-sided")
    elif dark.inside >= _MANY and surroundings is None:
        lines.append(f"{dark.inside:.1%} of texels are enclosed: {leave_out}")
    if dark.on_ground + dark.above_ground >= _MANY and options.up == "auto" and baked.scene.up is None:
        lines.append(
            f"{dark.on_ground + dark.above_ground:.1%} of texels face the ground: if another axis points up, name it "
            "with --up"
        )
    return lines


def _signed_volume(baked: Baked) -> float:
    """Return three times the volume that a closed surface encloses, negative where its faces point inwards."""
    scene = baked.scene
    corners = scene.corners - scene.positions.mean(axis=0)
    areas = np.linalg.norm(area_vectors(corners), axis=1) / 2
    return float(np.einsum("fx,fx,f->", corners[:, 0], geometric_normals(scene, baked.normals), areas))
