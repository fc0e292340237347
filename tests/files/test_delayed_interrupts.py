"""A block that is interrupted ends, and then the interrupt comes."""

import os
import signal
import threading

import pytest
from usdfoliage.files.delayed_interrupts import interrupts_delayed


@pytest.fixture
def interrupting():
    """Ctrl-C and SIGTERM interrupt, whatever other tests made of them."""
    earlier = {each: signal.signal(each, signal.default_int_handler) for each in (signal.SIGINT, signal.SIGTERM)}
    yield
    for each, handler in earlier.items():
        signal.signal(each, handler)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.usefixtures("interrupting")
def test_the_block_ends_first(number):
    done = []

    def run():
        os.kill(os.getpid(), number)
        done.append(True)

    with pytest.raises(KeyboardInterrupt), interrupts_delayed():
        run()
    assert done == [True]
    assert signal.getsignal(number) is signal.default_int_handler


@pytest.mark.usefixtures("interrupting")
def test_nothing_comes_where_nothing_came():
    with interrupts_delayed():
        pass
    with pytest.raises(ValueError, match="as raised"), interrupts_delayed():
        raise ValueError("as raised")
    assert signal.getsignal(signal.SIGTERM) is signal.default_int_handler


def test_a_signal_that_is_ignored_stays_ignored():
    earlier = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        with interrupts_delayed():
            os.kill(os.getpid(), signal.SIGHUP)
        assert signal.getsignal(signal.SIGHUP) == signal.SIG_IGN
    finally:
        signal.signal(signal.SIGHUP, earlier)


def test_another_thread_runs_the_block_too():
    done = []

    def run():
        with interrupts_delayed():
            done.append(True)

    thread = threading.Thread(target=run)
    thread.start()
    thread.join()
    assert done == [True]
