"""Names in single backquotes in docstrings: a link where the name is a public one, else code."""

from typing import Any

from docutils import nodes
from docutils.parsers.rst.states import Inliner
from sphinx.addnodes import pending_xref
from sphinx.application import Sphinx

import aoprecalc


def public_name(text: str) -> str | None:
    """Return the full name of what a link may lead to; None where the text is no public name."""
    head, _, member = text.removesuffix("()").partition(".")
    if head not in aoprecalc.__all__:
        return None
    documented = member and callable(getattr(getattr(aoprecalc, head), member, None))
    return f"aoprecalc.{head}.{member}" if documented else f"aoprecalc.{head}"


def _name_role(
    role: str,
    rawtext: str,
    text: str,
    lineno: int,
    inliner: Inliner,
    options: dict[str, Any] | None = None,
    content: list[str] | None = None,
) -> tuple[list[nodes.Node], list[nodes.system_message]]:
    code = nodes.literal(rawtext, text, classes=["docutils"])
    if (target := public_name(text)) is None:
        return [code], []
    return [pending_xref(rawtext, code, refdomain="py", reftype="obj", reftarget=target, refwarn=True)], []


def setup(app: Sphinx) -> dict[str, Any]:
    """Add the role `name`, which `conf.py` makes the default one."""
    app.add_role("name", _name_role)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
