"""Commands in this process, which saves the start of one."""

import pytest


@pytest.fixture
def run(command, monkeypatch):
    """run(folder, *words): run `aoprecalc` in a folder as a shell would."""

    def run_in(folder, *words):
        monkeypatch.chdir(folder)
        return command(*words)

    return run_in
