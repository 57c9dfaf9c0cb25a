"""The action of action.yml, whose scripts run as on GitHub."""

import os
import re
import subprocess
import sys
import sysconfig
from pathlib import Path

import yaml

ROOT = Path(__file__).parents[1]
ACTION = yaml.safe_load((ROOT / "action.yml").read_text(encoding="utf-8"))
STEPS = {step["name"]: step for step in ACTION["runs"]["steps"] if "run" in step}
DEFAULTS = {name: given["default"] for name, given in ACTION["inputs"].items()}


class Workflow:
    """A job that uses the action: what its steps left in the files that GitHub reads."""

    def __init__(self, folder, **inputs):
        self.folder, self.inputs, self.said, self.outputs = folder, {**DEFAULTS, **inputs}, "", {}
        self.cache = folder.parent / "temp" / "aoprecalc-cache"
        self.files = {name: folder.parent / name for name in ("GITHUB_OUTPUT", "GITHUB_STEP_SUMMARY")}
        for file in self.files.values():
            file.write_text("", encoding="utf-8")

    def run(self, name, *path):
        """Run a step; returns its exit code. `path`: folders of programs that it finds first."""
        step = STEPS[name]
        script = self.folder.parent / "step.sh"
        script.write_text(step["run"], encoding="utf-8")
        ours = {key: self.value(text) for key, text in step.get("env", {}).items()}
        known = {key: text for key, text in os.environ.items() if not key.startswith("GITHUB_")}
        programs = [*map(str, path), sysconfig.get_path("scripts"), str(Path(sys.executable).parent), known["PATH"]]
        environment = {
            **known, "PATH": os.pathsep.join(programs), "GITHUB_ACTIONS": "true", "GITHUB_ACTION_PATH": str(ROOT),
            **{key: str(file) for key, file in self.files.items()}, **ours,
        }  # fmt: skip
        words = ["bash", "--noprofile", "--norc", "-eo", "pipefail", script]
        done = subprocess.run(
            words, cwd=self.folder, env=environment, capture_output=True, text=True, encoding="utf-8", check=False
        )
        self.said += done.stdout + done.stderr
        lines = self.files["GITHUB_OUTPUT"].read_text(encoding="utf-8").splitlines()
        self.outputs = dict(line.split("=", 1) for line in lines)
        return done.returncode

    def value(self, text):
        """Fill in what GitHub would."""
        contexts = {
            "inputs": self.inputs,
            "runner": {"temp": str(self.cache.parent), "os": "Linux"},
            "steps.bake.outputs": self.outputs,
        }
        return re.sub(r"\$\{\{ ([\w.]+)\.([\w-]+) \}\}", lambda it: contexts[it[1]].get(it[2], ""), str(text))

    @property
    def summary(self):
        return self.files["GITHUB_STEP_SUMMARY"].read_text(encoding="utf-8")
