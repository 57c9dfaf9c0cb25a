"""How often certificates of `--max-error` are right, and what they cost.

    python benchmarks/certificates.py [MESH ...] [--seeds 10] [--json FILE]

Without meshes: the samples of the documentation, and those of ../shared/meshes where it is. Each is baked once,
coarsely, and its error T found with a million points. Then the texture is certified with other seeds: for an error of
exactly T, where at most 5% may succeed, and for 1.25 T, where about all should.
"""

import argparse
import json
import math
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from aoprecalc.api.bake_textures import bake_textures
from aoprecalc.io import load_scene
from aoprecalc.io.images import stored
from aoprecalc.metrics.certificate import BATCH, RenderedErrors, certify
from aoprecalc.options import BakeOptions
from aoprecalc.visibility.integrand import Integrand

ROOT = Path(__file__).resolve().parents[1]
SAMPLES = ("statue.obj", "car.glb", "rock.glb", "robot.stl")
SHARED = (
    "bigguy.obj",
    "jerry_ogre/bs_rest.obj",
    "spot.obj",
    "stanford-bunny.obj",
    "DamagedHelmet/DamagedHelmet.gltf",
    "nasty/chair_model.obj",
)
TRUTH_POINTS = 1 << 20
MORE = 1.25
BAKES, TRUTHS = 0, 1  # first numbers of seeds


def measure(path: Path, seeds: int) -> dict[str, object]:
    """Certify a texture of a mesh again and again."""
    options = BakeOptions(size=256, directions=256, backend="ray", unwrap_timeout=600)
    baked = bake_textures(load_scene(path), options).whole
    integrand = Integrand.from_options(baked.options, baked.scene)
    texture = stored(baked.texture.values, "8")

    def errors(*seed: int) -> RenderedErrors:
        return RenderedErrors(baked.scene, baked.normals, baked.atlas, texture, integrand, seed, 0)

    products = np.concatenate([errors(TRUTHS)(batch) for batch in range(TRUTH_POINTS // BATCH)])
    truth = math.sqrt(products.mean())
    uncertainty = float(products.std() / math.sqrt(len(products)) / products.mean() / 2)
    wrong = [certify(errors(BAKES, 0, seed), truth).holds for seed in range(seeds)]
    started = time.process_time()
    right = [certify(errors(BAKES, 1, seed), truth * MORE) for seed in range(seeds)]
    seconds = (time.process_time() - started) / seeds
    return {
        "mesh": path.name,
        "triangles": len(baked.scene.faces),
        "error": round(truth, 6),
        "uncertainty": round(uncertainty, 4),
        "certified_at_error": sum(wrong),
        "certified_at_more": sum(one.holds for one in right),
        "bounds_right": sum(one.bound >= truth for one in right),
        "seeds": seeds,
        "points": round(float(np.mean([one.points for one in right]))),
        "seconds": round(seconds, 2),
    }


def meshes(folder: Path) -> Iterator[Path]:
    """Make the samples, and yield them and the shared meshes that are there."""
    subprocess.run([sys.executable, ROOT / "docs" / "sample_meshes.py", folder], check=True)
    yield from (folder / name for name in SAMPLES)
    shared = ROOT.parent / "shared" / "meshes"
    yield from (shared / name for name in SHARED if (shared / name).is_file())


def main() -> None:
    """Print a row for each mesh."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("meshes", nargs="*", type=Path)
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--json", type=Path)
    given = parser.parse_args()
    rows = []
    print("mesh, triangles, error T, its uncertainty, certified at T, at 1.25 T, bounds right, seeds, points, seconds")
    with tempfile.TemporaryDirectory() as folder:
        for path in given.meshes or meshes(Path(folder)):
            rows.append(measure(path, given.seeds))
            print(", ".join(map(str, rows[-1].values())), flush=True)
    if given.json is not None:
        given.json.write_text(json.dumps(rows, indent=2) + "\n")


if __name__ == "__main__":
    main()
