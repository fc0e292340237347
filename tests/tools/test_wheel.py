"""The wheel works where nothing else of ours is."""

import subprocess
import zipfile
from pathlib import Path

import pytest

from tools.check_wheel import ROOT, find_missing

NEEDED = (
    "usdfoliage/branch/foliage/species.toml",
    "usdfoliage/jobs/report/templates/plant.html",
    "usdfoliage/share/schemas/usdFoliage/generatedSchema.usda",
    "usdfoliage/share/usd_plugins/usdFoliageValidators/plugInfo.json",
    "usdfoliage/share/usd_plugins/usdFoliageShaders/usdFoliageLeaf.glslfx",
    "usdfoliage/share/hydra_preview/record.py",
)


def test_a_wheel_without_a_file_of_the_package_is_found_out(tmp_path: Path) -> None:
    wheel = tmp_path / "usdfoliage-0-py3-none-any.whl"
    with zipfile.ZipFile(wheel, "w") as archive:
        archive.writestr("usdfoliage/__init__.py", "")
    missing = find_missing(wheel)
    assert set(NEEDED) <= set(missing)
    assert "usdfoliage/__init__.py" not in missing
    assert not [name for name in missing if name.endswith((".pyc", ".so"))]


@pytest.mark.slow
@pytest.mark.timeout(1800)
def test_a_wheel_is_built_and_runs_in_an_empty_environment(tmp_path: Path) -> None:
    command = [str(ROOT / "tools" / "wheel.sh"), "--no-isolation", str(tmp_path / "wheel")]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    (wheel,) = (tmp_path / "wheel").glob("*.whl")
    assert f"{wheel.name}: installed into an empty environment" in done.stdout
    with zipfile.ZipFile(wheel) as archive:
        assert set(NEEDED) <= set(archive.namelist())
