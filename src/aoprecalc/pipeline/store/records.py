"""What a batch remembers in its output folder: how each asset was made, so that it need not be made again.

`<output>/.aoprecalc` holds a record for each asset, what is being written (`staging`), and a lock. It may be deleted:
then everything is made again, or taken from the cache.
"""

import json
import os
import shutil
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from aoprecalc.errors import OutputError
from aoprecalc.pipeline.store.inputs import Inputs, Stamp

SCHEMA = 1
HOME = ".aoprecalc"


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
        file = self._file(name)
        file.parent.mkdir(parents=True, exist_ok=True)
        written = self.staging / f"record-{os.getpid()}"
        written.write_text(json.dumps({"schema": SCHEMA, **asdict(record)}), encoding="utf-8")
        os.replace(written, file)

    def names(self) -> list[str]:
        """Return the names of all recorded assets, sorted."""
        files = self._assets.rglob("*.json")
        return sorted(file.relative_to(self._assets).with_suffix("").as_posix() for file in files)

    def drop(self, name: str) -> None:
        """Forget an asset."""
        self._file(name).unlink(missing_ok=True)

    def outputs(self) -> set[Path]:
        """Return the files that all recorded assets have, with links followed."""
        found = set()
        for file in self._assets.rglob("*.json"):
            folder = self._output / file.relative_to(self._assets).parent
            if record := _read(file):
                found |= {Path(os.path.realpath(folder / name)) for name in record.outputs}
        return found

    def _file(self, name: str) -> Path:
        return self._assets / f"{name}.json"


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
    return {way: Stamp(**stamp) for way, stamp in table.items()}


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
