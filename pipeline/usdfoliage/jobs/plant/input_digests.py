"""Digests of the files that something is made of, remembered in the work folder, so that each is read once."""

import json
import logging
from collections.abc import Mapping
from pathlib import Path
from typing import Literal

from usdfoliage.errors import CaptureError
from usdfoliage.files.hashing import digest_file
from usdfoliage.files.json import read_json
from usdfoliage.jobs.plant.store import Store
from usdfoliage.jobs.work.keys import task_key
from usdfoliage.jobs.work.results import write_whole

logger = logging.getLogger(__name__)

DigestBy = Literal["bytes", "memory", "files", "names"]  # as find_inputs has it
_UNREAD = ""  # digest of a file that nobody looked at


def digest_inputs(
    source: Path, files: Mapping[str, Path], store: Store, digest_by: DigestBy, part: str = ""
) -> tuple[tuple[str, str], ...]:
    """Name and digest of every file, sorted; in a quick look those that nobody remembers have none.

    What is remembered of some part of the files has a place of its own.

    Raises:
        CaptureError: A file cannot be read.
        WriteError: The work folder cannot be written.
    """
    memory = store.folder / "digests" / f"{task_key(str(source.resolve()), part)}.json"
    known = _read_memory(memory)
    digests: dict[str, str] = {}
    remembered: dict[str, list[object]] = {}
    for name, path in sorted(files.items()):
        try:
            seen = path.stat()
        except OSError as error:
            raise CaptureError(f"{path} cannot be read: {error.strerror}", "check its permissions") from error
        mark: list[object] = [seen.st_size, seen.st_mtime_ns, seen.st_ino]
        stored = known.get(name)
        if digest_by != "bytes" and stored and stored[:3] == mark:
            digests[name] = str(stored[3])
        else:
            digests[name] = _UNREAD if digest_by == "names" else digest_file(path)
        remembered[name] = [*mark, digests[name]]
    if digest_by in ("bytes", "memory") and remembered != known:
        write_whole(memory, json.dumps(remembered, indent=1).encode())
    return tuple(sorted(digests.items()))


def _read_memory(path: Path) -> dict[str, list[object]]:
    try:
        stored = read_json(path)
        return {str(name): list(value) for name, value in stored.items() if len(value) == 4}
    except FileNotFoundError:
        return {}
    except (OSError, ValueError, TypeError, AttributeError) as error:
        logger.info("%s is damaged (%s) and is made again", path, error)
        return {}
