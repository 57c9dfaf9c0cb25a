"""Work in the background, in one thread beside the caller's."""

from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from types import TracebackType
from typing import ParamSpec, Self, TypeVar

_Item = TypeVar("_Item")
_Made = TypeVar("_Made")
_Arguments = ParamSpec("_Arguments")


class Background:
    """A thread that does what it is asked for, in that order, during a `with` block.

    So NumPy computes what is needed next while compiled code, which does not hold the interpreter's lock, runs on the
    other cores.
    """

    def __init__(self, *, inline: bool) -> None:
        """Start the thread; `inline`: there is none, and the caller does everything, at once."""
        self._thread = None if inline else ThreadPoolExecutor(1)
        self._waiting: list[Future[None]] = []

    def __enter__(self) -> Self:
        """Return itself."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Wait until all is done, and raise what was raised there; after an error do no more."""
        if self._thread is not None:
            self._thread.shutdown(cancel_futures=error is not None)
        if error is None:
            self._raise_errors()

    def do(self, function: Callable[_Arguments, None], *args: _Arguments.args, **named: _Arguments.kwargs) -> None:
        """Call a function, now or later. What it raises is raised by a later call, or at the end."""
        if self._thread is None:
            function(*args, **named)
            return
        self._raise_errors()
        self._waiting.append(self._thread.submit(function, *args, **named))

    def made_ahead(self, make: Callable[[_Item], _Made], items: Iterable[_Item]) -> Iterator[tuple[_Item, _Made]]:
        """Yield items and what is made of each, that of the next one while the caller works on this one."""
        if self._thread is None:
            yield from ((item, make(item)) for item in items)
            return
        before: tuple[_Item, Future[_Made]] | None = None
        for item in items:
            following = item, self._thread.submit(make, item)
            if before is not None:
                yield before[0], before[1].result()
            before = following
        if before is not None:
            yield before[0], before[1].result()

    def _raise_errors(self) -> None:
        for future in [future for future in self._waiting if future.done()]:
            self._waiting.remove(future)
            future.result()
