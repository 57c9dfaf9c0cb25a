"""What tests of batches share."""

import os
import shutil
from contextlib import contextmanager
from importlib import import_module
from pathlib import Path

import pytest

from aoprecalc.pipeline.jobs import run_job
from aoprecalc.pipeline.workers import JobEvent


class InThisProcess:
    """A crew that does its jobs one after the other, here; `stages` are those that it came to."""

    threads = 1

    def __init__(self):
        self.jobs, self.stages = [], []

    def run(self, jobs):
        for job in jobs:
            self.jobs.append(job.name)
            yield JobEvent(job, outcome=run_job(job, self.stages.append))


@pytest.fixture
def crew(monkeypatch):
    """Have batches of this test work in this process, for speed; `jobs` are the names of all that was made."""
    crew = InThisProcess()

    @contextmanager
    def open_pool(count, options):
        yield crew

    monkeypatch.setattr(import_module("aoprecalc.pipeline.run"), "open_pool", open_pool)  # batch is a function, too
    return crew


@pytest.fixture(autouse=True)
def no_cache_of_the_user(monkeypatch, tmp_path_factory):
    """Keep the user's own cache out of the tests, and them out of it."""
    monkeypatch.setenv("AOPRECALC_CACHE", str(tmp_path_factory.mktemp("cache")))


@pytest.fixture
def strange(tmp_path_factory, monkeypatch):
    """Have workers of this test, and of the commands that it runs, do strange things; see strange_fits."""
    folder = tmp_path_factory.mktemp("strange")
    shutil.copy(Path(__file__).with_name("strange_fits.py"), folder / "sitecustomize.py")
    monkeypatch.syspath_prepend(folder)
    monkeypatch.setenv("PYTHONPATH", str(folder), prepend=os.pathsep)
