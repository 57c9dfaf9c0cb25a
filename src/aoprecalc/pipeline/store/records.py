"""What a batch remembers in its output folder: how each asset was made, so that it need not be made again.

`<output>/.aoprecalc` holds a record for each asset, what is being written (`staging`), and a lock. It may be deleted:
then everything is made again, or taken from the cache.
"""

import json
import os
import shutil
from collections import Counter
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from aoprecalc.errors import OutputError
from aoprecalc.pipeline.store.inputs import Inputs, Stamp

SCHEMA = 2
HOME = ".aoprecalc"

_SUFFIX = ".asset.json"  # as no folder is called that assets lie in


@dataclass(frozen=True)
class Record:
    """How an asset was made.

    order     the key of its order
    inputs    what it was made from
    outputs   its files: name in the asset's folder -> how it was written
    summary   of what was made, for tables and reports
    """

    order: str
    inputs: Inputs
    outputs: dict[str, Stamp]
    summary: dict[str, Any]


class Records:
    """The records of an output folder."""

    def __init__(self, output: Path) -> None:
        """Look into a folder, which need not exist."""
        self._output = output
        self._home = output / HOME
        self._assets = self._home / "assets"
        self.staging = self._home / "staging"
        self._holders: Counter[Path] | None = None  # a file -> how many assets have it; None: nobody has asked

    @contextmanager
    def held(self) -> Iterator[None]:
        """Make the folder and keep it from other batches for a `with` block; what a killed one left is removed.

        Raises OutputError where that is not possible.
        """
        with ExitStack() as stack:
            try:
                self._home.mkdir(parents=True, exist_ok=True)
                stack.enter_context(_locked(self._home / "lock"))
                shutil.rmtree(self.staging, ignore_errors=True)
                self.staging.mkdir()
            except BlockingIOError as error:
                found = f"{self._output}: another batch writes there"
                raise OutputError(f"{found}; wait for it, or choose another -o") from error
            except OSError as error:
                reason = error.strerror or str(error)
                raise OutputError(f"{self._output}: cannot be written ({reason}); choose another output") from error
            stack.callback(shutil.rmtree, self.staging, ignore_errors=True)
            yield

    def get(self, name: str) -> Record | None:
        """Return the record of an asset; None where there is none that can be understood."""
        return _read(self._file(name))

    def put(self, name: str, record: Record) -> None:
        """Write the record of an asset."""
        self._count(name, self.get(name), -1)
        self._count(name, record, 1)
        file = self._file(name)
        file.parent.mkdir(parents=True, exist_ok=True)
        written = self.staging / f"record-{os.getpid()}"
        written.write_text(json.dumps({"schema": SCHEMA, **asdict(record)}), encoding="utf-8")
        os.replace(written, file)

    def names(self) -> list[str]:
        """Return the names of all recorded assets, sorted."""
        files = self._assets.rglob(f"*{_SUFFIX}")
        return sorted(file.relative_to(self._assets).as_posix().removesuffix(_SUFFIX) for file in files)

    def drop(self, name: str) -> None:
        """Forget an asset."""
        self._count(name, self.get(name), -1)
        self._file(name).unlink(missing_ok=True)

    def folder(self, name: str) -> Path:
        """Return the folder that an asset's files lie in."""
        return (self._output / name).parent

    def outputs(self) -> set[Path]:
        """Return the files that recorded assets have, with links followed."""
        return {Path(os.path.realpath(file)) for file in self._held()}

    def has(self, file: Path) -> bool:
        """Tell whether a file, named by its asset's folder, is one that a recorded asset has."""
        if self._holders is None:
            self._holders = self._held()
        return self._holders[file] > 0

    def _held(self) -> Counter[Path]:
        found: Counter[Path] = Counter()
        for name in self.names():
            if record := self.get(name):
                found.update(self.folder(name) / output for output in record.outputs)
        return found

    def _count(self, name: str, record: Record | None, by: int) -> None:
        """Keep the number of holders, where it is known."""
        if self._holders is not None and record is not None:
            for output in record.outputs:
                self._holders[self.folder(name) / output] += by

    def _file(self, name: str) -> Path:
        return self._assets / f"{name}{_SUFFIX}"


def _read(file: Path) -> Record | None:
    try:
        document = json.loads(file.read_bytes())
        if document["schema"] != SCHEMA:
            return None
        inputs = Inputs(_stamps(document["inputs"]["files"]))
        return Record(document["order"], inputs, _stamps(document["outputs"]), document["summary"])
    except (OSError, ValueError, KeyError, TypeError, AttributeError):  # missing, damaged, or of another version
        return None


def _stamps(table: dict[str, Any]) -> dict[str, Stamp]:
    return {
        way: Stamp(stamp["size"], stamp["times"] and (int(stamp["times"][0]), int(stamp["times"][1])), stamp["digest"])
        for way, stamp in table.items()
    }


@contextmanager
def _locked(file: Path) -> Iterator[None]:
    """Hold a lock that ends with this process, however that ends; raises BlockingIOError where another holds it."""
    try:
        import fcntl
    except ModuleNotFoundError:  # Windows
        yield
        return
    with file.open("w") as held:
        fcntl.flock(held, fcntl.LOCK_EX | fcntl.LOCK_NB)
        yield
