"""Work in the background is done in order, one step ahead, and its errors are raised."""

from threading import Event, get_ident

import pytest

from aoprecalc.visibility.gather import Background

PATIENCE = 60  # seconds, after which something that never happens counts as a failure

INLINE = pytest.mark.parametrize("inline", [True, False], ids=["inline", "in a thread"])


@INLINE
def test_what_is_made_comes_in_the_order_of_its_items(inline):
    with Background(inline=inline) as background:
        assert list(background.made_ahead(lambda item: item**2, iter([3, 1, 2]))) == [(3, 9), (1, 1), (2, 4)]
        assert list(background.made_ahead(lambda item: item, [])) == []


def test_the_next_item_is_made_while_the_caller_works_on_this_one():
    made = [Event() for _ in range(3)]

    def make(item):
        made[item].set()
        return get_ident()

    with Background(inline=False) as background:
        for item, thread in background.made_ahead(make, range(3)):
            assert thread != get_ident()
            assert item == 2 or made[item + 1].wait(PATIENCE)


def test_only_one_item_is_made_ahead():
    made = []
    with Background(inline=False) as background:
        items = background.made_ahead(made.append, range(5))
        next(items)
        done = Event()
        background.do(done.set)
        assert done.wait(PATIENCE)
        assert made == [0, 1]


@INLINE
def test_all_is_done_in_order_at_the_end(inline):
    done = []
    with Background(inline=inline) as background:
        for number in range(20):
            background.do(done.append, number)
    assert done == list(range(20))


@INLINE
def test_errors_are_raised(inline):
    with pytest.raises(ZeroDivisionError), Background(inline=inline) as background:
        background.do(lambda: 1 / 0)
    with pytest.raises(ZeroDivisionError), Background(inline=inline) as background:
        list(background.made_ahead(lambda item: 1 // item, [1, 0]))


def test_an_error_is_raised_by_the_next_call_once():
    done, called = Event(), []
    with Background(inline=False) as background:
        background.do(lambda: 1 / 0)
        list(background.made_ahead(lambda item: done.set(), [0]))
        assert done.is_set()
        with pytest.raises(ZeroDivisionError):
            background.do(called.append, 1)
        background.do(called.append, 2)
    assert called == [2]


def test_after_an_error_of_the_caller_what_waits_is_dropped(monkeypatch):
    started, release, done = Event(), Event(), []

    def block():
        started.set()
        assert release.wait(PATIENCE)

    def fail(background):
        end = background._thread.shutdown

        def release_at_the_end(**how):
            end(wait=False, **how)
            release.set()
            end()

        monkeypatch.setattr(background._thread, "shutdown", release_at_the_end)
        background.do(block)
        for number in range(100):
            background.do(done.append, number)
        assert started.wait(PATIENCE)
        raise KeyError

    with pytest.raises(KeyError), Background(inline=False) as background:
        fail(background)
    assert not done
