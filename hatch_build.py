"""Adds three.js to the wheel, for the 3D view of reports; `scripts/setup-viewer` makes it where npm is."""

import subprocess
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface


class ViewerBuildHook(BuildHookInterface):  # type: ignore[type-arg]
    """Makes the script, if it can be made, and names the files, which git ignores, for the wheel."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Called before the wheel is built; `version` is "editable" or "standard"."""
        if version == "editable":
            return
        try:
            subprocess.run(["sh", "scripts/setup-viewer"], cwd=self.root, check=True)
        except (OSError, subprocess.CalledProcessError) as error:
            self.app.display_warning(f"3D view of reports: not made: {error}")
        build_data["artifacts"] += [f"/{path.relative_to(self.root).as_posix()}" for path in self._made()]

    def _made(self) -> list[Path]:
        return sorted(Path(self.root, "src/aoprecalc/render/viewer").glob("three.*"))
