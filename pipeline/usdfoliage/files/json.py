"""Reading JSON that others may have written or damaged: no content exhausts the reader's stack or time."""

import json
from pathlib import Path
from typing import Any


def read_json(path: Path) -> Any:
    """What a file holds.

    Raises:
        OSError: It is missing, a folder, or cannot be read.
        ValueError: It is no JSON, no regular file, or too deep; the message states why and does not name the file.
    """
    if path.exists() and not (path.is_file() or path.is_dir()):  # a pipe would be waited for
        raise ValueError("it is no regular file")
    try:
        return json.loads(path.read_bytes())
    except RecursionError as error:
        raise ValueError("its lists or tables are too deep") from error
