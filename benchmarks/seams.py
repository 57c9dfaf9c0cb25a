"""Errors in coarse mip levels caused by chart seams: the errors of a texture's levels and of a seam-free ideal.

    python benchmarks/seams.py MESH_WITH_AO ...

The ideal is ray tracing at the centre of every texel, box-filtered over the texels of the point's own chart only, so
that neither gutters nor other charts contribute. Its remaining error is due to the resolution.
"""

import json
import sys
from pathlib import Path

import numpy as np

from aoprecalc.io import find_occlusion, load_scene
from aoprecalc.mesh.surface import SurfacePoints, face_normals, sample_surface, shading_normals
from aoprecalc.mesh.topology import face_components
from aoprecalc.metrics.errors import error_statistics, errors_per_mip_level
from aoprecalc.metrics.reference import reference_ao
from aoprecalc.options import VerifyOptions
from aoprecalc.progress import Progress
from aoprecalc.raster.cpu_rasterizer import CPURasterizer
from aoprecalc.raster.layout import build_layout, corner_ids
from aoprecalc.types import Atlas

LEVELS = 3
TEXEL_RAYS = 256  # few are enough, as many texels are averaged


def main() -> None:
    """Print a line for each mesh and level."""
    results = []
    for name in sys.argv[1:]:
        results += compare(Path(name))
        for row in results[-LEVELS:]:
            print(f"{row['mesh']:24} level {row['level']}  rmse {row['rmse']:.4f}  seam-free {row['ideal']:.4f}  "
                  f"difference {row['rmse'] - row['ideal']:+.4f}", flush=True)  # fmt: skip
    (Path(__file__).parent / "results" / "seams.json").write_text(json.dumps({"rows": results}, indent=2) + "\n")


def compare(path: Path) -> list[dict[str, object]]:
    """Return a row for each level of one mesh's texture."""
    scene = load_scene(path)
    occlusion = find_occlusion(scene)
    mapped = face_normals(scene.corners)[1]
    normals = shading_normals(scene)
    points = sample_surface(scene, mapped, 20_000, 0)
    reference = reference_ao(scene, normals, points, VerifyOptions(), Progress())
    point_uvs = points.interpolate(occlusion.uvs)
    errors = errors_per_mip_level(occlusion.values, point_uvs, reference, repeats=False, levels=LEVELS)

    charts = np.full(len(scene.faces), -1)
    charts[mapped] = face_components(corner_ids(scene.faces[mapped], occlusion.uvs[mapped]))
    height, width = occlusion.values.shape
    raster = CPURasterizer(build_layout(scene, Atlas("keep", occlusion.uvs, mapped, 0), width, height))
    texels = raster.coverage()
    samples = raster.samples(texels, (0.5, 0.5))
    covered = samples.faces >= 0
    index, faces = texels.index[covered], samples.faces[covered]
    texel_centers = SurfacePoints(faces, samples.weights[covered].astype(float))
    values = reference_ao(scene, normals, texel_centers, VerifyOptions(rays=TEXEL_RAYS), Progress())
    rows = []
    for level, error in enumerate(errors):
        size = (width >> level, height >> level)
        ideal = look_up_by_chart(index, values, charts[faces], point_uvs, charts[points.faces], size, level, width)
        rows.append(
            {"mesh": path.name, "level": level, "rmse": error.rmse, "ideal": error_statistics(ideal - reference).rmse}
        )
    return rows


def look_up_by_chart(index, values, texel_charts, uvs, charts, size, level, width) -> np.ndarray:
    """Look UVs up in a mip level that has, for each chart, the mean of the chart's own texels in each box."""
    box = (index // width >> level) * size[0] + (index % width >> level)
    keys, inverse = np.unique(texel_charts.astype(np.int64) * size[0] * size[1] + box, return_inverse=True)
    means = np.bincount(inverse, values) / np.bincount(inverse)
    x, y = uvs[:, 0] * size[0] - 0.5, (1 - uvs[:, 1]) * size[1] - 0.5
    column, row = np.floor(x).astype(int), np.floor(y).astype(int)
    total, weight = np.zeros(len(uvs)), np.zeros(len(uvs))
    for right in (0, 1):
        for down in (0, 1):
            share = np.abs(1 - right - (x - column)) * np.abs(1 - down - (y - row))
            cell = np.clip(row + down, 0, size[1] - 1) * size[0] + np.clip(column + right, 0, size[0] - 1)
            key = charts.astype(np.int64) * size[0] * size[1] + cell
            at = np.minimum(np.searchsorted(keys, key), len(keys) - 1)
            present = keys[at] == key
            total += np.where(present, share * means[at], 0)
            weight += np.where(present, share, 0)
    return total / np.maximum(weight, 1e-12)


if __name__ == "__main__":
    main()
