"""Builds all meshes of a project through the Python interface, each only when it has changed.

Usage: python examples/build_assets.py PATTERN... -o FOLDER [--size N] [--directions N] [--golden TEXTURE]

PATTERN is a mesh, a folder, or a name with *, ? and **. The golden texture is an approved one of an earlier build,
such as golden/colonnade_ao.png.
"""

import argparse
import sys
from pathlib import Path

import aoprecalc


class AssetLines(aoprecalc.BatchProgress):
    """Prints a line for each asset, with the share of the build that is done."""

    def begin(self, total: int) -> None:
        self.total, self.done = total, 0

    def end(self, result: aoprecalc.AssetResult) -> None:
        self.done += 1
        said = result.failure.message if result.failure else f"{result.seconds:.1f} s"
        print(f"{self.done:>4} of {self.total}  {result.status:<9}  {result.asset.name}  {said}")

    def warn(self, text: str) -> None:
        print(f"warning: {text}")


def build(patterns: list[str], folder: Path, size: int, directions: int) -> aoprecalc.BatchResult:
    """Make a texture and spheres of every mesh, and print what the report says of them."""
    result = aoprecalc.batch(
        patterns,
        folder,
        bake=aoprecalc.BakeOptions(size=size, directions=directions, crease_angle=40),
        spheres=aoprecalc.SphereOptions(50, samples=20_000),
        options=aoprecalc.BatchOptions(timeout=600),
        progress=AssetLines(),
    )
    counts = result.report.counts.to_dict()
    print(", ".join(f"{count} {status}" for status, count in counts.items() if count))
    return result


def check(golden: Path, outputs: list[Path]) -> bool:
    """Print whether the output of the same name as a golden texture still equals it within a tolerance; return that."""
    named = [output for output in outputs if output.name == golden.name]
    if not named:
        print(f"no output is called {golden.name}")
        return False
    compared = aoprecalc.compare(golden, named[0], aoprecalc.CompareOptions(tolerance=0.005))
    print(f"{named[0]} and {golden}: {compared.answer}")
    return compared.passed


def main() -> int:
    """Build what the command line names; return 0, 1 if an asset or the comparison failed, or the code of an error."""
    parser = argparse.ArgumentParser(description="Build the meshes of a project.")
    parser.add_argument("patterns", nargs="+", metavar="PATTERN")
    parser.add_argument("-o", "--output", type=Path, default=Path("assets"))
    parser.add_argument("--size", type=int, default=512)
    parser.add_argument("--directions", type=int, default=500)
    parser.add_argument("--golden", type=Path, metavar="TEXTURE")
    chosen = parser.parse_args()
    try:
        result = build(chosen.patterns, chosen.output, chosen.size, chosen.directions)
        outputs = [Path(output) for asset in result.report.assets for output in asset.outputs]
        same = chosen.golden is None or check(chosen.golden, outputs)
    except aoprecalc.AoprecalcError as error:  # nothing was asked for that can be made
        print(f"error: {error}", file=sys.stderr)
        return error.exit_code
    return 0 if result.passed and same else 1


if __name__ == "__main__":
    sys.exit(main())
