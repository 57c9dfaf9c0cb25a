"""The tables of the documentation, made from what the benchmarks measured last.

    python benchmarks/result_tables.py

Reads benchmarks/results/*.json; writes every table into docs/explanation/benchmarks.md and a selection of the same rows
into README.md, each between the marks `<!-- NAME: ... -->` and `<!-- end of NAME -->`.
"""

import itertools
import json
import math
import re
import statistics
from pathlib import Path

Row = dict[str, object]

ROOT = Path(__file__).resolve().parents[1]
RESULTS = ROOT / "benchmarks" / "results"
PAGE, README = ROOT / "docs" / "explanation" / "benchmarks.md", ROOT / "README.md"

BAR = 64  # Cycles' samples at whose error times are compared
LONG = 5.0  # seconds of a bake that is run once
USUAL = 100  # spheres, where only one number of them is told
METHODS = ("lloyd", "algebraic", "shadow", "collision", "MorphIt-B")
# What README.md shows, by the first columns of a table's row: losses as well as gains.
FIDELITY_SHOWN = ("ogre/smooth/gl", "ogre/smooth/cycles", "bunny/smooth/gl", "bunny/smooth/cycles")
FIDELITY_SHOWN += ("fruit fly/smooth/gl",)
FIDELITY_COLUMNS = ("mesh", "texels", "shading", "baked by", "seconds", "RMSE", "p99", "mip 2")
SPHERES_COLUMNS = ("silhouette IoU of", "spheres", "lloyd", "shadow", "collision", "MorphIt-B")


def main() -> None:
    """Write the tables into the two pages."""
    for page, tables in ((PAGE, full_tables()), (README, selected_tables())):
        text = page.read_text("utf-8")
        for name, lines in tables.items():
            text = with_table(text, name, lines)
        page.write_text(text, "utf-8")


def with_table(text: str, name: str, lines: list[str]) -> str:
    """Return the text of a page with new lines between the marks of a table."""
    start, end = f"<!-- {name}: made by benchmarks/result_tables.py -->\n", f"<!-- end of {name} -->"
    if not (start in text and end in text):
        raise ValueError(f"no marks of the table {name}: expected {start.strip()} and {end}")
    before, _, rest = text.partition(start)
    return before + start + "\n".join(lines) + "\n" + end + rest.partition(end)[2]


def full_tables() -> dict[str, list[str]]:
    """Return the lines of every table, by name."""
    spheres = results("spheres")["rows"]
    parts = {part: [row for row in spheres if row["key"].split("/")[0] == part] for part in ("quality", "kmeans")}
    return {
        "fidelity": fidelity_table(results("fidelity")["rows"]),
        "seams": seams_table(results("seams")["rows"]),
        "speed": speed_table(results("speed")["points"]),
        "growth": growth_table(results("speed")["growth"]),
        "distance": distance_table(results("blender_distance")["rows"]),
        "batch": batch_table(results("batch")),
        "report page": report_table(results("report")),
        "sphere quality": quality_table(parts["quality"]),
        "sphere counts": counts_table(parts["quality"]),
        "lloyd speed": lloyd_table(parts["kmeans"]),
        "collision": collision_table([row for row in spheres if row["key"].startswith("collision/")]),
    }


def selected_tables() -> dict[str, list[str]]:
    """Return the lines of the tables of README.md, by name: rows and columns of the full ones."""
    rows = [row for row in results("fidelity")["rows"] if row["key"] in FIDELITY_SHOWN]
    quality = [row for row in results("spheres")["rows"] if row["key"].startswith("quality/")]
    counts = counts_table([row for row in quality if row["spheres"] == USUAL])
    return {
        "fidelity": columns(fidelity_table(rows), FIDELITY_COLUMNS),
        "spheres": columns(counts, SPHERES_COLUMNS),
        "speed": speed_table(results("speed")["points"]),
    }


def results(name: str) -> dict[str, list[Row]]:
    """Return what a benchmark measured last."""
    return json.loads((RESULTS / f"{name}.json").read_text("utf-8"))


def cells(line: str) -> list[str]:
    """Return the texts of the cells of a line."""
    return [cell.strip() for cell in line.strip().strip("|").split("|")]


def columns(lines: list[str], names: tuple[str, ...]) -> list[str]:
    """Return a table with the columns of these names only."""
    chosen = [cells(lines[0]).index(name) for name in names]
    return [f"| {' | '.join(cells(line)[column] for column in chosen)} |" for line in lines]


def table(*heading: str) -> list[str]:
    """Return the first two lines of a table."""
    return [f"| {' | '.join(heading)} |", f"|{'---|' * len(heading)}"]


def fidelity_table(rows: list[Row]) -> list[str]:
    """Lay out the errors of textures as rendered."""
    lines = table("mesh", "triangles", "texels", "shading", "baked by", "seconds", "RMSE", "p50", "p95", "p99", "mip 1",
                  "mip 2")  # fmt: skip
    for row in rows:
        tool = re.sub(r"^Blender \S+ ", "", row["tool"])
        errors = " | ".join(f"{row[name]:.4f}" for name in ("rmse", "p50", "p95", "p99", "mip1", "mip2"))
        lines.append(
            f"| {row['mesh']} | {row['triangles']:,} | {row['size']}² | {row['shading']} | {tool} | "
            f"{row['seconds']:.1f} | {errors} |"
        )
    return lines


def seams_table(rows: list[Row]) -> list[str]:
    """Lay out the errors at mip levels beside those of a mip chain that no seam disturbs."""
    lines = table("mesh", "mip level", "RMSE", "RMSE without seams")
    for row in rows:
        mesh = row["mesh"].removesuffix("_ao.obj")
        lines.append(f"| {mesh} | {row['level']} | {row['rmse']:.4f} | {row['ideal']:.4f} |")
    return lines


def speed_table(points: list[Row]) -> list[str]:
    """Lay out, for each mesh, what each tool needs for the error of Cycles' 64 samples."""
    lines = table("mesh", "shading", "RMSE", "Cycles", "aoprecalc, maps", "times faster", "aoprecalc, rays", "memory")
    for key in dict.fromkeys(row["key"] for row in points):
        rows = [row for row in points if row["key"] == key]
        bar = next((row for row in rows if row["tool"] == "cycles" and row["effort"] == BAR), None)
        if bar is None:
            continue
        maps, traced = (time_at([row for row in rows if row["tool"] == tool], bar["rmse"]) for tool in ("gl", "ray"))
        most = max(row["megabytes"] for row in rows if row["tool"] == "gl" and row["seconds"] < LONG)
        mesh, shading = key.split("/")
        lines.append(
            f"| {mesh} | {shading} | {bar['rmse']:.4f} | {bar['seconds']:.1f} s | {maps:.2f} s | "
            f"{bar['seconds'] / maps:.1f} | {traced:.1f} s | {most:.0f} MB, Cycles {bar['megabytes']:.0f} MB |"
        )
    return lines


def time_at(rows: list[Row], error: float) -> float:
    """Return the seconds at which an error is reached, between the two nearest of the rows; nan beyond them."""
    rows = sorted(rows, key=lambda row: row["rmse"])
    for low, high in itertools.pairwise(rows):
        if low["rmse"] <= error <= high["rmse"]:
            share = math.log(error / low["rmse"]) / math.log(high["rmse"] / low["rmse"])
            return low["seconds"] ** (1 - share) * high["seconds"] ** share
    return math.nan


def distance_table(rows: list[Row]) -> list[str]:
    """Lay out bakes with a maximum distance beside Cycles': of as many rays, and of the same error."""
    lines = table("scene", "distance", "bias, Cycles", "bias, rays", "RMSE, Cycles", "RMSE, rays", "s, Cycles",
                  "s, rays", "ratio", "s, rays, same RMSE", "ratio")  # fmt: skip
    for scene, percent in dict.fromkeys((row["scene"], row["percent"]) for row in rows):
        own = [row for row in rows if (row["scene"], row["percent"]) == (scene, percent)]
        theirs = next(row for row in own if row["tool"] == "cycles")
        ours = sorted((row for row in own if row["tool"] == "rays"), key=lambda row: row["effort"])
        pair = theirs, next(row for row in ours if row["effort"] == 2 * theirs["effort"])
        reached, equal = "", time_at(ours, theirs["rmse"])
        if math.isnan(equal):  # even the fewest directions are better, or the most are not as good
            fewest = ours[0]["rmse"] < theirs["rmse"]
            reached, equal = ("below ", ours[0]["seconds"]) if fewest else ("above ", ours[-1]["seconds"])
        numbers = [f"{row['bias']:+.4f}" for row in pair] + [f"{row['rmse']:.4f}" for row in pair]
        numbers += [f"{row['seconds']:.2f}" for row in pair] + [f"{pair[1]['seconds'] / theirs['seconds']:.2f}"]
        numbers += [f"{reached}{seconds:.2f}" for seconds in (equal, equal / theirs["seconds"])]
        lines.append(f"| {scene} | {percent}% | {' | '.join(numbers)} |")
    return lines


def growth_table(rows: list[Row]) -> list[str]:
    """Lay out time and memory of bakes of growing size, each kind with the slopes of both."""
    lines = table("growing", "triangles", "texels", "directions", "seconds", "memory")
    for what in dict.fromkeys(row["what"] for row in rows):
        kind = [row for row in rows if row["what"] == what]
        for row in kind:
            lines.append(
                f"| {what} | {row['triangles']:,} | {row['size']}² | {row['directions']:,} | "
                f"{row['seconds']:.1f} | {row['megabytes']:,.0f} MB |"
            )
        lines.append(
            f"| {what}, slope | | | | {slope(kind, what, 'seconds'):.2f} | {slope(kind, what, 'megabytes'):.2f} |"
        )
    return lines


def slope(rows: list[Row], of: str, value: str) -> float:
    """Return the exponent that a value grows with: the slope of the line fitted to both logarithms."""
    x, y = ([math.log(row[key]) for row in rows] for key in (of, value))
    return statistics.linear_regression(x, y).slope


def batch_table(found: dict[str, object]) -> list[str]:
    """Lay out the seconds of batches."""
    seconds, ratios, assets = found["seconds"], found["ratios"], f"{found['assets']} assets"
    return [
        *table("what", "seconds"),
        f"| {assets}, one `aoprecalc bake` after the other | {seconds['single']:.0f} |",
        f"| {assets}, `aoprecalc batch --jobs 2` | {seconds['jobs']:.0f} ({ratios['jobs / single']:.2f} of it) |",
        f"| {assets}, `aoprecalc batch --scheduler` with two Dask workers | {seconds['scheduler']:.0f} |",
        f"| cost of the batch beyond the work, an asset | {seconds['overhead']:.2f} |",
        f"| {found['unchanged_assets']} assets, none of them changed | {seconds['unchanged']:.1f} |",
    ]


def report_table(found: dict[str, object]) -> list[str]:
    """Lay out the size of a report page of many assets, and the seconds until it can be used."""
    seconds = found["seconds"]
    return [
        *table(f"page of {found['assets']} assets", ""),
        f"| size | {found['bytes'] / 1e6:.1f} MB |",
        f"| `aoprecalc report` writes it, time of the processor | {seconds['write']:.0f} s |",
        f"| opened in Chromium, until the table reacts to a click | {seconds['interactive']:.2f} s |",
        f"| until all of it is read | {seconds['load']:.2f} s |",
        f"| from a click on an asset until its 3D view is drawn, without a GPU | {seconds['view']:.2f} s |",
    ]


def quality_table(rows: list[Row]) -> list[str]:
    """Lay out all measures of sphere sets at the usual number of spheres."""
    lines = table("mesh", f"{USUAL} spheres by", "seconds", "silhouette IoU", "worst view", "leak", "spill",
                  "surface error")  # fmt: skip
    for row in rows:
        if row["spheres"] != USUAL:
            continue
        tool = row["method"] if row["made"] == USUAL else f"{row['method']} ({row['made']} spheres)"
        numbers = " | ".join(f"{row[what]:.3f}" for what in ("silhouette_iou", "silhouette_iou_min", "leak", "spill"))
        lines.append(f"| {row['mesh']} | {tool} | {row['seconds']:.1f} | {numbers} | {row['surface_error_mean']:.4f} |")
    return lines


def counts_table(rows: list[Row]) -> list[str]:
    """Lay out the silhouettes of each method for meshes and numbers of spheres."""
    lines = table("silhouette IoU of", "spheres", *METHODS)
    found = {(row["mesh"], row["spheres"], row["method"]): f"{row['silhouette_iou']:.3f}" for row in rows}
    for mesh, count in dict.fromkeys((row["mesh"], row["spheres"]) for row in rows):
        numbers = " | ".join(found.get((mesh, count, method), "") for method in METHODS)
        lines.append(f"| {mesh} | {count} | {numbers} |")
    return lines


def lloyd_table(rows: list[Row]) -> list[str]:
    """Lay out Lloyd's iteration beside scikit-learn's."""
    lines = table("mesh", "iterations", "seconds", "scikit-learn", "times faster", "relative difference of inertia")
    for row in rows:
        iterations, apart = row["iterations"], abs(row["inertia"] / row["their_inertia"] - 1)
        if row["their_iterations"] != iterations:
            iterations = f"{iterations}, {row['their_iterations']}"
        lines.append(
            f"| {row['mesh']} | {iterations} | {row['seconds']:.2f} | {row['their_seconds']:.2f} | "
            f"{row['ratio']:.1f} | {apart:.0e} |"
        )
    return lines


def collision_table(rows: list[Row]) -> list[str]:
    """Lay out what collision spheres hold, and spill, beside Lloyd's with radius cover."""
    lines = table("mesh", "held by collision", "held by lloyd, cover", "spill of collision", "spill of lloyd, cover")
    for row in rows:
        held = " | ".join(f"{100 * row[what]:.2f}%" for what in ("held", "cover_held"))
        lines.append(f"| {row['mesh']} | {held} | {row['spill']:.3f} | {row['cover_spill']:.3f} |")
    return lines


if __name__ == "__main__":
    main()
