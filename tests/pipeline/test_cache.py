"""Results that batches share: whole or not at all, whoever writes, and the least used go first."""

import json
import os
import shutil
import subprocess
import sys
from hashlib import sha256
from pathlib import Path

import pytest

from aoprecalc import __version__
from aoprecalc.errors import OutputError
from aoprecalc.options import BatchOptions
from aoprecalc.pipeline import BatchProgress, Cache, batch, default_cache
from pipeline.helpers import SPHERES, contents, error_of, statuses, write_ring

OLD = (10**18, 10**18)


def key(number):
    return sha256(str(number).encode()).hexdigest()


@pytest.fixture
def cache(tmp_path):
    return Cache(tmp_path / "shared/cache")


@pytest.fixture
def staging(tmp_path):
    (tmp_path / "staging").mkdir()
    return tmp_path / "staging"


@pytest.fixture
def files(tmp_path):
    """name -> file, of a result."""
    made = {"rock_ao.png": bytes(range(256)), "rock spheres ä.json": b"{}", "empty": b""}
    (tmp_path / "made").mkdir()
    for number, data in enumerate(made.values()):
        (tmp_path / f"made/{number}").write_bytes(data)
    return {name: tmp_path / f"made/{number}" for number, name in enumerate(made)}


def entry_of(cache, number=0):
    return cache.folder / "v1" / key(number)[:2] / key(number)


def test_what_is_put_is_what_is_got(cache, files, staging):
    summary = {"triangles": 2, "warnings": ["ä"], "rmse": None}
    assert cache.get(key(0), staging) is None
    assert not cache.folder.exists()
    assert cache.put(key(0), files, summary)
    copies, found = cache.get(key(0), staging)
    assert found == summary
    assert {name: copy.read_bytes() for name, copy in copies.items()} == {
        name: file.read_bytes() for name, file in files.items()
    }
    assert {copy.parent for copy in copies.values()} == {staging}
    assert cache.get(key(1), staging) is None


def test_a_result_is_added_once_and_never_changed(cache, files, staging):
    assert cache.put(key(0), files, {"is": "first"})
    before = contents(cache.folder)
    assert not cache.put(key(0), {}, {"is": "second"})
    assert contents(cache.folder) == before


DAMAGE = {
    "a file that holds something else": lambda entry: (entry / "files/rock_ao.png").write_bytes(b"else"),
    "a file that is missing": lambda entry: (entry / "files/empty").unlink(),
    "no files": lambda entry: shutil.rmtree(entry / "files"),
    "no result": lambda entry: (entry / "result.json").unlink(),
    "an empty result": lambda entry: (entry / "result.json").write_bytes(b""),
    "a result that is no text": lambda entry: (entry / "result.json").write_bytes(bytes(range(256))),
    "a result of another kind": lambda entry: (entry / "result.json").write_text('["files"]'),
    "files of another kind": lambda entry: (entry / "result.json").write_text('{"files": [], "summary": {}}'),
    "nothing": lambda entry: (shutil.rmtree(entry), entry.mkdir()),
}


@pytest.mark.parametrize("how", DAMAGE)
def test_a_damaged_entry_is_not_used_and_goes(how, cache, files, staging):
    cache.put(key(0), files, {"is": "first"})
    DAMAGE[how](entry_of(cache))
    assert cache.get(key(0), staging) is None
    assert list(staging.iterdir()) == []
    assert not entry_of(cache).exists()
    assert cache.put(key(0), files, {"is": "second"})
    assert cache.get(key(0), staging)[1] == {"is": "second"}


@pytest.mark.parametrize("name", ["../../../../../secret", "{}/shared/secret", "sub/secret"])
def test_an_entry_never_names_what_is_elsewhere(name, cache, files, staging, tmp_path):
    """It would be written to that place from the output folder."""
    cache.put(key(0), files, {})
    name, inside = name.format(tmp_path), entry_of(cache) / "files"
    (inside / "sub").mkdir()
    (inside / name).write_bytes(b"secret")
    document = {"files": {name: sha256(b"secret").hexdigest()}, "summary": {}}
    (entry_of(cache) / "result.json").write_text(json.dumps(document))
    assert cache.get(key(0), staging) is None
    assert list(staging.iterdir()) == []
    assert not entry_of(cache).exists()


WRITER = """
import sys, time
from pathlib import Path
from aoprecalc.pipeline import Cache
folder, key, start = sys.argv[1:]
files = {name: Path(folder, name) for name in ("a", "b", "c")}
print("ready", flush=True)
while not Path(start).exists():
    pass
print(sum(Cache(Path(folder, "cache")).put(f"{number:02x}{key}", files, {"n": number}) for number in range(20)))
"""


@pytest.mark.slow
def test_several_writers_leave_each_entry_once_and_whole(tmp_path, staging):
    for name in "abc":
        (tmp_path / name).write_bytes(name.encode() * 100_000)
    start = tmp_path / "start"
    command = [sys.executable, "-c", WRITER, tmp_path, key(0), start]
    writers = [subprocess.Popen(command, stdout=subprocess.PIPE, text=True) for _ in range(4)]
    for writer in writers:
        assert writer.stdout.readline() == "ready\n"
    start.touch()
    added = [int(writer.communicate()[0]) for writer in writers]
    assert [writer.returncode for writer in writers] == [0] * 4
    assert sum(added) == 20
    cache = Cache(tmp_path / "cache")
    assert cache.usage().entries == 20
    for number in range(20):
        copies, summary = cache.get(f"{number:02x}{key(0)}", staging)
        assert summary == {"n": number}
        assert {name: copy.read_bytes() for name, copy in copies.items()} == {
            name: name.encode() * 100_000 for name in "abc"
        }
    assert list((tmp_path / "cache/v1/new").iterdir()) == []


@pytest.fixture
def full(cache, tmp_path):
    """A cache of four entries, of 1000 bytes and a little each; number 0 was used last, 40 days ago, 3 just now."""
    (tmp_path / "kilobyte").write_bytes(bytes(1000))
    now = os.stat(tmp_path).st_mtime_ns
    for number, days in enumerate((40, 20, 10, 0)):
        cache.put(key(number), {"file": tmp_path / "kilobyte"}, {"n": number})
        used = now - days * 86400 * 10**9
        os.utime(entry_of(cache, number) / "result.json", ns=(used, used))
    return cache


def left(cache):
    return [number for number in range(4) if entry_of(cache, number).exists()]


def test_usage_is_what_it_holds(full):
    usage = full.usage()
    assert usage.entries == 4
    assert usage.bytes == sum(file.stat().st_size for file in full.folder.rglob("v1/**/*") if file.is_file())
    assert Cache(full.folder / "missing").usage().entries == 0


@pytest.mark.parametrize(
    ("max_bytes", "max_age", "kept"),
    [
        (None, None, [0, 1, 2, 3]),
        (10_000, None, [0, 1, 2, 3]),
        (3500, None, [1, 2, 3]),
        (1500, None, [3]),
        (0, None, []),
        (None, 15 * 86400, [2, 3]),
        (None, 50 * 86400, [0, 1, 2, 3]),
        (1500, 15 * 86400, [3]),
        (10_000, 30 * 86400, [1, 2, 3]),
    ],
)
def test_the_longest_unused_goes_first(max_bytes, max_age, kept, full):
    before = full.usage()
    removed = full.prune(max_bytes, max_age)
    assert left(full) == kept
    assert removed.entries == 4 - len(kept)
    assert full.usage().bytes == before.bytes - removed.bytes


def test_a_use_counts(full, staging):
    assert full.get(key(0), staging) is not None
    full.prune(max_bytes=2500)
    assert left(full) == [0, 3]


def test_damaged_entries_are_pruned_before_others(full):
    (entry_of(full, 3) / "result.json").unlink()
    full.prune(max_bytes=3500)
    assert left(full) == [0, 1, 2]
    shutil.rmtree(entry_of(full, 2) / "files")
    full.prune(max_bytes=0)
    assert full.usage().entries == 0
    assert left(full) == []


def test_what_a_killed_writer_left_goes_after_a_day(full):
    for name in ("left", "under way"):
        (full.folder / "v1/new" / name / "files").mkdir(parents=True)
    os.utime(full.folder / "v1/new/left", ns=OLD)
    full.prune()
    assert [path.name for path in (full.folder / "v1/new").iterdir()] == ["under way"]


def test_a_folder_that_cannot_be_written_says_so(tmp_path, files, staging):
    (tmp_path / "file").touch()
    cache = Cache(tmp_path / "file")
    assert cache.get(key(0), staging) is None
    with pytest.raises(OutputError, match=r"file: the cache cannot be written .*; choose another cache"):
        cache.put(key(0), files, {})
    assert cache.usage().entries == cache.prune(0).entries == 0


@pytest.fixture
def ring(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return write_ring(tmp_path / "in/ring.obj")


def test_a_batch_goes_on_without_a_cache_that_cannot_be_written(ring, pool, tmp_path):
    write_ring(tmp_path / "in/other.obj", 0.3)
    (tmp_path / "file").touch()
    warnings = []
    progress = BatchProgress()
    progress.warn = warnings.append
    result = batch("in", "out", spheres=SPHERES, cache="file", progress=progress)
    assert statuses(result) == {"other": "made", "ring": "made"}
    assert len(warnings) == 1
    assert warnings[0].startswith("file: the cache cannot be written (")


def test_a_result_is_taken_from_the_cache(ring, pool, tmp_path):
    made = batch("in", "out", spheres=SPHERES, cache="cache")
    again = batch("in", "elsewhere", spheres=SPHERES, cache="cache")
    assert (statuses(made), statuses(again)) == ({"ring": "made"}, {"ring": "cached"})
    assert contents(tmp_path / "elsewhere") == contents(tmp_path / "out")
    assert again.results[0].summary == made.results[0].summary
    assert statuses(batch("in", "elsewhere", spheres=SPHERES, cache="cache")) == {"ring": "unchanged"}
    assert statuses(batch("in", "elsewhere", spheres=SPHERES)) == {"ring": "unchanged"}


def test_a_damaged_result_is_made_again_and_kept(ring, pool, tmp_path):
    batch("in", "out", spheres=SPHERES, cache="cache")
    (damaged,) = (tmp_path / "cache").rglob("ring_spheres.json")
    whole = damaged.read_bytes()
    damaged.write_bytes(b"{}")
    assert statuses(batch("in", "a", spheres=SPHERES, cache="cache")) == {"ring": "made"}
    assert statuses(batch("in", "b", spheres=SPHERES, cache="cache")) == {"ring": "cached"}
    assert contents(tmp_path / "b") == {"ring_spheres.json": whole}


def test_force_takes_nothing_from_it(ring, pool):
    batch("in", "out", spheres=SPHERES, cache="cache")
    forced = batch("in", "out", spheres=SPHERES, cache="cache", options=BatchOptions(force=True))
    assert statuses(forced) == {"ring": "made"}


def test_a_batch_keeps_it_to_its_size(ring, pool, tmp_path):
    write_ring(tmp_path / "in/other.obj", 0.3)
    batch("in", "out", spheres=SPHERES, cache="cache")
    size = Cache(Path("cache")).usage().bytes
    batch("in", "out", spheres=SPHERES, cache="small", options=BatchOptions(cache_size=size - 1))
    assert Cache(Path("small")).usage().entries == 0  # nothing was added: all was there
    shutil.rmtree("out")
    batch("in", "out", spheres=SPHERES, cache="small", options=BatchOptions(cache_size=size - 1))
    assert Cache(Path("small")).usage().entries == 1


def test_the_command_says_what_it_holds_and_removes(ring, pool, command, monkeypatch, tmp_path):
    monkeypatch.setenv("AOPRECALC_CACHE", str(tmp_path / "named"))
    assert command("cache", "info").stdout == f"{tmp_path}/named  holds 0 results, 0 bytes\n"
    assert command("batch", "in", "-o", "out", "--spheres", "-n 8 -s 500").returncode == 0
    said = json.loads(command("cache", "info", "--json").stdout)
    size = Cache(tmp_path / "named").usage().bytes
    assert said == {
        "schema": 1,
        "version": __version__,
        "folder": f"{tmp_path}/named",
        "holds": {"results": 1, "bytes": size},
    }
    assert command("cache", "prune", "--max-age", "1d").stdout == f"{tmp_path}/named  removed 0 results, 0 bytes\n"
    assert command("cache", "prune", "--max-size", "1M", "--cache", "other").stdout.startswith("other  removed 0 ")
    said = json.loads(command("cache", "prune", "--all", "--json").stdout)
    assert said["removed"] == {"results": 1, "bytes": size}
    assert command("cache", "info").stdout == f"{tmp_path}/named  holds 0 results, 0 bytes\n"


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (["prune"], "nothing says what to remove; give --max-size, --max-age or --all"),
        (["prune", "--max-age", "30"], "'30' was found; expected a time with h, d or w, such as 30d"),
        (["prune", "--max-size", "30"], "'30' was found; expected an amount of memory with K, M, G or T"),
        (["clear"], "No such command 'clear'"),
    ],
)
def test_the_command_says_what_it_needs(words, expected, command):
    done = command("cache", *words)
    assert done.returncode == 2
    assert expected in error_of(done)


@pytest.mark.parametrize("words", [["--no-cache"], ["--cache", "other"]])
def test_a_batch_leaves_the_users_cache_alone_where_that_is_said(words, ring, pool, command, monkeypatch, tmp_path):
    monkeypatch.setenv("AOPRECALC_CACHE", str(tmp_path / "named"))
    assert command("batch", "in", "-o", "out", "--spheres", "-n 8 -s 500", *words).returncode == 0
    assert not (tmp_path / "named").exists()
    assert (tmp_path / "other").exists() == ("other" in words)


def test_one_cache_or_none(ring, command):
    done = command("batch", "in", "-o", "out", "--no-cache", "--cache", "other")
    assert done.returncode == 2
    assert "--cache and --no-cache were given; omit one of them" in error_of(done)


PLACES = [
    ({"AOPRECALC_CACHE": "named"}, "named"),
    ({"AOPRECALC_CACHE": "/named", "XDG_CACHE_HOME": "/xdg", "HOME": "/home/me"}, "/named"),
    ({"AOPRECALC_CACHE": "", "XDG_CACHE_HOME": "/xdg", "HOME": "/home/me"}, "/xdg/aoprecalc"),
    ({"HOME": "/home/me"}, "/home/me/.cache/aoprecalc"),
    ({"XDG_CACHE_HOME": "", "HOME": "/home/me"}, "/home/me/.cache/aoprecalc"),
]


@pytest.mark.skipif(os.name != "posix", reason="places of POSIX systems")
@pytest.mark.parametrize(("environment", "place"), PLACES)
def test_the_place_of_the_users_cache(environment, place, monkeypatch):
    for name in ("AOPRECALC_CACHE", "XDG_CACHE_HOME", "LOCALAPPDATA", "HOME"):
        monkeypatch.delenv(name, raising=False)
    for name, value in environment.items():
        monkeypatch.setenv(name, value)
    assert default_cache() == Path(place)


@pytest.mark.skipif(os.name != "posix", reason="users of POSIX systems")
def test_a_user_without_a_home_has_a_cache_for_a_while(monkeypatch, tmp_path):
    """As in a container that runs under a number which no user has."""
    for name in ("AOPRECALC_CACHE", "XDG_CACHE_HOME", "LOCALAPPDATA", "HOME"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr("os.getuid", lambda: 4_000_000)
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    assert default_cache() == tmp_path / "aoprecalc"
