"""What tests of batches share."""

import os
import shutil
from contextlib import contextmanager
from pathlib import Path

import pytest

from aoprecalc.pipeline.jobs import run_job
from aoprecalc.pipeline.workers import JobEvent


class InProcessPool:
    """A worker pool that runs its jobs here, one after the other; keeps their names and their stages."""

    threads = 1

    def __init__(self):
        self.jobs, self.stages = [], []

    def run(self, jobs):
        for job in jobs:
            self.jobs.append(job.name)
            yield JobEvent(job, outcome=run_job(job, self.stages.append))


@pytest.fixture
def pool(monkeypatch):
    """Let batches of this test run their jobs in this process, for speed; `pool.jobs`: names of the assets made."""
    pool = InProcessPool()

    @contextmanager
    def open_pool(count, options):
        yield pool

    monkeypatch.setattr("aoprecalc.pipeline.run.open_pool", open_pool)
    return pool


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
