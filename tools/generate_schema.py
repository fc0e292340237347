"""Make generatedSchema.usda and plugInfo.json from schemas/usdFoliage/schema.usda.

usage: .venv/bin/python tools/generate_schema.py [-o FOLDER]

Runs the usdGenSchema that ships in usd-core and fills in where plugInfo.json finds its files: beside itself. The same
schema.usda gives the same bytes.
"""

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

SCHEMA_FOLDER = Path(__file__).resolve().parents[1] / "schemas" / "usdFoliage"
GENERATED = ("generatedSchema.usda", "plugInfo.json")
PLACEHOLDERS = {
    "@PLUG_INFO_LIBRARY_PATH@": "",
    "@PLUG_INFO_RESOURCE_PATH@": ".",
    "@PLUG_INFO_ROOT@": ".",
}


def generate_schema(source: Path, folder: Path) -> None:
    """Write GENERATED into folder.

    Raises:
        SystemExit: usdGenSchema refused the source; its message is on stderr.
    """
    # An installed copy of the very schema that is generated would clash with it.
    environment = {name: value for name, value in os.environ.items() if name != "PXR_PLUGINPATH_NAME"}
    # usdGenSchema merges with a plugInfo.json that it finds, so it gets an empty folder.
    with tempfile.TemporaryDirectory() as empty:
        outcome = subprocess.run(
            [sys.executable, "-m", "pxr.Usd.usdGenSchema", str(source), empty],
            env=environment,
            capture_output=True,
            text=True,
            check=False,
        )
        if outcome.returncode != 0:
            print(outcome.stdout + outcome.stderr, file=sys.stderr)
            raise SystemExit(f"error: usdGenSchema refused {source}; its message is above")
        plug_info = Path(empty, "plugInfo.json")
        text = plug_info.read_text(encoding="utf-8")
        for placeholder, value in PLACEHOLDERS.items():
            text = text.replace(placeholder, value)
        plug_info.write_text(text, encoding="utf-8")
        folder.mkdir(parents=True, exist_ok=True)
        for name in GENERATED:
            shutil.copyfile(Path(empty, name), folder / name)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("-o", "--output", type=Path, default=SCHEMA_FOLDER, help="folder to write to")
    generate_schema(SCHEMA_FOLDER / "schema.usda", parser.parse_args().output)


if __name__ == "__main__":
    main()
