"""Kills a batch, or one of its processes, at random moments, and looks whether anything is broken or lost.

Usage: python benchmarks/kills.py [--tries N] [--seed N]

Each try starts a batch over meshes made here, some of them unusable, into an output folder that is empty or holds the
results of other options. After a random time the parent, or one of the processes below it, is killed by SIGKILL.
- Every file in the output folder must be whole: as before the batch or as after it, byte for byte (the seconds of
  reports apart). None may be there that does not belong there.
- If the parent was killed, no process may be left, and the same command must then end as an undisturbed one does.
- If a process below it was killed, the batch must end as an undisturbed one does, by itself.
- What the cache holds must give the same files once more.
"""

import argparse
import json
import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import trimesh

BATCH = [sys.executable, "-c", "from aoprecalc.cli import main; main()", "batch"]
BEFORE, AFTER = "--size 64 -n 8", "--size 64 -n 10"
SPHERES = "-n 8 -s 500"


def make_meshes(folder: Path) -> None:
    """Write meshes of several kinds, and what looks like some."""
    (folder / "props").mkdir(parents=True)
    shapes = {
        "ball.obj": trimesh.creation.icosphere(2),
        "box.stl": trimesh.creation.box(),
        "ring.ply": trimesh.creation.torus(1, 0.3),
        "props/ring.obj": trimesh.creation.torus(2, 0.5),
        "props/rod.glb": trimesh.creation.cylinder(0.2, 3),
        "props/washer.off": trimesh.creation.annulus(0.5, 1, 0.2),
    }
    for name, shape in shapes.items():
        shape.export(folder / name)
    (folder / "empty.obj").write_bytes(b"")
    (folder / "props" / "broken.glb").write_bytes(b"glTF and then nothing of the kind")


def command(meshes: Path, output: Path, cache: Path, bake: str) -> list[str]:
    where = [str(meshes), "-o", str(output), "--cache", str(cache), "--jobs", "2"]
    return [*BATCH, *where, "--bake", bake, "--spheres", SPHERES]


def run(words: list[str]) -> int:
    return subprocess.run(words, capture_output=True, check=False).returncode


def contents(output: Path) -> dict[str, bytes]:
    """Return what a user finds in an output folder, without the seconds of reports."""
    found = {}
    for file in output.rglob("*"):
        way = file.relative_to(output)
        if file.is_file() and way.parts[0] != ".aoprecalc":
            found[str(way)] = file.read_bytes()
            if file.name.endswith("_report.json"):
                report = json.loads(found[str(way)])  # raises where it is cut off
                del report["seconds"]
                found[str(way)] = json.dumps(report).encode()
    return found


def below(process: int) -> list[int]:
    """Return the processes that a process has started, and those that they have."""
    found = []
    for children in Path(f"/proc/{process}/task").glob("*/children"):
        try:
            started = [int(child) for child in children.read_text().split()]
        except OSError:
            continue
        found += [some for child in started for some in (child, *below(child))]
    return found


def is_alive(process: int) -> bool:
    try:
        return Path(f"/proc/{process}/stat").read_text().rsplit(")", 1)[1].split()[0] != "Z"
    except OSError:
        return False


def wait_until_gone(processes: list[int]) -> bool:
    end = time.monotonic() + 10
    while any(map(is_alive, processes)):
        if time.monotonic() > end:
            return False
        time.sleep(0.01)
    return True


class Trial:
    """A folder with meshes, and what undisturbed batches make of them."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.meshes = folder, folder / "meshes"
        make_meshes(self.meshes)
        self.before, self.after = folder / "before", folder / "after"
        run(command(self.meshes, self.before, folder / "cache-before", BEFORE))
        shutil.copytree(self.before, self.after)
        started = time.monotonic()
        self.code = run(command(self.meshes, self.after, folder / "cache-after", AFTER))
        self.seconds = time.monotonic() - started
        self.was, self.expected = contents(self.before), contents(self.after)
        assert self.code == 1, self.code
        assert len(self.expected) > 20
        assert all(self.was[name] != data for name, data in self.expected.items() if name.endswith("_report.json"))

    def once(self, chance: random.Random) -> tuple[str, list[str]]:
        """Kill once; return who was killed, and what was wrong."""
        output, cache = self.folder / "output", self.folder / "cache"
        for folder in (output, cache):
            shutil.rmtree(folder, ignore_errors=True)
        fresh = chance.random() < 0.5
        if not fresh:
            shutil.copytree(self.before, output)
        words = command(self.meshes, output, cache, AFTER)
        process = subprocess.Popen(words, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        time.sleep(chance.uniform(0, self.seconds))
        others = below(process.pid)
        whom = chance.choice(["parent", "worker"]) if others else "parent"
        try:
            os.kill(process.pid if whom == "parent" else chance.choice(others), signal.SIGKILL)
        except ProcessLookupError:
            whom = "nobody, it had ended"
        code = process.wait()
        wrong = []
        if not wait_until_gone(others):
            wrong.append("processes are left")
        if code == -signal.SIGKILL:
            allowed = {name: {data, self.was.get(name, data)} for name, data in self.expected.items()}
            for name, data in contents(output).items():
                if data not in allowed.get(name, ()):
                    wrong.append(f"{name} is not whole, or does not belong there")
            code = run(words)
        wrong += self._differences(code, output)
        other = self.folder / "once-more"
        shutil.rmtree(other, ignore_errors=True)
        wrong += [f"from the cache: {line}" for line in self._from_cache(other, cache)]
        return f"{whom}, {'empty' if fresh else 'filled'} folder", wrong

    def _from_cache(self, output: Path, cache: Path) -> list[str]:
        before = len(list(cache.rglob("result.json")))
        wrong = self._differences(run(command(self.meshes, output, cache, AFTER)), output)
        if len(list(cache.rglob("result.json"))) != before:
            wrong.append("something was made that should have been there")
        return wrong

    def _differences(self, code: int, output: Path) -> list[str]:
        wrong = [] if code == self.code else [f"exit code {code}, {self.code} was expected"]
        found = contents(output)
        wrong += [f"{name} is missing" for name in self.expected.keys() - found.keys()]
        wrong += [f"{name} does not belong there" for name in found.keys() - self.expected.keys()]
        wrong += [
            f"{name} differs" for name in found.keys() & self.expected.keys() if found[name] != self.expected[name]
        ]
        if (output / ".aoprecalc" / "staging").exists():
            wrong.append("what was being written is left")
        return wrong


def main() -> int:
    parser = argparse.ArgumentParser(description="Kill batches at random moments.")
    parser.add_argument("--tries", type=int, default=200)
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    chance, counts, failed = random.Random(given.seed), dict[str, int](), 0
    with tempfile.TemporaryDirectory() as folder:
        trial = Trial(Path(folder))
        print(f"an undisturbed batch takes {trial.seconds:.1f} s and makes {len(trial.expected)} files", flush=True)
        for number in range(given.tries):
            whom, wrong = trial.once(chance)
            counts[whom] = counts.get(whom, 0) + 1
            failed += bool(wrong)
            for line in wrong:
                print(f"try {number} ({whom}): {line}", flush=True)
            if number % 20 == 19:
                print(f"{number + 1} tries, {failed} failed", flush=True)
    print(f"{given.tries} tries, {failed} failed; killed: {counts}")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
