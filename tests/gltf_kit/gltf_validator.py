"""Khronos' glTF validator, which scripts/setup-validator installs."""

import json
import re
import shutil
import subprocess
from pathlib import Path

import pytest

FOLDER = Path(__file__).parents[1] / "validator"
ERROR, WARNING, INFORMATION, HINT = range(4)

needs_validator = pytest.mark.skipif(
    not (shutil.which("node") and (FOLDER / "node_modules" / "gltf-validator").is_dir()),
    reason="Khronos' glTF validator is not installed: `sh scripts/setup-validator`, which needs node and npm",
)

# What may be found in a baked document alone: codes and places.
ACCEPTED = {
    # A mesh that was doubled for a node with weights of its own keeps those of the mesh.
    ("UNUSED_MESH_WEIGHTS", "/meshes/n/weights"),
    # UVs that only the occlusion texture of before was for are kept.
    ("UNUSED_OBJECT", "/meshes/n/primitives/n/attributes/TEXCOORD_n"),
}


def issues(*files: Path) -> list[list[dict]]:
    """What the validator finds in each file: dicts of code, message, severity (ERROR .. HINT) and pointer."""
    command = ["node", FOLDER / "validate.mjs", *files]
    answer = subprocess.run(command, check=True, capture_output=True, text=True, timeout=120)
    found = json.loads(answer.stdout)
    return [found[str(file)] for file in files]


def new_issues(before: Path, after: Path) -> list[dict]:
    """Errors in a baked document, and whatever else the validator finds there and not in the document of before."""
    old, new = issues(before, after)
    known = {_kind(issue) for issue in old} | ACCEPTED
    return [issue for issue in new if issue["severity"] == ERROR or _kind(issue) not in known]


def _kind(issue):
    return issue["code"], re.sub(r"\d+", "n", issue.get("pointer", ""))
