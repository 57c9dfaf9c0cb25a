"""Coarser levels of the picture: padding keeps them as good as if every chart were filtered by itself."""

import numpy as np

from aoprecalc.api.bake_scene import bake_scene
from aoprecalc.mesh.surface import sample_surface
from aoprecalc.mesh.topology import face_components
from aoprecalc.options import BakeOptions
from aoprecalc.raster.cpu_rasterizer import CPURasterizer
from aoprecalc.raster.layout import CENTER, build_layout, corner_ids
from aoprecalc.texture_lookup import bilinear, mip_chain
from shapes import scene, torus

SIZE, LEVELS = 640, 3


def charts(made, atlas, texture):
    """The chart of each face, and the one that each valid texel belongs to, else -1."""
    of_face = face_components(corner_ids(made.faces, atlas.uvs))
    sampler = CPURasterizer(build_layout(made, atlas, SIZE, SIZE))
    texels = sampler.coverage()
    of_texel = np.full(SIZE * SIZE, -1)
    of_texel[texels.index] = of_face[sampler.samples(texels, CENTER).faces]
    return of_face, np.where(texture.valid, of_texel.reshape(SIZE, SIZE), -1)


def alone(picture, of_texel, chart, uvs):
    """Look up each level of a picture that is filtered over the texels of one chart only."""
    mask = (of_texel == chart).astype(np.float32)
    chains = zip(mip_chain(picture * mask, LEVELS), mip_chain(mask, LEVELS), strict=True)
    return [bilinear(part, uvs, repeats=False) / bilinear(whole, uvs, repeats=False) for part, whole in chains]


def rms(values):
    return np.sqrt((values**2).mean())


def test_two_levels_are_as_good_as_without_seams():
    made = scene(*torus())
    baked = bake_scene(made, BakeOptions(size=SIZE, directions=256, fill="none"))
    assert baked.atlas.gutter >= 8
    of_face, of_texel = charts(made, baked.atlas, baked.texture)
    points = sample_surface(made, baked.atlas.mapped, 20_000, seed=1)
    uvs = points.interpolate(baked.atlas.uvs)
    ideal = np.empty((LEVELS, len(uvs)))
    for chart in range(baked.atlas.charts):
        there = of_face[points.faces] == chart
        ideal[:, there] = alone(baked.texture.values, of_texel, chart, uvs[there])
    found = [bilinear(level, uvs, repeats=False) for level in mip_chain(baked.texture.values, LEVELS)]
    for level in range(1, LEVELS):
        off, least = found[level] - found[0], ideal[level] - found[0]
        assert rms(off) < rms(least) + 0.001
        assert np.abs(off).max() < np.abs(least).max() + 0.01
