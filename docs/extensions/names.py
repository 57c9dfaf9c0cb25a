"""Docstrings: names in single backquotes are links where they are public, else code; results have no signatures."""

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


def _signature(
    app: Sphinx, what: str, name: str, value: object, options: object, arguments: str | None, returned: str | None
) -> tuple[str, None] | None:
    """Return no arguments for a class that only functions make: its docstring tells attributes, but no parameters."""
    text = value.__doc__ or ""
    made = what == "class" and "Attributes\n" in text and "Parameters\n" not in text
    return ("", None) if made else None


def setup(app: Sphinx) -> dict[str, Any]:
    """Add the role `name`, which `conf.py` makes the default one."""
    app.setup_extension("sphinx.ext.autodoc")
    app.add_role("name", _name_role)
    app.connect("autodoc-process-signature", _signature)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
