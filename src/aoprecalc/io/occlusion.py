"""The ambient occlusion of a mesh: the textures that its file refers to, what they hold, and the mesh of a texture."""

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Self

import numpy as np

from aoprecalc.errors import InputError, counted
from aoprecalc.io.baked_options import (
    baked_certificate,
    baked_files,
    baked_options,
    baked_triangles,
    occlusion_values,
)
from aoprecalc.io.formats.base import PartOcclusion
from aoprecalc.io.formats.files import ImageSource, same_file
from aoprecalc.io.meshes import OUTPUT_MESH_EXTENSIONS, load_scene, part_occlusion
from aoprecalc.options import ValueOptions
from aoprecalc.texture_lookup import join_textures
from aoprecalc.types import BoolArray, Certificate, Float32Array, Float64Array, Scene


def mesh_beside(texture: Path) -> Path | None:
    """Return the mesh beside a picture, as a bake writes them; None where there is none.

    It has the stem of the picture, or that without _ao, if it refers to the picture: else it may be the mesh that was
    read.
    """
    beside = [texture.with_suffix(extension) for extension in OUTPUT_MESH_EXTENSIONS]
    several = re.sub(r"(\.[\w-]+){1,2}$", "", texture.stem)  # without the name and the tile of one of several textures
    stems = [several] if several != texture.stem else []
    stems += [stem[:-3] for stem in (texture.stem, *stems) if stem.lower().endswith("_ao") and len(stem) > 3]
    others = (texture.with_name(each + extension) for each in stems for extension in OUTPUT_MESH_EXTENSIONS)
    beside += (mesh for mesh in others if mesh.is_file() and _refers_to(mesh, texture))
    return next((mesh for mesh in beside if mesh.is_file()), None)


def _refers_to(mesh: Path, texture: Path) -> bool:
    try:
        scene = load_scene(mesh)
        images = [part_occlusion(scene, part).image for part in scene.parts]
    except Exception:  # of a damaged mesh, which is not the one
        return False
    return any(image and same_file(image.path, texture) for image in images)


_GREY = 0.01  # mean difference of the channels of a picture up to which it may be ambient occlusion


class NoOcclusionError(InputError):
    """A mesh has no occlusion texture, or no UVs for one."""


@dataclass(frozen=True, eq=False)
class OcclusionTexture:
    """An ambient occlusion texture and its UVs on a scene.

    name      for messages: the path of its file, where it has one
    path      of that file; None for an image embedded in the mesh's file
    values    (height, width) float32, row 0 at v = 1
    uvs       (f, 3, 2) float64, v upwards, NaN where a face has none
    shown     (f,) bool: the faces that have this texture
    warnings  for the user
    options   those that defined the values when they were baked; None where the files do not say
    others    names of the textures that other faces have
    triangles   how many the mesh had for which it was baked; None where the texture does not say
    strengths   (f,) float32 in [0, 1]: viewers show 1 + strength * (AO - 1); None: 1 everywhere
    files       digests of the files that each of the options named; see `baked_files`
    certificate   of its error; None where it has none; of several textures that of the greatest bound
    """

    name: str
    path: Path | None
    values: Float32Array
    uvs: Float64Array
    shown: BoolArray
    warnings: tuple[str, ...]
    options: ValueOptions | None = None
    others: tuple[str, ...] = ()
    triangles: int | None = None
    strengths: Float32Array | None = None
    files: Mapping[str, Sequence[str]] = field(default_factory=dict)
    certificate: Certificate | None = None


# How badly a texture fits: from the faces that show it, and the options of its bake.
Misfit = Callable[[BoolArray, ValueOptions | None], int]


def find_occlusion(
    scene: Scene,
    texture: Path | Float32Array | None = None,
    misfit: Misfit = lambda shown, options: 0,
    *,
    whole: bool = True,
) -> OcclusionTexture:
    """Return the ambient occlusion of a scene: the file `texture` where it is given, else what the mesh refers to.

    texture   a file, or values (h, w) in [0, 1], which all faces show
    misfit    decides where materials have different textures: that of the least, the first of equals, is the result
    whole     textures of one bake that are joined keep their size; else they may be halved, for pictures

    That is the occlusionTexture of glTF, map_Ka or map_Kd of an OBJ's materials, and the TextureFile of a PLY; without
    any of them, `<stem>.png` beside the mesh. A picture with colours is none, unless glTF or USD says that it is. Where
    materials have different textures, the result is the one that fits best, with the others of its bake as one (see
    `join_occlusion`); or that which is the file `texture`, on its faces only. The UVs are those of the
    occlusionTexture, else the first set. The options of the bake are those that the image itself carries, else those
    beside it in the mesh's file.

    Raises NoOcclusionError where there are no UVs or no texture is found, InputError where it cannot be read.
    """
    stated = _Stated.of(scene)
    if isinstance(texture, np.ndarray):
        return OcclusionTexture("texture", None, texture, stated.uvs, np.ones(len(stated.uvs), bool), ())
    if texture is not None:
        same = (image for image in stated.images if same_file(image.path, texture))
        return stated.read(next(same, ImageSource.of(texture)))
    beside = scene.path.with_suffix(".png")
    images = stated.images or ([ImageSource.of(beside)] if beside.is_file() else [])
    if not images:
        advice = baked_copy(scene.path) or "pass one with --texture"
        raise NoOcclusionError(
            f"{scene.path}: refers to no occlusion texture, and there is no {beside.name} beside it; {advice}"
        )
    possible = [image for image in images if stated.may_be_occlusion(image)]
    if not possible:
        advice = baked_copy(scene.path) or f"bake {scene.path}, or pass its texture with --texture"
        raise NoOcclusionError(f"{images[0].name}: has colours, so it is no ambient occlusion; {advice}")
    best = min(possible, key=lambda image: misfit(stated.shown_by(image), stated.options_of(image)[0]))
    found, options = stated.read(best), stated.options_of(best)[0]
    baked_with_it = [image for image in possible if options is not None and stated.options_of(image)[0] == options]
    if len(baked_with_it) < 2:
        return found
    return join_occlusion([stated.read(image) for image in baked_with_it], found, whole=whole)


def join_occlusion(
    pictures: Sequence[OcclusionTexture], main: OcclusionTexture, *, whole: bool = False
) -> OcclusionTexture:
    """Return the textures of several materials as one; `main` is that of most; for `whole` see `find_occlusion`."""
    different = list[Float32Array]()  # several materials may have the same in pictures of their own
    owners = np.full(len(main.uvs), -1)
    for picture in pictures:
        same = (number for number, values in enumerate(different) if np.array_equal(values, picture.values))
        if (number := next(same, len(different))) == len(different):
            different.append(picture.values)
        owners[picture.shown] = number
    shown = owners >= 0
    warnings = tuple(dict.fromkeys(line for picture in pictures for line in picture.warnings))
    others = tuple(name for name in main.others if name not in {picture.name for picture in pictures})
    certificates = [picture.certificate for picture in pictures if picture.certificate is not None]
    worst = max(certificates, key=lambda one: one.bound) if len(certificates) == len(pictures) else None
    found = replace(main, shown=shown, warnings=warnings, others=others, certificate=worst)
    if len(different) == 1:
        return replace(found, values=different[0])
    joined, uvs = join_textures(different, owners, np.nan_to_num(main.uvs), whole=whole)
    name = f"{main.name} and {counted(len(different) - 1, 'other')}"
    return replace(found, name=name, values=joined, uvs=np.where(np.isfinite(main.uvs), uvs, np.nan))


def every_occlusion(scene: Scene) -> tuple[OcclusionTexture, ...]:
    """Return each occlusion texture that a scene refers to, on its faces; raises as `find_occlusion` does."""
    stated = _Stated.of(scene)
    return tuple(stated.read(image) for image in stated.images if stated.may_be_occlusion(image))


@dataclass(frozen=True, eq=False)
class _Stated:
    """What the file of a scene states: the occlusion of each part, and the sizes of the parts.

    uvs      (f, 3, 2) float64, NaN where a face has none
    images   the different ones
    """

    parts: Sequence[PartOcclusion]
    sizes: Sequence[int]
    uvs: Float64Array
    images: Sequence[ImageSource]

    @classmethod
    def of(cls, scene: Scene) -> Self:
        """Read it; raises NoOcclusionError where there are no UVs."""
        parts = [part_occlusion(scene, part) for part in scene.parts]
        if all(part.uvs is None for part in parts):
            advice = baked_copy(scene.path) or "bake it, or export it with UVs"
            raise NoOcclusionError(f"{scene.path}: has no UVs, which a texture needs; {advice}")
        sizes = [part.stop - part.start for part in scene.parts]
        uvs = [
            np.full((n, 3, 2), np.nan) if part.uvs is None else part.uvs for n, part in zip(sizes, parts, strict=True)
        ]
        images = dict.fromkeys(part.image for part in parts if part.image is not None)
        return cls(parts, sizes, np.concatenate(uvs), list(images))

    def shown_by(self, image: ImageSource) -> BoolArray:
        """Return the faces that show an image, (f,) bool: all, where no part refers to it."""
        return np.repeat([image not in self.images or part.image == image for part in self.parts], self.sizes)

    def options_of(self, image: ImageSource) -> tuple[ValueOptions | None, tuple[str, ...]]:
        """Return the options with which an image was baked, and warnings."""
        return baked_options(image, self._extras(image))

    def _extras(self, image: ImageSource) -> object:
        """Return what the mesh's file says of the bake of an image, as JSON; None if nothing."""
        extras = (part.extras for part in self.parts if part.image == image and part.extras is not None)
        return next(extras, None)

    def may_be_occlusion(self, image: ImageSource) -> bool:
        """Tell whether an image is ambient occlusion, or may be: the file or its bake says so, or it has no colours."""
        stated = any(part.stated for part in self.parts if part.image == image)
        if stated or self.options_of(image)[0] is not None:
            return True
        colors = image.pixels()[:, :, :3]
        return float(np.ptp(colors, axis=2).mean()) <= _GREY

    def read(self, image: ImageSource) -> OcclusionTexture:
        """Read an image; raises InputError where it cannot be used."""
        values, shown = occlusion_values(image), self.shown_by(image)
        if not np.isfinite(values).all():
            raise InputError(f"{image.name}: holds values that are not finite, 0 to 1 were expected; bake it again")
        options, damage = self.options_of(image)
        others = () if shown.all() else tuple(other.name for other in self.images if other != image)
        return OcclusionTexture(
            image.name,
            image.path,
            values,
            self.uvs,
            shown,
            damage,
            options,
            others,
            baked_triangles(image),
            np.repeat([part.strength for part in self.parts], self.sizes).astype(np.float32),
            baked_files(image),
            baked_certificate(image, self._extras(image)),
        )


def baked_copy(mesh: Path) -> str:
    """Return a question about the copy of a mesh that a bake has written beside it; empty where there is none."""
    baked = mesh_beside(mesh.with_name(f"{mesh.stem}_ao.png"))
    return "" if baked in (None, mesh) else f"did you mean {baked}?"
