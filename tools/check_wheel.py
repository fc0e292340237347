"""Install a wheel of usdfoliage into an empty environment, and run the commands and the examples of the API there."""

import argparse
import json
import os
import subprocess
import sys
import tempfile
import venv
import zipfile
from pathlib import Path

from tools.page_code import python_program

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = ROOT / "pipeline" / "usdfoliage"
SHARED = ("schemas", "usd_plugins", "hydra_preview")  # folders that travel in usdfoliage/share


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("wheel", type=Path, metavar="WHEEL")
    wheel = parser.parse_args().wheel.resolve()
    missing = find_missing(wheel)
    if missing:
        print(f"error: {wheel.name} lacks {', '.join(missing)}", file=sys.stderr)
        return 1
    with tempfile.TemporaryDirectory(prefix="usdfoliage-wheel-") as folder:
        program = install(wheel, Path(folder) / "environment")
        run_commands(program, Path(folder) / "commands")
        run_examples(program, Path(folder) / "examples")
    print(f"{wheel.name}: installed into an empty environment; commands and examples of the API ran")
    return 0


def find_missing(wheel: Path) -> list[str]:
    """The files of the package and of what it loads that are not in the wheel."""
    with zipfile.ZipFile(wheel) as archive:
        packed = set(archive.namelist())
    wanted = {f"usdfoliage/{path.relative_to(PACKAGE).as_posix()}" for path in tracked(PACKAGE)}
    for name in SHARED:
        wanted |= {f"usdfoliage/share/{path.relative_to(ROOT).as_posix()}" for path in tracked(ROOT / name)}
    return sorted(wanted - packed)


def tracked(folder: Path) -> list[Path]:
    """Every file below a folder but what Python and compilers leave there."""
    return [
        path
        for path in folder.rglob("*")
        if path.is_file() and "__pycache__" not in path.parts and path.suffix not in (".pyc", ".so")
    ]


def install(wheel: Path, environment: Path) -> Path:
    """Make an environment and install the wheel with what it needs; returns the folder of its programs."""
    venv.create(environment, with_pip=True)
    python = environment / "bin" / "python"
    run([str(python), "-m", "pip", "install", "--quiet", "--disable-pip-version-check", str(wheel)], environment)
    return environment / "bin"


def run_commands(programs: Path, folder: Path) -> None:
    """Make leaves, a look over them, and read both."""
    folder.mkdir()
    usdfoliage = str(programs / "usdfoliage")
    run([usdfoliage, "scatter", "-n", "60", "--seed", "1", "-o", "spray"], folder)
    run([usdfoliage, "edit", "spray", "--width", "1.3", "--bend", "0.3", "-o", "look.usda"], folder)
    for asset in ("spray", "look.usda"):
        info = json.loads(run([usdfoliage, "info", asset, "--json"], folder))
        assert info["leaves"]["count"] == 60, info["leaves"]
        run([usdfoliage, "validate", asset], folder)
    run([usdfoliage, "bake", "look.usda", "-o", "baked"], folder)


def run_examples(programs: Path, folder: Path) -> None:
    """Run the program of docs/python_api.md."""
    folder.mkdir()
    (folder / "page.py").write_text(python_program(ROOT / "docs" / "python_api.md"), encoding="utf-8")
    run([str(programs / "python"), "page.py"], folder)


def run(command: list[str], folder: Path) -> str:
    """What a program prints; it finds nothing of this checkout. RuntimeError where it fails."""
    kept = {name: os.environ[name] for name in ("HOME", "PATH", "LANG", "SSL_CERT_FILE") if name in os.environ}
    kept |= {name: value for name, value in os.environ.items() if name.lower().endswith("_proxy")}
    kept |= {name: value for name, value in os.environ.items() if name.startswith("PIP_")}
    done = subprocess.run(command, cwd=folder, env=kept, capture_output=True, text=True, check=False)
    if done.returncode:
        words = " ".join([Path(command[0]).name, *command[1:]])
        raise RuntimeError(f"{words} ended with {done.returncode}:\n{done.stdout}{done.stderr}")
    return done.stdout


if __name__ == "__main__":
    sys.exit(main())
