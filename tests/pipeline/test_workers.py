"""Whatever happens to a worker process is the outcome of one job."""

import signal
import sys
import threading
import time
from contextlib import closing
from pathlib import Path

import pytest

from aoprecalc.options import BatchOptions
from aoprecalc.pipeline.jobs import Failure, Job, JobSpec, Success
from aoprecalc.pipeline.workers import ProcessPool, WorkerProcess
from pipeline.helpers import BAKE, PATIENCE, SPHERES, wait_until, write_ring

pytestmark = [
    pytest.mark.usefixtures("strange"),
    pytest.mark.skipif(sys.platform != "linux", reason="reads /proc, and names signals as Linux does"),
]


@pytest.fixture
def worker():
    with closing(WorkerProcess()) as worker:
        yield worker


def job(folder, name, spec=None):
    """The job of a mesh in a folder, which is made."""
    mesh = write_ring(folder / f"{name}.obj")
    (folder / "staging").mkdir(exist_ok=True)
    spec = spec or JobSpec(spheres=SPHERES)
    return Job(name, mesh, f"in/{name}.obj", folder / "out", name, folder / "staging", spec)


def tries(of):
    return len(Path(f"{of.mesh}.tries").read_text())


def pids(of):
    """The processes of an endless job: the worker and a child of its own."""
    file = Path(f"{of.mesh}.pids")
    wait_until(file.exists)
    return [int(pid) for pid in file.read_text().split()]


def gone(pid):
    """Tell whether a process has ended; one that nobody has waited for is a zombie."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] == "Z"
    except (FileNotFoundError, ProcessLookupError):
        return True


def test_a_job_is_done_and_its_stages_are_told(worker, tmp_path):
    stages = []
    made = worker.run(job(tmp_path, "ring", JobSpec(BAKE, SPHERES)), stages.append)
    assert isinstance(made, Success)
    assert sorted(made.files) == ["ring_ao.mtl", "ring_ao.obj", "ring_ao.png", "ring_report.json", "ring_spheres.json"]
    assert all(file.parent == tmp_path / "staging" and file.is_file() for file in made.files.values())
    assert not (tmp_path / "out").exists()
    assert made.summary["spheres"] == 8
    assert "visibility" in stages


DEATHS = {
    "killed": "signal 9 (Killed; the system may be out of memory); use fewer --jobs or a smaller size",
    "crashed": "signal 11 (Segmentation fault)",
    "left": "exit status 3; its last output is 'no wood; plant trees'",
}


@pytest.mark.parametrize(
    "name", ["killed", *(pytest.param(name, marks=pytest.mark.slow) for name in ("crashed", "left"))]
)
def test_a_process_that_dies_is_tried_again_and_then_a_failure(name, worker, tmp_path):
    stages, dying = [], job(tmp_path, name)
    failure = worker.run(dying, stages.append, retries=1)
    assert isinstance(failure, Failure)
    assert (failure.kind, failure.exit_code) == ("crash", 1)
    assert failure.message == f"in/{name}.obj: its process died: {DEATHS[name]}"
    assert tries(dying) == 2
    assert any(stage.startswith("again") for stage in stages)
    assert isinstance(worker.run(job(tmp_path, "ring"), stages.append), Success)


@pytest.mark.slow
def test_what_is_not_tried_again_is_not_said_to_be(worker, tmp_path):
    stages, dying = [], job(tmp_path, "crashed")
    worker.run(dying, stages.append, retries=0)
    assert tries(dying) == 1
    assert not any(stage.startswith("again") for stage in stages)


def test_the_second_try_may_do_it(worker, tmp_path):
    once = job(tmp_path, "once")
    made = worker.run(once, lambda stage: None, retries=1)
    assert isinstance(made, Success)
    assert tries(once) == 2
    assert list(made.files) == ["once_spheres.json"]


def test_what_is_refused_is_not_tried_again(worker, tmp_path):
    refused = job(tmp_path, "ring")
    refused.mesh.write_text("")
    failure = worker.run(refused, lambda stage: None, retries=3)
    assert (failure.kind, failure.exit_code) == ("error", 4)
    assert failure.message.startswith("in/ring.obj: is empty")
    assert tries(refused) == 1
    assert list((tmp_path / "staging").iterdir()) == []


def test_a_fault_of_ours_is_one_line_with_its_traceback_apart(worker, tmp_path):
    faulty = job(tmp_path, "faulty")
    failure = worker.run(faulty, lambda stage: None, retries=3)
    assert (failure.kind, failure.exit_code) == ("error", 1)
    said = "ZeroDivisionError: in in/faulty.obj of two lines"
    assert failure.message == f"in/faulty.obj: {said}; this is a fault of aoprecalc"
    assert failure.details.startswith("Traceback ")
    assert tries(faulty) == 1


@pytest.mark.slow
def test_what_libraries_print_disturbs_nothing(worker, tmp_path, capfd):
    assert isinstance(worker.run(job(tmp_path, "loud"), lambda stage: None), Success)
    assert capfd.readouterr() == ("", "")


def test_a_time_out_ends_the_process_and_its_own_children(worker, tmp_path):
    worker.run(job(tmp_path, "ring"), lambda stage: None)  # it has begun, so that the time is that of the job alone
    endless = job(tmp_path, "endless")
    failure = worker.run(endless, lambda stage: None, timeout=2, retries=3)
    assert failure.kind == "timeout"
    assert failure.message == "in/endless.obj: took longer than 2 s; allow more (--timeout) or ask for less"
    assert tries(endless) == 1
    for pid in pids(endless):
        wait_until(lambda pid=pid: gone(pid))
    assert isinstance(worker.run(job(tmp_path, "ring"), lambda stage: None), Success)


@pytest.mark.slow
def test_stopping_ends_the_process_and_its_own_children(worker, tmp_path):
    endless, outcomes, stop = job(tmp_path, "endless"), [], threading.Event()
    thread = threading.Thread(target=lambda: outcomes.append(worker.run(endless, lambda stage: None, stop=stop)))
    thread.start()
    begun = pids(endless)
    worker.close_if_idle()  # which it is not
    assert not any(map(gone, begun))
    stop.set()
    thread.join()
    assert (outcomes[0].kind, outcomes[0].message) == ("stopped", "in/endless.obj: was stopped")
    for pid in begun:
        wait_until(lambda pid=pid: gone(pid))


def test_a_worker_ends_when_it_is_closed(tmp_path):
    worker = WorkerProcess()
    worker.run(job(tmp_path, "ring"), lambda stage: None)
    pid = worker._child.pid
    assert not gone(pid)
    worker.close()
    assert gone(pid)
    worker.close()


def test_a_process_that_cannot_be_used_is_an_outcome(tmp_path, monkeypatch):
    """Whatever goes wrong around it: an outcome that never comes would be waited for."""

    def run(*given, **options):
        raise ValueError("no such thing here")

    monkeypatch.setattr(WorkerProcess, "run", run)
    jobs, events = [job(tmp_path, "a"), job(tmp_path, "b")], []
    waiting = threading.Thread(
        target=lambda: events.extend(ProcessPool(2, BatchOptions(jobs=2)).run(jobs)), daemon=True
    )
    waiting.start()
    waiting.join(PATIENCE)
    assert not waiting.is_alive()
    outcomes = {event.job.name: event.outcome for event in events if event.outcome is not None}
    assert outcomes.keys() == {"a", "b"}
    assert outcomes["a"].message == "in/a.obj: its process could not be used (ValueError: no such thing here)"


def test_ctrl_c_is_seen_even_if_it_does_not_end_the_wait(tmp_path, monkeypatch):
    """Such as one that comes just before the wait, or in another thread."""
    was_stopped = []

    def endless(self, request, on_stage, *, stop, **limits):
        time.sleep(0.2)  # the main thread waits now
        signal.pthread_kill(threading.get_ident(), signal.SIGINT)
        was_stopped.append(stop.wait(PATIENCE))
        return Failure("stopped", "was stopped")

    monkeypatch.setattr(WorkerProcess, "run", endless)
    events = ProcessPool(1, BatchOptions()).run([job(tmp_path, "ring")])
    with pytest.raises(KeyboardInterrupt), closing(events):
        list(events)
    assert was_stopped == [True]


@pytest.mark.slow
def test_an_idle_process_goes(worker, tmp_path):
    assert isinstance(worker.run(job(tmp_path, "a"), print), Success)
    process = worker._child.pid
    worker.close_after(0.1)
    wait_until(lambda: not Path(f"/proc/{process}").exists())
    assert isinstance(worker.run(job(tmp_path, "a"), print), Success)


def test_a_process_that_is_used_again_stays(worker, tmp_path):
    worker.run(job(tmp_path, "a"), print)
    process = worker._child.pid
    worker.close_after(3600)
    worker.run(job(tmp_path, "a"), print)
    assert worker._child.pid == process
    assert not worker._idle_timer.is_alive() or worker._idle_timer.finished.is_set()
