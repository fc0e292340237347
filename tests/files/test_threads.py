"""Work on many items at once."""

import threading
import time

import pytest
from usdfoliage.files.threads import map_ahead, map_threaded


@pytest.mark.parametrize("threads", [0, 1, 3])
def test_results_come_in_order(threads):
    def slow_first(number):
        time.sleep(0.01 * (number == 0))
        return number**2

    assert list(map_threaded(slow_first, range(20), threads=threads)) == [number**2 for number in range(20)]
    assert list(map_threaded(slow_first, [], threads=threads)) == []


def test_no_more_threads_than_asked_for():
    seen = set()

    def note(number):
        time.sleep(0.002)
        seen.add(threading.get_ident())

    list(map_threaded(note, range(30), threads=2))
    assert len(seen) <= 2


@pytest.mark.parametrize("threads", [1, 2])
def test_errors_come_out(threads):
    with pytest.raises(ZeroDivisionError):
        list(map_threaded(lambda number: 1 / number, [2, 1, 0], threads=threads))


@pytest.mark.parametrize("threads", [1, 3])
def test_few_items_are_taken_ahead(threads):
    taken = []

    def items():
        for number in range(20):
            taken.append(number)
            yield number

    for done, result in enumerate(map_ahead(lambda number: number**2, items(), threads)):
        assert result == done**2
        assert len(taken) <= done + 1 + threads
    assert len(taken) == 20
