"""README.md is one screen that leads to the rest, and its tables are those of the benchmarks."""

import importlib
import re

import pytest

from docs.pages import ROOT

README = (ROOT / "README.md").read_text(encoding="utf-8")


@pytest.fixture
def tables(monkeypatch):
    """The module that makes the tables."""
    monkeypatch.syspath_prepend(ROOT / "benchmarks")
    return importlib.import_module("result_tables")


def table(text, name):
    """The lines of a table, as lists of cells."""
    lines = re.search(rf"<!-- {name}: [^\n]*-->\n(.*?)<!-- end of {name} -->", text, re.DOTALL)[1].splitlines()
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in lines]


def test_it_is_short():
    assert len(README.encode()) <= 8192


def test_its_first_commands_are_two_that_make_knows():
    first = re.search(r"```sh\n(.*?)```", README, re.DOTALL)[1]
    assert re.findall(r"^make (\w+)", first, re.MULTILINE) == ["demo", "test"]
    targets = re.findall(r"^([\w-]+):", (ROOT / "Makefile").read_text(), re.MULTILINE)
    assert set(re.findall(r"`?make ([\w-]+)", README)) <= {*targets, "demo"}


def test_what_it_links_to_exists():
    links = re.findall(r"\]\((?!https?://)([^)#]+)", README)
    assert len(links) > 10
    for link in links:
        assert (ROOT / link).exists(), link


def test_the_tables_are_what_was_measured(tables):
    page = tables.PAGE.read_text(encoding="utf-8")
    for text, made in ((page, tables.full_tables()), (README, tables.selected_tables())):
        for name, lines in made.items():
            assert tables.with_table(text, name, lines) == text, "run python benchmarks/result_tables.py"
        assert re.findall(r"^<!-- ([\w ]+):", text, re.M) == list(made)


@pytest.mark.parametrize(("name", "full"), [("fidelity", "fidelity"), ("spheres", "sphere counts"), ("speed", "speed")])
def test_the_rows_of_the_small_tables_stand_in_the_full_ones(tables, name, full):
    heading, _, *rows = table(README, name)
    all_heading, _, *all_rows = table(tables.PAGE.read_text(encoding="utf-8"), full)
    known = [[row[all_heading.index(column)] for column in heading] for row in all_rows]
    assert rows
    for row in rows:
        assert row in known


def test_a_page_without_the_marks_of_a_table_is_an_error(tables):
    with pytest.raises(ValueError, match="no marks of the table speed"):
        tables.with_table("# A page\n", "speed", [])
