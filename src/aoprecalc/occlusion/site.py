"""A scene made ready to be looked at: where its texels lie, on which of its sides, and along which axes."""

from dataclasses import dataclass

from aoprecalc.model import Atlas, Doubles, Floats, Mask, Scene, Texels
from aoprecalc.occlusion.axes import axes, groups, texel_offset
from aoprecalc.occlusion.backend import Backend
from aoprecalc.options import BakeOptions
from aoprecalc.surface.unit import UnitSurface
from aoprecalc.texspace.layout import lay_out
from aoprecalc.texspace.samples import CENTER, Samples, only


@dataclass(frozen=True, eq=False)
class Subject:
    """What is looked at and how, in plain values: whoever has them finds the same texels and sees the same.

    scene     with the roles of its parts; its document does not matter
    atlas     how the texture lies on it
    normals   (f, 3, 3) float32: the shading normals at the corners
    options   of the bake
    """

    scene: Scene
    atlas: Atlas
    normals: Floats
    options: BakeOptions


@dataclass(frozen=True, eq=False)
class Side:
    """One side of the surface.

    surface   turned so that this side is in front
    texels    those that have a value on it
    faces     (f,) bool: samples on others do not count; None: all count
    """

    surface: UnitSurface
    texels: Texels
    faces: Mask | None


class Site:
    """A subject on a backend.

    axes     (a, 3) float64, in groups whose sums are added in their order
    texels   all that the surface covers
    sides    the front, and the back where some faces have one
    """

    def __init__(self, backend: Backend, subject: Subject) -> None:
        """Find the texels."""
        self.backend, self.subject = backend, subject
        scene, options = subject.scene, subject.options
        self._sampler = backend.sampler(lay_out(scene, subject.atlas, options.width, options.height))
        self.axes: Doubles = axes(options.directions, options.sampling, options.seed)
        self.groups = groups(len(self.axes))
        self.texels = self._sampler.coverage()
        self.sides = [Side(UnitSurface.of(scene, subject.normals), self.texels, None)]
        backs = scene.two_sided & scene.receives
        if backs.any() and len(self.texels):
            face = self._sampler.samples(self.texels, CENTER).faces
            behind = self.texels.some((face < 0) | backs[face])
            self.sides.append(Side(self.sides[0].surface.turned(), behind, backs))

    def overlap(self) -> float:
        """Return the share of covered texels whose centre lies inside more than one triangle."""
        return self._sampler.overlap()

    def samples(self, side: Side, held: slice, group: int) -> Samples:
        """Return what lies under a run of a side's texels at the spot of a group of axes."""
        samples = self._sampler.samples(side.texels.some(held), texel_offset(group))
        return samples if side.faces is None else only(samples, side.faces)
