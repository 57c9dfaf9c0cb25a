"""Output files that appear whole, all together, or not at all."""

import os
import secrets
from contextlib import AbstractContextManager, suppress
from pathlib import Path
from types import TracebackType

from aoprecalc.errors import OutputError


class Outputs(AbstractContextManager["Outputs"]):
    """A set of files that are written beside their places and moved there at the end of the `with` block.

    If the block raises, nothing has changed on disk: what was written is removed and earlier files
    of the same names are as they were.

        with Outputs() as outputs:
            write_something(outputs.path("build/rock_ao.png"))
    """

    def __init__(self) -> None:
        """Start with no files."""
        self._pending: dict[Path, Path] = {}
        self._folders: list[Path] = []

    def folder(self, path: str | os.PathLike[str]) -> Path:
        """Make a folder where it is missing, with those above it; they are removed again if the block fails.

        Raises OutputError where that is not possible.
        """
        folder = Path(path)
        missing = [parent for parent in (folder, *folder.parents) if not parent.exists()]
        try:
            for parent in reversed(missing):
                parent.mkdir()
                self._folders.append(parent)
        except OSError as error:
            reason = error.strerror or str(error)
            raise OutputError(f"{folder}: the folder cannot be made ({reason}); choose another output") from error
        return folder

    def written(self, final: str | os.PathLike[str]) -> Path:
        """Return where the contents of `final` are now: under its temporary path if it is one of these files."""
        return self._pending.get(Path(final), Path(final))

    def claim(self, final: str | os.PathLike[str]) -> None:
        """Make sure, before long work, that `final` can be written.

        Raises OutputError as `path` does; leaves no file.
        """
        self.path(final).unlink()
        del self._pending[Path(final)]

    def path(self, final: str | os.PathLike[str]) -> Path:
        """Return the temporary path (same folder, same extension) under which `final` is to be written now.

        Raises OutputError where the folder is missing or cannot be written, and where `final` is a folder.
        """
        target = Path(final)
        if target in self._pending:
            return self._pending[target]
        if target.is_dir():
            raise OutputError(f"{target}: is a folder, a file name was expected; name a file inside it")
        if not target.parent.is_dir():
            raise OutputError(f"{target}: there is no folder {target.parent}; create it or choose another output")
        temporary = target.with_name(f".{secrets.token_hex(6)}.{target.name}")
        try:
            temporary.touch(exist_ok=False)
        except OSError as error:
            raise OutputError(
                f"{target}: cannot write there ({error.strerror}); choose another output or change its permissions"
            ) from error
        self._pending[target] = temporary
        return temporary

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Move every file to its place, or remove them all if the block failed."""
        try:
            if kind is None:
                self._commit()
                self._folders.clear()
        finally:
            for temporary in self._pending.values():
                with suppress(OSError):
                    temporary.unlink(missing_ok=True)
            for folder in reversed(self._folders):
                with suppress(OSError):
                    folder.rmdir()

    def _commit(self) -> None:
        for target, temporary in self._pending.items():
            try:
                os.replace(temporary, target)
            except OSError as error:
                raise OutputError(f"{target}: cannot be replaced ({error.strerror}); choose another output") from error
