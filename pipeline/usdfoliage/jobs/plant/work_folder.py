"""Which folder keeps the results of a build's tasks."""

import os
from pathlib import Path

WORK_VARIABLE = "USDFOLIAGE_WORK"
BESIDE_ASSET = ".usdfoliage"


def find_work_folder(named: Path | None, output: Path) -> Path:
    """The folder that the user names, else that of the environment variable, else one beside the asset; absolute."""
    chosen = named or os.environ.get(WORK_VARIABLE)
    return Path(chosen).absolute() if chosen else output.absolute().parent / BESIDE_ASSET
