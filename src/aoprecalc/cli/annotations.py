"""Annotations: lines in the log of a GitHub workflow that GitHub shows beside the files they are about."""

import os
from pathlib import Path

import click


def annotate(level: str, message: str, *, file: Path | None = None) -> None:
    """Print a workflow command on standard error; nothing outside of a workflow.

    level   error, warning or notice
    """
    if os.environ.get("GITHUB_ACTIONS") != "true":
        return
    where = f" file={_escaped(str(file)).replace(':', '%3A').replace(',', '%2C')}" if file is not None else ""
    click.echo(f"::{level}{where}::{_escaped(message)}", err=True)


def _escaped(text: str) -> str:
    return text.replace("%", "%25").replace("\r", "%0D").replace("\n", "%0A")
