"""Reading JSON that others may have written or damaged: no content exhausts the reader's stack or time."""

import json
from pathlib import Path
from typing import Any

from usdfoliage.files.reading import IrregularFileError, read_regular


def read_json(path: Path) -> Any:
    """What a file holds.

    Raises:
        OSError: It is missing, a folder, or cannot be read.
        ValueError: It is no JSON, no regular file, or too deep; the message states why and does not name the file.
    """
    try:
        return json.loads(read_regular(path))
    except IrregularFileError as error:
        raise ValueError(error.strerror) from error
    except RecursionError as error:
        raise ValueError("its lists or tables are too deep") from error
