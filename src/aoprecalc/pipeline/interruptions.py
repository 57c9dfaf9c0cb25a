"""Ctrl-C and requests to end, held back while something must not be cut in two."""

import signal
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager

_NUMBERS = (signal.SIGINT, signal.SIGTERM)


@contextmanager
def held_back() -> Iterator[None]:
    """Have an interruption that comes in a `with` block take effect at the block's end.

    Only handlers written in Python are held back, as those that raise KeyboardInterrupt are; a signal that ends the
    process at once still does. Outside the main thread, where no handler runs, nothing has to be done.
    """
    with ExitStack() as stack:
        for number in _NUMBERS:
            stack.enter_context(_held_back(number))
        yield


@contextmanager
def _held_back(number: signal.Signals) -> Iterator[None]:
    handler = signal.getsignal(number)
    came = False

    def note(*_: object) -> None:
        nonlocal came
        came = True

    try:
        if callable(handler):
            try:
                signal.signal(number, note)
            except ValueError:  # not the main thread
                handler = None
        yield
    finally:
        if callable(handler):
            signal.signal(number, handler)
            if came:
                signal.raise_signal(number)
