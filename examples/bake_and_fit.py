"""Bakes and fits meshes through the Python interface, as one step of a game's asset build.

Usage: python examples/bake_and_fit.py MESH... -o FOLDER [--size N] [--directions N] [--spheres N]
"""

import argparse
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import aoprecalc


class StageLines(aoprecalc.Progress):
    """Prints one line for each stage, note and warning; a build server's log has no use for moving bars."""

    @contextmanager
    def stage(self, name: str, total: int | None = None, unit: str = "") -> Iterator[None]:
        print(f"  {name}{f', {total} {unit}' if total else ''}")
        yield

    def note(self, text: str) -> None:
        print(f"  {text}")

    def warn(self, text: str) -> None:
        print(f"  warning: {text}")


def build(mesh: Path, folder: Path, bake: aoprecalc.BakeOptions, fit: aoprecalc.SphereOptions) -> None:
    """Write the texture, the mesh with its UVs and the spheres of one mesh, and print what was measured."""
    print(mesh.name)
    loaded = aoprecalc.load(mesh)
    baked = aoprecalc.bake(loaded, bake, progress=StageLines())
    fitted = aoprecalc.fit_spheres(loaded, fit, progress=StageLines())
    baked.save(f"{folder}/", progress=StageLines())
    fitted.save(f"{folder}/")
    seconds = baked.report.seconds["total"]
    print(f"  mean AO {baked.report.ao.mean:.2f}, {len(fitted)} spheres, {seconds:.1f} s")


def main() -> int:
    """Build what the command line names; return 0, or the exit code of what failed."""
    parser = argparse.ArgumentParser(description="Bake and fit meshes for a game.")
    parser.add_argument("meshes", nargs="+", type=Path, metavar="MESH")
    parser.add_argument("-o", "--output", type=Path, default=Path("assets"))
    for name, default in (("size", 512), ("directions", 500), ("spheres", 50)):
        parser.add_argument(f"--{name}", type=int, default=default)
    chosen = parser.parse_args()
    try:
        bake = aoprecalc.BakeOptions(size=chosen.size, directions=chosen.directions, crease_angle=40)
        fit = aoprecalc.SphereOptions(chosen.spheres, samples=20_000)
        for mesh in chosen.meshes:
            build(mesh, chosen.output, bake, fit)
    except aoprecalc.AoprecalcError as error:  # what failed has left no files behind
        print(f"error: {error}", file=sys.stderr)
        return error.exit_code
    return 0


if __name__ == "__main__":
    sys.exit(main())
