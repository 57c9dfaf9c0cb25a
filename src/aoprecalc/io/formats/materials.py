"""What the pictures of a SourceMaterial do to visibility, and its colours."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Generic, TypeVar

import numpy as np

from aoprecalc.errors import InputError
from aoprecalc.io.formats.base import AlphaMode, MeshFormat, SourceMaterial, source_materials
from aoprecalc.io.formats.files import ColorImages, FileSearch
from aoprecalc.io.formats.textures import first_uvs, part_material
from aoprecalc.progress import Note
from aoprecalc.texture_lookup import repeating_texture
from aoprecalc.types import AlphaMask, Atlas, BaseColor, Float32Array, Float64Array, Material, Scene

_OPAQUE = 15 / 16  # opacities from here on count as 1, those below its complement as 0
_CUTOFF = 0.5

M = TypeVar("M", bound=SourceMaterial)


@dataclass(frozen=True, eq=False)
class ExaminedMaterial(Generic[M]):
    """A material whose pictures were looked at, and its opacity map, (h, w) float32, if it has one.

    messages   for the user
    """

    material: M
    opacity: Float32Array | None = None
    messages: tuple[str, ...] = ()

    def at(self, uvs: Float64Array | None) -> Material:
        """Return what matters to visibility, of faces with (n, 3, 2) UVs."""
        made = self.material
        if made.alpha_mode == "MASK" and self.opacity is not None and uvs is not None:
            wraps = (made.placement.wrap, made.placement.wrap)
            mask = AlphaMask(self.opacity, made.placement.transform(uvs), np.ones(uvs.shape[:2]), _CUTOFF, wraps)
            return Material(foliage=made.double_sided, double_sided=made.double_sided, alpha_mask=mask)
        return Material(transparent=made.alpha_mode == "BLEND", double_sided=made.double_sided)


def examine(material: M, *, own_alpha: bool, advice: str) -> ExaminedMaterial[M]:
    """Look at the opacity of a material, and say what it makes of it.

    own_alpha   its opacity map is no more than the alpha of its texture
    advice      how to make an opacity map of that alpha

    An opacity below 1 blends. An opacity map with more texels that are holes than texels between is a mask, else it
    blends. The alpha of a texture, which programs use for other things too, is taken as a mask only.
    """
    label, messages = f"the material {material.name!a}", list[str]()
    if material.opacity == 0:
        messages.append(f"{label} has an opacity of 0, which would hide it: it is taken as opaque")
        material = replace(material, opacity=1.0)
    whole = replace(material, opacity_map=None, alpha_mode="BLEND" if material.opacity < 1 else "OPAQUE")
    image = material.opacity_map
    if image is None:
        return ExaminedMaterial(whole, messages=tuple(messages))
    try:
        opacity = image.opacity(material.opacity_channel)
    except InputError as error:
        if not own_alpha:  # else it is told where the colours are read
            messages.append(f"{label} is taken as opaque: {error}")
        return ExaminedMaterial(whole, messages=tuple(messages))
    if opacity is None or opacity.min() >= _OPAQUE:
        return ExaminedMaterial(whole, messages=tuple(messages))
    is_hole, is_whole = opacity < 1 - _OPAQUE, opacity >= _OPAQUE
    between = np.count_nonzero(~is_hole & ~is_whole)
    is_mask = between <= np.count_nonzero(is_hole) < is_hole.size and material.opacity == 1
    if own_alpha and not is_mask:
        messages.append(f"{label}: the alpha of {image.file_name} is no mask and not used; {advice}")
        return ExaminedMaterial(whole, messages=tuple(messages))
    if own_alpha:
        messages.append(Note(f"{label}: the alpha of {image.file_name} cuts holes into it"))
    mode: AlphaMode = "MASK" if is_mask else "BLEND"
    return ExaminedMaterial(replace(material, alpha_mode=mode), opacity, tuple(messages))


def base_color(
    material: SourceMaterial, uvs: Float64Array | None, images: ColorImages, corners: Float32Array | None = None
) -> BaseColor:
    """Return the colour of a material times its texture at the (n, 3, 2) UVs of a part.

    corners   the colours of the vertices
    """
    texture = None if material.texture is None or uvs is None else images.get(material.texture)
    if texture is None or uvs is None:
        return BaseColor(material.factor(textured=False), corners=corners)
    wraps = (material.placement.wrap, material.placement.wrap)
    texture, uvs = repeating_texture(texture, material.placement.transform(uvs), wraps)
    return BaseColor(material.factor(textured=True), texture, uvs, corners)


def picture_search(path: Path) -> FileSearch:
    """Return a search for pictures beside a file, and in the folders where packs of assets have them."""
    folder = path.parent
    folders = (folder / "textures", folder / "images", folder.parent / "textures", folder / f"{path.stem}.fbm")
    return FileSearch(folder, *folders)


class PicturedFormat(MeshFormat):
    """A format that is read by a library and written as GLB; its scenes have a SourceDocument with materials."""

    def source_files(self, scene: Scene) -> list[Path]:
        """Return the file and the pictures of its materials."""
        images = (image for used in source_materials(scene).values() for image in (used.texture, used.opacity_map))
        return [scene.path, *dict.fromkeys(image.path for image in images if image and image.path)]

    def output_extension(self, scene: Scene, atlases: Sequence[Atlas]) -> tuple[str, str]:
        """Return .glb."""
        return ".glb", f"{self.name} is not written, so the mesh becomes a GLB"

    def base_colors(self, scene: Scene, images: ColorImages, occlusion: Path | None) -> tuple[BaseColor, ...]:
        """Return the colour of each part's material, with its picture."""
        known, plain = source_materials(scene), SourceMaterial("")
        materials = [known.get(part_material(part) or "", plain) for part in scene.parts]
        return tuple(
            base_color(used, first_uvs(scene, part), images) for used, part in zip(materials, scene.parts, strict=True)
        )
