"""Print what CHANGELOG.md says about a version, for the page of its release.

python scripts/release_notes.py 0.2.0
"""

import re
import sys
from pathlib import Path

ROOT = Path(__file__).parent.parent


def release_notes(changelog: str, version: str) -> str:
    """Return the section of a version, without its heading; raises ValueError where there is none, or it is empty."""
    heading = rf"^## \[{re.escape(version)}\] - \d{{4}}-\d\d-\d\d\n"
    found = re.search(rf"{heading}(.*?)(?=^## |^\[[^\]]+\]: |\Z)", changelog, re.MULTILINE | re.DOTALL)
    if found is None or not found[1].strip():
        raise ValueError(f'CHANGELOG.md says nothing below "## [{version}] - YYYY-MM-DD"; add it before the tag')
    return f"{found[1].strip()}\n"


def package_version() -> str:
    """Return the version that the package states."""
    text = (ROOT / "src" / "aoprecalc" / "__init__.py").read_text(encoding="utf-8")
    (version,) = re.findall(r'^__version__ = "(.+)"$', text, re.MULTILINE)
    return str(version)


if __name__ == "__main__":
    wanted = sys.argv[1]
    if wanted != package_version():
        sys.exit(f"the tag is of version {wanted}, the package of {package_version()}; tag the right commit")
    try:
        print(release_notes((ROOT / "CHANGELOG.md").read_text(encoding="utf-8"), wanted), end="")
    except ValueError as error:
        sys.exit(str(error))
