"""What surrounds a mesh where it will stand, from files that the options name: meshes that occlude it, and its sky."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from aoprecalc.errors import InputError, counted, listed, one_or_many, option_name
from aoprecalc.io import load_scene
from aoprecalc.io.baked_options import file_digest
from aoprecalc.io.images import read_pixels
from aoprecalc.io.occlusion import OcclusionTexture
from aoprecalc.mesh.opaque_triangles import opaque_pieces
from aoprecalc.mesh.roles import finest_level
from aoprecalc.mesh.surface import bounding_box, box_distance, diagonal, positions_of
from aoprecalc.options import ValueOptions, VerifyOptions
from aoprecalc.options.fields import named_files, with_files
from aoprecalc.progress import Note
from aoprecalc.texture_lookup import linear_from_srgb
from aoprecalc.types import REVERSED_WINDING, Float32Array, Float64Array, Scene
from aoprecalc.visibility.sky import sky_image

_HARDLY_ANY = 1e-3  # of the light that a file takes: a quarter of a step of 8 bits
_LINEAR = (".hdr", ".exr", ".tif", ".tiff")  # images of radiance


def with_surroundings(scene: Scene, options: ValueOptions) -> Scene:
    """Return the scene with its sky and the triangles of the files that occlude it, and messages about these files.

    scene     with the roles of its parts; see `assign_roles`
    options   `occluder` names the files, each in the units and axes of the scene. Of a file its finest level of detail
              counts, without collision hulls unless `all_parts`, and without transparent materials unless
              `glass_occludes`; alpha masks have their holes

    Raises InputError where a file is missing, damaged or has no faces, or a sky no light, and UsageError for an unknown
    extension.
    """
    if "sky" in named_files(options):
        scene = replace(scene, around=replace(scene.around, sky=_read_sky(Path(options.sky))))
    if not options.occluder:
        return scene
    triangles, warnings, notes = list[Float64Array](), list[str](), list[str]()
    for path in options.occluder:
        other = load_scene(path)
        found, backs = _occluding_triangles(other, options)
        triangles += [found, backs]
        warnings += [*other.warnings, *differences(scene, other)]
        notes += [*other.notes, _note_on_occluder(scene, other, found)]
    return replace(
        scene,
        around=replace(scene.around, occluders=np.concatenate(triangles)),
        warnings=(*scene.warnings, *warnings),
        notes=(*scene.notes, *notes),
    )


def _note_on_occluder(scene: Scene, other: Scene, triangles: Float64Array) -> Note:
    """Note that a file occludes, and where it is so far away that it hardly does.

    What lies in a sphere of radius r takes at most (r / d)^2 of the light of a point at the distance d from its centre.
    """
    found = f"{other.path.name}: occludes with {counted(len(triangles), 'triangle')}"
    if not len(triangles):
        return Note(found)
    box = bounding_box(triangles)
    gap, radius = box_distance(bounding_box(positions_of(scene, scene.receives)), box), diagonal(box) / 2
    if radius**2 >= _HARDLY_ANY * gap**2:
        return Note(found)
    return Note(f"{found}, but is {gap:.3g} away and takes less than {_HARDLY_ANY:.1%} of the light")


def _read_sky(path: Path) -> Float32Array:
    """Return the image of a sky, see `sky_image`; pictures of 8 or 16 bits are taken as sRGB."""
    pixels = read_pixels(path)
    if path.suffix.lower() not in _LINEAR:
        pixels = linear_from_srgb(pixels)
    if not np.isfinite(pixels).all():
        raise InputError(f"{path}: has pixels that are not finite, an image of a sky was expected; save it again")
    if pixels.shape[2] in (2, 4):
        pixels = pixels[:, :, :-1]
    if not pixels.max() > 0:
        raise InputError(f"{path}: is black, an image of a sky was expected; use another")
    height, width = pixels.shape[:2]
    if width != 2 * height:
        raise InputError(
            f"{path}: has {width} x {height} pixels; an equirectangular image was expected, twice as wide as it is high"
        )
    return sky_image(pixels)


def _occluding_triangles(scene: Scene, options: ValueOptions) -> tuple[Float64Array, Float64Array]:
    """Return the triangles of a file that occlude, (o, 3, 3), and the backs, (b, 3, 3), of those with two sides.

    Where faces occlude only what is in front of them, sheets have both; else there are no backs.
    """
    if not options.all_parts:
        scene = finest_level(scene)[0]
    parts = (
        replace(part, occludes=options.glass_occludes or not part.material.transparent, receives=True)
        for part in scene.parts
    )
    triangles, faces = opaque_pieces(replace(scene, parts=tuple(parts)))
    if options.backfaces == "occlude":
        return triangles, triangles[:0]
    double = scene.per_face(part.material.foliage or part.material.double_sided for part in scene.parts)[faces]
    return triangles, triangles[double][:, REVERSED_WINDING]


def differences(scene: Scene, other: Scene) -> Iterator[str]:
    """Yield warnings about units and axes that differ: numbers are taken as they are."""
    for what, own, its in (("up axis", scene.up, other.up), ("unit in metres", scene.unit, other.unit)):
        if own is not None and its is not None and own != its:
            found = f"{other.path.name}: its {what} is {its}, that of {scene.path.name} is {own}"
            yield f"{found}; both are taken as they are written, export them alike"


def files_beside(options: ValueOptions, given: VerifyOptions, scene: Scene, texture: OcclusionTexture) -> ValueOptions:
    """Return the options of a bake with paths beside the mesh for the names of files, which are all that a texture has.

    given     options that were given instead, with paths

    Raises InputError that names all files that are not there, or are others than those of the bake, and where several
    have one name.
    """
    own = {name: getattr(options, name) for name in named_files(options) if getattr(given, name) is not None}
    found = replace(with_files(options, lambda name: str(scene.path.parent / name)), **own)
    missing, others, asked = list[str](), list[str](), list[tuple[str, ...]]()
    for option, paths in named_files(found).items():
        if option in own:
            continue
        names = [Path(path).name for path in paths]
        if len(set(names)) < len(names):
            several, advice = max(names, key=names.count), f"give the paths with {option_name(option)}"
            raise InputError(f"{texture.name}: was baked with several files named {several}; {advice}")
        lost = [
            f"{option_name(option)} {name}" for path, name in zip(paths, names, strict=True) if not Path(path).is_file()
        ]
        other = [
            f"{option_name(option)} {name}"
            for path, name, digest in zip(paths, names, texture.files.get(option, ()), strict=False)
            if Path(path).is_file() and digest and file_digest(path) not in ("", digest)
        ]
        missing, others = missing + lost, others + other
        asked += [paths] if lost or other else []
    if not asked:
        return found
    folder = f"in the folder of {scene.path}"
    told = [f"{listed(missing)}, which {one_or_many(len(missing), 'is', 'are')} not {folder}"] if missing else []
    if others:
        found_there = one_or_many(len(others), "another is", "others are")
        told.append(f"{listed(others)}, but {found_there} {'there' if missing else folder}")
    files = sum(map(len, asked))
    which = one_or_many(files, "its path", f"the paths of all {files} files")
    advice = f"give the {one_or_many(len(asked), 'option', 'options')} with {which}"
    raise InputError(f"{texture.name}: was baked with {', and with '.join(told)}; {advice}")
