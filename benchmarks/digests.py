"""Digests of everything that the commands write, to see whether a change of the code changes a result.

    python benchmarks/digests.py -o before.json          run all commands, keep a digest of each file
    python benchmarks/digests.py --against before.json   run them again, name each file that differs

Every run works in a folder of its own on meshes from `examples/`. A text is reduced to what stays the same between two
equal runs: JSON loses `seconds` and the wording of warnings (their number stays), and no path depends on the machine. A
picture has two digests: of its file, and of its pixels alone.
Digests depend on the renderer, so compare two runs on one machine. PYTHONPATH=OTHER/src runs another checkout.
"""

import argparse
import hashlib
import json
import shlex
import subprocess
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parent.parent
SMALL = "--size 128 -n 128"
FEW = "-n 12 -s 4000"

# name -> commands, run one after the other in one folder that also holds the meshes.
RUNS: dict[str, tuple[str, ...]] = {
    "bake obj": (f"bake colonnade.obj {SMALL} --report report.json",),
    "bake ply": (f"bake rings.ply {SMALL} --report report.json",),
    "bake stl": (f"bake arches.stl {SMALL} --report report.json",),
    "bake off": (f"bake rings.off {SMALL} --report report.json",),
    "bake glb": (f"bake terrace.glb {SMALL} --report report.json",),
    "bake gltf": (f"bake terrace.glb {SMALL} --mesh-output terrace_ao.gltf",),
    "bake obj to glb": (f"bake colonnade.obj {SMALL} --mesh-output out.glb",),
    "bake obj to ply": (f"bake colonnade.obj {SMALL} --mesh-output out.ply",),
    "bake ply to obj": (f"bake rings.ply {SMALL} --mesh-output out.obj",),
    "bake rays": ("bake rings.ply --size 64 -n 64 --backend ray --report report.json --verify",),
    "bake mean": (f"bake colonnade.obj {SMALL} --estimator mean --fill pushpull",),
    "bake random": (f"bake rings.ply {SMALL} --sampling random --seed 7 --fill none --padding 2",),
    "bake exr": (f"bake rings.ply {SMALL} -o picture.exr",),
    "bake tif": (f"bake rings.ply {SMALL} -o picture.tif --bit-depth 16",),
    "bake wide": ("bake colonnade.obj --size 256x64 -n 128 --shadow-size 256",),
    "bake two sides": (f"bake rings.ply {SMALL} --two-sided --normals flat --json",),
    "bake ground": (f"bake arches.stl {SMALL} --ground --crease-angle 60 --report report.json",),
    "bake uvunwrap": (f"bake colonnade.obj {SMALL} --unwrap uvunwrap --report report.json",),
    "bake kept": (f"bake colonnade.obj {SMALL}", "bake colonnade_ao.obj --size 96 -n 64 --unwrap keep --report r.json"),
    "bake instances": (f"bake terrace.glb {SMALL} --instances share --report report.json",),
    "bake roles": (f"bake terrace.glb {SMALL} --only 'chair*' --exclude pot --glass-occludes --report report.json",),
    "bake orm": (f"bake terrace.glb {SMALL}", f"bake terrace_ao.glb {SMALL} --pack orm --unwrap auto"),
    "bake target": ("bake rings.ply --size 64 -n 512 --target-error 0.02 --report report.json",),
    "bake memory": ("bake rings.ply --size 256 -n 64 --memory-limit 4G",),
    "bake whole": ("bake colonnade.obj --size 512 -n 400 --crease-angle 40 --report report.json --verify",),
    "spheres lloyd": (
        f"spheres colonnade.obj {FEW}",
        f"spheres colonnade.obj {FEW} --radius cover --init kmeans++ -o b.csv",
    ),
    "spheres algebraic": (
        f"spheres rings.ply {FEW} --method algebraic",
        f"spheres rings.ply {FEW} --radius uniform -o u.npz",
    ),
    "spheres shadow": (
        f"spheres arches.stl {FEW} --method shadow -o shadow.glb",
        "spheres rings.ply --method shadow -n 8",
    ),
    "spheres collision": (f"spheres rings.ply {FEW} --method collision -o c.urdf",),
    "spheres formats": tuple(f"spheres rings.ply -n 5 -s 500 -o out.{kind}" for kind in ("obj", "ply", "yml", "usda")),
    "spheres tolerance": ("spheres rings.ply --tolerance 0.05 -s 2000",),
    "spheres levels": ("spheres rings.ply --levels 2,6,18 -s 2000",),
    "spheres measure": (f"spheres rings.ply {FEW}", "spheres rings.ply --measure rings_spheres.json --json"),
    "verify": (
        f"bake colonnade.obj {SMALL}",
        "verify colonnade_ao.obj --points 2000 --rays 256 --heat-map heat.png --report report.json",
        "verify colonnade_ao.obj --points 500 --rays 100 --estimator mean --tolerance 0.001 --json",
    ),
    "compare textures": (
        f"bake rings.ply {SMALL}",
        "bake rings.ply --size 128 -n 64 -o fewer/",
        "compare rings_ao.png fewer/rings_ao.png --picture picture.png --report report.json",
        "compare rings_ao.ply fewer/rings_ao.ply --json",
    ),
    "compare spheres": (
        f"spheres rings.ply {FEW}",
        f"spheres rings.ply {FEW} --seed 3 -o other.json",
        "compare rings_spheres.json other.json --json",
    ),
    "batch": (
        "batch colonnade.obj arches.stl rings.ply terrace.glb -o out --no-cache --jobs 2 --report batch.json "
        "--bake '--size 64 -n 64' --spheres '-n 5 -s 500' --junit batch.xml",
    ),
    "batch manifest": ("batch manifest.toml --no-cache --report batch.json",),
}

MANIFEST = """
inputs = ["*.ply", "*.stl"]
output = "built"
[bake]
size = "64x96"
directions = 64
texture = ".exr"
[spheres]
spheres = 6
samples = 500
format = ".csv"
[[override]]
match = "rings*"
spheres = {method = "shadow"}
[[asset]]
mesh = "colonnade.obj"
name = "hall/columns"
bake = {directions = 128, verify = true}
"""


def make_meshes(folder: Path) -> None:
    """Write the meshes of the examples, and one of them as OFF."""
    for script in ("make_meshes.py", "make_scene.py"):
        subprocess.run([sys.executable, ROOT / "examples" / script, folder], check=True, capture_output=True)
    import trimesh

    trimesh.load(folder / "rings.ply", process=False).export(folder / "rings.off")
    (folder / "manifest.toml").write_text(MANIFEST)


def run(name: str, meshes: Path) -> dict[str, str]:
    """Run the commands of one entry; return a digest of what they print and of each file that they write."""
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        given = {file.name: file.read_bytes() for file in meshes.iterdir() if file.is_file()}
        for file, data in given.items():
            (folder / file).write_bytes(data)
        digests = {}
        for number, command in enumerate(RUNS[name]):
            done = subprocess.run(
                [sys.executable, "-m", "aoprecalc", *shlex.split(command)], cwd=folder, capture_output=True, check=False
            )
            printed = done.stdout if "--json" in command else b""
            digests[f"{number} exit"] = str(done.returncode)
            digests[f"{number} stdout"] = digest("stdout.json", printed)
            if done.returncode not in (0, 1):
                raise SystemExit(f"{name}: {command}: {done.stderr.decode()}")
        for file in sorted(path for path in folder.rglob("*") if path.is_file()):
            way = file.relative_to(folder).as_posix()
            if not way.startswith(("built/.aoprecalc", "out/.aoprecalc")) and given.get(way) != file.read_bytes():
                digests[way] = digest(file.name, file.read_bytes())
                if file.suffix in (".png", ".exr", ".tif", ".tga"):
                    digests[f"{way} pixels"] = pixel_digest(file)
        return digests


def digest(name: str, data: bytes) -> str:
    """Return the SHA-256 of a file without what differs between equal runs."""
    if name.endswith(".json") and data:
        data = json.dumps(plain(json.loads(data)), sort_keys=True).encode()
    if name.endswith(".xml"):
        import re

        data = re.sub(rb'time="[^"]*"|<system-out>.*?</system-out>', b"", data, flags=re.DOTALL)
    return hashlib.sha256(data).hexdigest()[:16]


def pixel_digest(file: Path) -> str:
    """Return the SHA-256 of the size and the decoded values of a picture, without texts and compression."""
    import OpenImageIO

    pixels = OpenImageIO.ImageBuf(str(file)).get_pixels("float")
    return hashlib.sha256(str(pixels.shape).encode() + pixels.tobytes()).hexdigest()[:16]


def plain(value: Any) -> Any:
    """Return a JSON value without seconds, and with the number of warnings in place of their texts."""
    if isinstance(value, dict):
        kept = {key: plain(entry) for key, entry in value.items() if key != "seconds"}
        return kept | ({"warnings": len(value["warnings"])} if "warnings" in value else {})
    return [plain(entry) for entry in value] if isinstance(value, list) else value


def main() -> None:
    """Run all, then write the digests or compare them with earlier ones."""
    parser = argparse.ArgumentParser(description="Digests of everything that the commands write.")
    parser.add_argument("-o", "--output", type=Path, help="write the digests there")
    parser.add_argument("--against", type=Path, help="compare with digests written before")
    parser.add_argument("--only", default="", help="runs whose name contains this text")
    parser.add_argument("--jobs", type=int, default=2)
    given = parser.parse_args()
    names = [name for name in RUNS if given.only in name]
    with tempfile.TemporaryDirectory() as temporary:
        meshes = Path(temporary)
        make_meshes(meshes)
        with ThreadPoolExecutor(given.jobs) as pool:
            found = dict(zip(names, pool.map(lambda name: run(name, meshes), names), strict=True))
    files = sum(map(len, found.values()))
    print(f"{len(found)} runs, {sum(len(RUNS[name]) for name in names)} commands, {files} digests")
    if given.output:
        given.output.write_text(json.dumps(found, indent=1) + "\n")
    if given.against:
        before = json.loads(given.against.read_text())
        differing = [
            f"{name}: {key}"
            for name in names
            for key in sorted({*before.get(name, {}), *found[name]})
            if before.get(name, {}).get(key) != found[name].get(key)
        ]
        print("\n".join(differing) or "all equal")
        sys.exit(bool(differing))


if __name__ == "__main__":
    main()
