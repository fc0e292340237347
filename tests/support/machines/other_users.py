"""Functions run as an ordinary user, in a process of its own."""

import os
import pickle
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TypeVar

import pytest

OTHER = 65534  # nobody

T = TypeVar("T")


@contextmanager
def folder_of_all() -> Iterator[Path]:
    """A folder in which every user may make things; those of pytest are closed to others."""
    with tempfile.TemporaryDirectory(prefix="usdfoliage-test-") as name:
        folder = Path(name)
        folder.chmod(0o777)
        yield folder


def as_other_user(function: Callable[[], T]) -> T:
    """What a function returns, or raises, as another user than root; skips the test where that is not allowed."""
    if os.geteuid() != 0:
        pytest.skip("only root can act as another user")
    read, write = os.pipe()
    pid = os.fork()
    if not pid:
        code = 1
        try:
            os.setgroups([])
            os.setgid(OTHER)
            os.setuid(OTHER)
            try:
                result: tuple[bool, object] = (True, function())
            except Exception as error:  # noqa: BLE001  # it is raised again in the test
                result = (False, error)
            os.write(write, pickle.dumps(result))
            code = 0
        finally:
            os._exit(code)
    os.close(write)
    with os.fdopen(read, "rb") as file:
        data = file.read()
    os.waitpid(pid, 0)
    is_good, value = pickle.loads(data)
    if not is_good:
        raise value
    return value  # type: ignore[no-any-return]
