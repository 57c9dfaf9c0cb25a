"""What a bake tells the user: warnings of what may need an action, notes of the rest."""

import numpy as np

from aoprecalc.errors import counted, one_or_many
from aoprecalc.mesh.surface import area_vectors, geometric_normals
from aoprecalc.mesh.topology import topology
from aoprecalc.options import BakeOptions
from aoprecalc.progress import Note
from aoprecalc.types import Atlas, Baked, Scene
from aoprecalc.uv.pack import first_unsafe_mip
from aoprecalc.uv.unwrap import warnings_on_uvs

_MIN_DARK = 0.01  # of the texels: a note tells the causes where as many are dark
_MIN_INWARDS = 0.02  # of the texels: a warning where as many are dark and face inwards
_MIN_CAUSE = 0.0005  # of the texels: rarer causes are not told; 0.1% when rounded
_MANY = 0.5  # of the texels: a warning where as many are enclosed, or face the ground
_MAX_NAMES = 5  # of parts in one message


def describe_uvs(atlas: Atlas, padding: int) -> str:
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
    lines += _warn_of_error(baked, options)
    lines += warnings_on_uvs(scene, atlas, overlap)
    if has_narrow_gutters(atlas, options.padding):
        gutters = counted(atlas.gutter or 0, "texel")
        lines.append(
            f"{counted(atlas.charts, 'chart')}, and room for gutters of {gutters} only: charts may mix "
            "from mip level 1 on. Use a larger --size for wider gutters."
        )
    return [*lines, *_notes_on_ground(baked), *_messages_on_dark_texels(baked, options)]


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


def _list(parts: list[str]) -> str:
    names = _shorten([repr(name) for name in parts])
    return f"{counted(len(parts), 'part')} ({names}) {one_or_many(len(parts), 'is', 'are')}"


def _shorten(names: list[str]) -> str:
    more = f" and {len(names) - _MAX_NAMES} more" if len(names) > _MAX_NAMES else ""
    return ", ".join(names[:_MAX_NAMES]) + more


def _warn_of_error(baked: Baked, options: BakeOptions) -> list[str]:
    error, target = baked.sampling_error, options.target_error
    if target is None or (error is not None and error <= target):
        return []
    if error is None:
        return ["the sampling error cannot be estimated from 128 directions or fewer; use more --directions"]
    return [
        f"the estimated sampling error is {error:.4f} after {baked.directions} directions, more than the target of "
        f"{target:g}; use more --directions"
    ]


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
    """Return the mean AO of the texels if nothing but the ground took light from them; None without a ground.

    It is the mean of (1 + n.u) / 2 with the normals n of the faces and the upward vector u, weighted by their areas in
    the texture; of (1 + |n.u|) / 2 where a face is two-sided.
    """
    scene, atlas = baked.scene, baked.atlas
    if scene.ground_normal is None:
        return None
    upward = geometric_normals(scene, baked.normals) @ np.asarray(scene.ground_normal)
    upward = np.where(scene.two_sided, np.abs(upward), upward)
    sides = atlas.uvs[:, 1:] - atlas.uvs[:, :1]
    areas = np.abs(sides[:, 0, 0] * sides[:, 1, 1] - sides[:, 0, 1] * sides[:, 1, 0]) * atlas.mapped
    return float((areas * (1 + upward) / 2).sum() / max(areas.sum(), 1e-30))


def _messages_on_dark_texels(baked: Baked, options: BakeOptions) -> list[str]:
    dark, parts = baked.dark, baked.dark.parts
    if not options.two_sided and topology(baked.scene.faces).watertight and _signed_volume(baked) < 0:
        return [
            "the mesh is closed and its faces point inwards: its inside was baked; flip the faces, or use --two-sided"
        ]
    if dark.share < _MIN_DARK:
        return []
    inwards = _shorten([f"{part.name!r}: {part.inwards:.0%}" for part in parts if part.inwards >= part.inside])
    enclosed = _shorten([f"{part.name!r}: {part.inside:.0%}" for part in parts if part.inside > part.inwards])
    causes = [
        (dark.inside, "enclosed, as inside another part or touching one" + (f" ({enclosed})" if enclosed else "")),
        (dark.inwards, "facing inwards" + (f" ({inwards})" if inwards else "")),
        (dark.on_ground, "resting on the ground"),
        (dark.above_ground, "facing the ground"),
        (dark.narrow, "in narrow gaps"),
    ]
    found = [(share, cause) for share, cause in causes if share >= _MIN_CAUSE]
    told = ", ".join(f"{share:.1%} {cause}" if len(found) > 1 else cause for share, cause in found)
    lines: list[str] = [Note(f"{dark.share:.1%} of texels are dark (AO below 0.01){f': {told}' if told else ''}")]
    if dark.inwards >= _MIN_INWARDS and not options.two_sided:
        lines.append(
            f"{dark.inwards:.1%} of texels face inwards: the front of their faces is enclosed, only the back sees out"
            f"{f' ({inwards})' if inwards else ''}; flip these faces, or use --two-sided"
        )
    if dark.inside >= _MANY:
        lines.append(
            f"{dark.inside:.1%} of texels are enclosed: if a part surrounds the others, such as a sky or a room, leave "
            "it out with --exclude"
        )
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
