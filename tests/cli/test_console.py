"""What is printed while a command works."""

import sys

import pytest

from aoprecalc.cli.options import Console


def work(console):
    with console.stage("sorting", total=4, unit="things"):
        console.note("by size [not] by [colour]")
        console.advance(3)
        console.advance()
    with console.stage("thinking"):
        console.advance()
        console.step("hard, try 2 of 3")
    console.step("of no stage")
    console.warn("one is missing")


def test_a_log_gets_plain_lines_and_no_bars(capsys):
    work(Console(quiet=False, verbose=False))
    assert capsys.readouterr() == ("", "by size [not] by [colour]\nwarning: one is missing\n")


def test_verbose_adds_the_seconds_of_stages(capsys):
    work(Console(quiet=False, verbose=True))
    lines = capsys.readouterr().err.splitlines()
    assert [line.split(":")[0] for line in lines if line.endswith(" s")] == ["sorting", "thinking"]


@pytest.mark.parametrize("terminal", [False, True])
def test_quiet_prints_warnings_alone(capsys, monkeypatch, terminal):
    monkeypatch.setattr(sys.stderr, "isatty", lambda: terminal)
    work(Console(quiet=True, verbose=True))
    assert capsys.readouterr() == ("", "warning: one is missing\n")


def test_a_terminal_gets_bars_and_whole_lines(capsys, monkeypatch):
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    monkeypatch.setenv("FORCE_COLOR", "1")
    monkeypatch.setenv("TERM", "xterm")
    work(Console(quiet=False, verbose=False))
    said = capsys.readouterr()
    assert said.out == ""
    assert "by size [not] by [colour]\n" in said.err
    assert "sorting" in said.err
    assert "things" in said.err
    assert "hard, try 2 of 3" in said.err
    assert "of no stage" not in said.err
    assert said.err.endswith("warning: one is missing\n")


def test_a_stage_that_fails_ends_its_bar(monkeypatch, capsys):
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    console = Console(quiet=False, verbose=False)
    with pytest.raises(ValueError, match="no"), console.stage("failing", total=2):
        raise ValueError("no")
    console.note("after")
    assert capsys.readouterr().err.endswith("after\n")
