"""Results of three assets, whose report the tests open: one is verified and has spheres, one has materials, one failed.

An earlier run of other options has one asset more, which is gone since.
"""

import sys
from pathlib import Path
from subprocess import run

from docs.sample_meshes import car

from aoprecalc.api.report import write_report
from shapes import bowl, torus

NEW, OLD = "--size 128 -n 200", "--size 64 -n 64 --ground"


def write_obj(path, shape, *, group=None):
    """An OBJ of a shape, all of it in one group."""
    positions, faces = shape
    lines = [f"g {group}"] if group else []
    lines += [f"v {x:.6g} {y:.6g} {z:.6g}" for x, y, z in positions]
    lines += [f"f {a} {b} {c}" for a, b, c in faces + 1]
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("\n".join(lines) + "\n")


def command(folder, *words, code=0):
    """Run `aoprecalc` in a folder, as users do."""
    done = run([sys.executable, "-m", "aoprecalc", *words], cwd=folder, capture_output=True, text=True, check=False)
    assert done.returncode == code, done.stderr


def make_runs(folder):
    """Bake, fit and verify in a folder: its `old` and `new`."""
    meshes = folder / "meshes"
    write_obj(meshes / "bowl.obj", bowl())
    car().export(meshes / "car.glb")
    (meshes / "broken.obj").write_text("v 0 0 0\nv 1 0 0\nf 1 2 3\n")
    write_obj(meshes / "gone.obj", torus(around=12, across=8))
    batch = ["batch", "meshes", "--no-cache", "-j", "1"]
    command(folder, *batch, "-o", "old", "--report", "old/batch.json", "--bake", OLD, code=1)
    (meshes / "gone.obj").unlink()
    spheres = ["--spheres", "-n 12 -s 2000"]
    command(folder, *batch, "-o", "new", "--report", "new/batch.json", "--bake", NEW, *spheres, code=1)
    measured = ["--report", "bowl_verify.json", "--heat-map", "bowl_heat_map.png"]
    command(folder / "new", "verify", "bowl_ao.obj", "--points", "2000", "--rays", "64", *measured)


def make_report(folder):
    """The page of the three assets, with what has changed since the earlier run."""
    make_runs(folder)
    return write_report(folder / "new", folder / "report.html", before=folder / "old").path


def make_hostile_report(folder):
    """The page of a mesh whose names are HTML and scripts; each would set `window.harmed`."""
    name = "<img src=x onerror=harmed=1>"
    group = "</script><script>harmed=1</script><svg/onload=harmed=1>\" onfocus=harmed=1 autofocus x='{{7*7}}'"
    write_obj(folder / f"{name}.obj", torus(around=12, across=8), group=group)
    command(folder, "bake", f"{name}.obj", "-o", "out/", "--size", "64", "-n", "64", "--report", "out/x_report.json")
    return write_report(folder / "out", folder / "hostile.html", title=f"</title>{group}").path


if __name__ == "__main__":
    print(make_report(Path(sys.argv[1])))
