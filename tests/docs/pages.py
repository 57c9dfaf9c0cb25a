"""The pages of the documentation, and the fenced code blocks in them."""

import re
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[2]
FENCE = re.compile(r"([ \t>]*)(`{3,})\s*([^`\n]*)")


@dataclass(frozen=True)
class Block:
    """A fenced code block: its page (a path from the root), the line of its first line of code, language, text."""

    page: str
    line: int
    language: str
    text: str

    @property
    def where(self) -> str:
        """Page and line."""
        return f"{self.page}:{self.line}"

    @property
    def name(self) -> str | None:
        """Name of the file that the block shows, where its first line is a comment of nothing but that."""
        match = re.match(r"(?:#|//|<!--) ([\w./-]+\.\w+)(?: -->)?\n", self.text)
        return match[1] if match else None


def pages() -> list[str]:
    """Return README.md and all pages of the site, as paths from the root."""
    site = sorted((ROOT / "docs").rglob("*.md"))
    return ["README.md", *(page.relative_to(ROOT).as_posix() for page in site if "_build" not in page.parts)]


def blocks_of(page: str) -> list[Block]:
    """Return the code blocks of a page, those inside of directives too."""
    return _blocks(page, (ROOT / page).read_text(encoding="utf-8").splitlines(), 1)


def _blocks(page: str, lines: list[str], first: int) -> list[Block]:
    found, at = [], 0
    while at < len(lines):
        opening = FENCE.match(lines[at])
        at += 1
        if opening is None:
            continue
        indent, fence, info = opening.groups()
        start = at
        while at < len(lines) and lines[at].strip(" \t>") != fence:
            at += 1
        assert at < len(lines), f"{page}:{first + start - 1}: the code block has no end"
        inside = [line.removeprefix(indent) for line in lines[start:at]]
        if info.startswith("{"):
            found += _blocks(page, inside, first + start)
        else:
            found.append(Block(page, first + start, info.strip(), "\n".join(inside) + "\n"))
        at += 1
    return found


def blocks(*languages: str) -> list[Block]:
    """Return all code blocks in some languages."""
    return [block for page in pages() for block in blocks_of(page) if block.language in languages]
