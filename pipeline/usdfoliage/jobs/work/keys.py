"""The keys of results: hashes of the code and of all that a result was made of."""

import functools

from usdfoliage import __version__
from usdfoliage.files.code import digest_code
from usdfoliage.files.hashing import digest_values

# What depth and maps of a capture are made by: a test follows the imports.
CODE_OF_RESULTS = (
    "[!_]*.py",
    "files/**/*",
    "geometry/**/*",
    "capture/**/*",
    "jobs/capture/depth_tasks.py",
    "jobs/capture/maps.py",
    "jobs/capture/settings.py",
    "jobs/work/**/*",
)


def task_key(*parts: object) -> str:
    """The name of a result: a hash of this code and of all that went into it.

    Args:
        parts: Numbers, texts, arrays, None, sequences of them, and dataclasses of them, whose threads do not count.

    Raises:
        TypeError: A part is of another kind.
    """
    return digest_values(code_version(), *parts)[:32]


@functools.cache
def code_version() -> str:
    """The version, and a hash of the code that measures: a build between two versions is another one."""
    return f"{__version__} {digest_code(CODE_OF_RESULTS)}"
