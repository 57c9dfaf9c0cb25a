"""Batches on a Dask cluster of several worker processes on this machine."""

import json
import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image

from aoprecalc import BakeOptions, BatchOptions, SphereOptions, batch
from aoprecalc.api.bake import bake_file
from aoprecalc.errors import AoprecalcError, UsageError
from aoprecalc.pipeline import BatchProgress
from aoprecalc.pipeline import dask_client as workers
from aoprecalc.pipeline import dask_worker as remote
from aoprecalc.pipeline.dask_worker import WorkerInfo
from aoprecalc.pipeline.jobs import Job, JobSpec
from gltf_kit.gltf_animated import box_with_lid
from gltf_kit.gltf_maker import GltfMaker
from pipeline.helpers import contents, wait_until, without_times, write_ring
from shapes import torus

distributed = pytest.importorskip("distributed")


def files(folder):
    return without_times(contents(folder))


BAKE, SPHERES = BakeOptions(size=64, directions=128), SphereOptions(8, samples=500)
NAMES = ["a", "b", "c", "deep/d", "deep/e"]

# Dask leaves threads and sockets of a closed cluster to the garbage collector.
pytestmark = pytest.mark.filterwarnings("ignore::ResourceWarning", "ignore::DeprecationWarning")


@pytest.fixture(scope="module")
def meshes(tmp_path_factory):
    folder = tmp_path_factory.mktemp("meshes")
    for number, name in enumerate(NAMES):
        write_ring(folder / f"{name}.obj", minor=0.2 + 0.1 * number)
    return folder


@pytest.fixture(scope="module")
def expected(meshes, tmp_path_factory):
    """What a batch in processes of this machine makes."""
    folder = tmp_path_factory.mktemp("expected")
    assert batch(meshes, folder, bake=BAKE, spheres=SPHERES).passed
    return files(folder)


@pytest.fixture
def two_workers():
    """A cluster of two processes; of its own for each test, as tests may kill them."""
    nanny = {"nthreads": 1, "dashboard_address": None}
    workers = {
        "gpu": {"cls": distributed.Nanny, "options": {**nanny, "resources": {"GPU": 1}}},
        "cpu": {"cls": distributed.Nanny, "options": nanny},
    }
    scheduler = {"cls": distributed.Scheduler, "options": {"dashboard": False, "dashboard_address": ":0", "port": 0}}
    with distributed.SpecCluster(workers=workers, scheduler=scheduler, silence_logs=50) as made:
        yield made


class Ends(BatchProgress):
    """Notes what became of the assets, in the order of the news."""

    def __init__(self):
        self.results = []

    def end(self, result):
        self.results.append(result)


def on(cluster, meshes, output, bake=BAKE, progress=None, **options):
    chosen = BatchOptions(scheduler=cluster.scheduler_address, **options)
    return batch(meshes, output, bake=bake, spheres=SPHERES, options=chosen, progress=progress)


@pytest.mark.parametrize("ship", [pytest.param("folder", marks=pytest.mark.slow), "bytes"])
def test_a_cluster_makes_the_same_bytes(two_workers, meshes, expected, tmp_path, ship):
    progress = Ends()
    assert on(two_workers, meshes, tmp_path, ship=ship, progress=progress).passed
    assert files(tmp_path) == expected
    assert sorted(result.asset.name for result in progress.results) == NAMES


@pytest.mark.slow
@pytest.mark.parametrize("split", [False, True], ids=["whole", "split"])
@pytest.mark.parametrize("what", ["poses", "details", "interleaved"])
def test_poses_details_a_sky_and_bent_normals_have_the_bytes_of_one_process(two_workers, tmp_path, what, split):
    bake = {"size": 64, "directions": 128, "sky": "sky.png"}
    Image.fromarray(np.repeat(np.array([(20, 200)], np.uint8), 8, axis=1).repeat(8, axis=0)).save(tmp_path / "sky.png")
    if what == "interleaved":
        bake |= {"directions": "auto", "size": 128}
        mesh = write_ring(tmp_path / "mesh.obj")
    elif what == "poses":
        mesh = box_with_lid(GltfMaker(tmp_path)).save("mesh.glb")
        bake["pose"] = ["open@0.5", "open@1"]
    else:
        mesh = write_ring(tmp_path / "mesh.obj")
        positions, faces = torus(around=64, across=32)
        trimesh.Trimesh(positions, faces, process=False).export(tmp_path / "mesh_high.ply")
        bake["high"] = "mesh_high.ply"
    lines = "".join(f"{key} = {json.dumps(value)}\n" for key, value in bake.items())
    manifest = tmp_path / "assets.toml"
    manifest.write_text(f'inputs = ["{mesh.name}"]\noutput = "cluster"\n[bake]\n{lines}bent-normals = ".png"\n')
    options = BatchOptions(scheduler=two_workers.scheduler_address, split=split)
    assert batch(manifest, options=options).passed
    made = {name: data for name, data in contents(tmp_path / "cluster").items() if not name.endswith("_report.json")}
    assert {"mesh_ao.png", "mesh_bent.png"} < made.keys()

    files = {name: str(tmp_path / bake[name]) for name in ("sky", "high") if name in bake}
    alone = tmp_path / "alone"
    alone.mkdir()
    bake_file(mesh, alone, bent_normals=alone / "mesh_bent.png", options=BakeOptions(**bake | files))
    assert contents(alone) == made


@pytest.mark.slow
def test_a_worker_that_is_killed_loses_nothing_and_doubles_nothing(two_workers, meshes, expected, tmp_path):
    killed, done = [], threading.Event()

    def kill():
        with distributed.Client(two_workers.scheduler_address, set_as_default=False) as client:
            processes = client.run(os.getpid)
            while not (killed or done.is_set()):
                busy = [address for address, keys in client.processing().items() if keys]
                killed.extend(processes[address] for address in busy[:1])
                time.sleep(0.01)
            os.kill(killed[0], signal.SIGKILL)

    killer = threading.Thread(target=kill)
    killer.start()
    progress = Ends()
    try:
        result = on(two_workers, meshes, tmp_path, progress=progress)
    finally:
        done.set()
        killer.join()
    assert killed
    assert result.passed
    assert files(tmp_path) == expected
    assert sorted(result.asset.name for result in progress.results) == NAMES


@pytest.mark.slow
def test_bakes_go_where_gpus_are_offered(two_workers, meshes, tmp_path):
    with distributed.Client(two_workers.scheduler_address, set_as_default=False) as client:
        client.get_task_stream()  # from now on they are noted
        assert on(two_workers, meshes, tmp_path).passed
        places = {task["worker"] for task in client.get_task_stream() if task["key"].startswith("run_in_shared_folder")}
    assert places == {two_workers.workers["gpu"].worker_address}


@pytest.mark.parametrize(
    "way",
    [
        {},
        {"target_error": 0.02, "directions": 1024},
        {"two_sided": True},
    ],
    ids=str,
)
@pytest.mark.slow
def test_a_bake_that_is_split_has_the_same_bytes(two_workers, meshes, tmp_path, way):
    bake = BakeOptions(**{"width": 64, "height": 64, "directions": 300, **way})
    alone = batch(meshes / "deep", tmp_path / "alone", bake=bake)
    split = on(two_workers, meshes / "deep", tmp_path / "split", bake=bake, split=True)
    assert alone.passed
    assert split.passed
    made, expected = files(tmp_path / "split"), files(tmp_path / "alone")
    assert {name: made[name] for name in expected} == expected


@pytest.mark.slow
@pytest.mark.parametrize("how", [{"ship": "bytes"}, {"split": True}], ids=str)
def test_the_files_that_options_name_go_along(two_workers, meshes, tmp_path, how):
    wall = write_ring(tmp_path / "around" / "wall.obj", minor=0.9)
    bake = BakeOptions(size=64, directions=128, occluder=wall)
    alone = batch(meshes / "deep", tmp_path / "alone", bake=bake)
    cluster = on(two_workers, meshes / "deep", tmp_path / "cluster", bake=bake, **how)
    assert alone.passed
    assert cluster.passed
    made, expected = files(tmp_path / "cluster"), files(tmp_path / "alone")
    assert {name: made[name] for name in expected} == expected


@pytest.mark.slow
def test_a_mesh_that_fails_costs_itself_alone(two_workers, meshes, tmp_path):
    write_ring(tmp_path / "in" / "whole.obj")
    (tmp_path / "in" / "broken.obj").write_text("f 1 2 3\n")
    result = on(two_workers, tmp_path / "in", tmp_path / "out", ship="bytes")
    assert [found.status for found in result.results] == ["failed", "made"]
    message = result.results[0].failure.message
    assert message.startswith(f"{tmp_path}/in/broken.obj: line 1: a face refers to v 1, but there are 0")


@pytest.mark.slow
def test_a_cluster_that_is_lost_fails_what_it_had(meshes, tmp_path, monkeypatch):
    """The scheduler and the worker die of SIGKILL while a bake is under way; each asset still has its outcome."""
    monkeypatch.setattr(workers, "_CLUSTER_TIMEOUT", 3)
    file = tmp_path / "scheduler.json"

    def dask(module, *words):
        command = [sys.executable, "-m", f"distributed.cli.{module}", "--scheduler-file", file, *words]
        return subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)

    scheduler = dask("dask_scheduler", "--port", "0", "--no-dashboard")
    worker = dask("dask_worker", "--nthreads", "1", "--no-nanny", "--no-dashboard")
    try:
        while not file.exists() or not file.read_text():
            time.sleep(0.05)
        address = json.loads(file.read_text())["address"]

        class Kills(Ends):
            def end(self, result):
                super().end(result)
                scheduler.kill()
                worker.kill()

        progress = Kills()
        result = batch(meshes, tmp_path / "out", bake=BAKE, options=BatchOptions(scheduler=address), progress=progress)
    finally:
        scheduler.kill()
        worker.kill()
        scheduler.wait()
        worker.wait()
    assert sorted(found.asset.name for found in progress.results) == NAMES
    assert progress.results[0].status == "made"
    assert progress.results[-1].failure.kind == "crash"
    assert not result.passed


def processes_of(cluster):
    """Worker processes of batches that the workers of a cluster have."""
    with distributed.Client(cluster.scheduler_address, set_as_default=False) as client:
        return [process for each in client.run(jobs_of_this_process).values() for process in each]


def jobs_of_this_process():
    found = []
    for children in Path(f"/proc/{os.getpid()}/task").glob("*/children"):
        for child in children.read_text().split():
            if b"aoprecalc.pipeline.worker" in Path(f"/proc/{child}/cmdline").read_bytes():
                found.append(int(child))
    return found


@pytest.mark.slow
def test_a_batch_leaves_no_process_on_the_workers(two_workers, meshes, tmp_path):
    assert on(two_workers, meshes, tmp_path / "a").passed
    assert on(two_workers, meshes / "deep", tmp_path / "b", split=True).passed
    wait_until(lambda: processes_of(two_workers) == [])


@pytest.mark.slow
def test_a_batch_that_died_leaves_none_for_long(two_workers, meshes, tmp_path):
    def hasten():
        remote._IDLE_SECONDS = 0.5

    with distributed.Client(two_workers.scheduler_address, set_as_default=False) as client:
        client.run(hasten)
        for name in client.ncores():
            job = Job("a", meshes / "a.obj", "a.obj", tmp_path, "a", tmp_path / "staging", JobSpec(spheres=SPHERES))
            terms = remote.BatchSettings("one that died", workers.__version__)
            client.submit(remote.run_in_shared_folder, job, terms, workers=[name]).result()
    wait_until(lambda: processes_of(two_workers) == [])


@pytest.mark.slow
def test_a_cluster_without_workers_is_not_waited_for(meshes, tmp_path, monkeypatch):
    """The scheduler lives, the only worker dies of SIGKILL."""
    monkeypatch.setattr(workers, "_CLUSTER_TIMEOUT", 2)
    scheduler = {"cls": distributed.Scheduler, "options": {"dashboard": False, "dashboard_address": ":0", "port": 0}}
    with distributed.SpecCluster(workers={}, scheduler=scheduler, silence_logs=50) as lonely:
        words = ["--nthreads", "1", "--no-nanny", "--no-dashboard"]
        command = [sys.executable, "-m", "distributed.cli.dask_worker", lonely.scheduler_address, *words]
        worker = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        try:

            class Kills(Ends):
                def end(self, result):
                    super().end(result)
                    worker.kill()

            monkeypatch.setattr(workers, "_CLUSTER_TIMEOUT", 20)  # for the worker to come
            with workers.open_client(lonely.scheduler_address):
                monkeypatch.setattr(workers, "_CLUSTER_TIMEOUT", 2)
            progress = Kills()
            on(lonely, meshes, tmp_path, progress=progress)
        finally:
            worker.kill()
            worker.wait()
    assert sorted(result.asset.name for result in progress.results) == NAMES
    assert progress.results[0].status == "made"
    assert "had no workers" in progress.results[-1].failure.message


def test_an_address_that_is_none_is_refused_at_once(meshes, tmp_path):
    with pytest.raises(UsageError, match="expected an address with a port"):
        batch(meshes, tmp_path, bake=BAKE, options=BatchOptions(scheduler="host"))


def test_an_address_without_a_cluster_is_one_line(meshes, tmp_path, monkeypatch):
    monkeypatch.setattr(workers, "_CLUSTER_TIMEOUT", 0.5)
    options = BatchOptions(scheduler="tcp://127.0.0.1:9")
    with pytest.raises(AoprecalcError, match="no cluster with workers answers there") as failure:
        batch(meshes, tmp_path, bake=BAKE, options=options)
    assert "\n" not in str(failure.value)


def test_without_dask_the_extra_is_named(meshes, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(UsageError, match=r"aoprecalc\[cluster\]"):
        batch(meshes, tmp_path, bake=BAKE, options=BatchOptions(scheduler="tcp://127.0.0.1:9"))


class FakeClient:
    """A cluster whose worker is as told."""

    def __init__(self, **place):
        self.place = WorkerInfo(
            **{"version": workers.__version__, "host": "far", "cores": 8, "gpus": 0, "has_folder": True, **place}
        )

    def run(self, function, *words):
        return {"tcp://far:1": self.place}

    def nthreads(self):
        return {"tcp://far:1": 3}


def test_another_version_on_a_worker_is_an_error():
    with pytest.raises(AoprecalcError, match=r"worker tcp://far:1 has aoprecalc 0\.0\.1"):
        workers.DaskPool(FakeClient(version="0.0.1"), BatchOptions())


def test_jobs_share_the_cores_of_their_machine():
    assert workers.DaskPool(FakeClient(), BatchOptions()).threads == 2


def test_a_folder_that_workers_do_not_see_is_an_error(tmp_path):
    pool = workers.DaskPool(FakeClient(has_folder=False), BatchOptions(scheduler="tcp://far:8786", ship="folder"))
    with pytest.raises(AoprecalcError, match="not all workers have access to"):
        next(pool.run([FakeJob(tmp_path)]))


class FakeJob:
    def __init__(self, folder):
        self.staging, self.folder = folder / "job", folder
