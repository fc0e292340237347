"""What `usdfoliage env` prints, evaluated by real shells, and what the rez package sets."""

import json
import os
import runpy
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
import usdfoliage
from usdfoliage.__main__ import main
from usdfoliage.asset import resources
from usdfoliage.cli import env

ROOT = Path(__file__).parents[2]
PLUGINS = [
    str(ROOT / folder)
    for folder in ("schemas/usdFoliage", "usd_plugins/usdFoliageValidators", "usd_plugins/usdviewFoliage")
]
MODULES = [str(ROOT / "usd_plugins"), str(ROOT / "pipeline")]
AWKWARD = ["/a folder/with 'quotes'", '/and "these" $HOME']


def evaluate(shell: str, script: str, before: dict[str, str]) -> dict[str, str]:
    """The variables after a shell has run the script."""
    clean = {name: value for name, value in os.environ.items() if name not in ("PXR_PLUGINPATH_NAME", "PYTHONPATH")}
    show = "import json, os; print(json.dumps(dict(os.environ)))"
    command = f"{script}\n{sys.executable} -S -c '{show}'"
    flags = ["-f", "-c"] if "csh" in shell else ["-c"]
    outcome = subprocess.run(
        [shell, *flags, command], env={**clean, **before}, capture_output=True, text=True, check=True
    )
    after: dict[str, str] = json.loads(outcome.stdout)
    return after


def shells() -> list[tuple[str, str]]:
    """(shell, syntax) of those that this machine has."""
    known = {"sh": "sh", "dash": "sh", "bash": "sh", "zsh": "sh", "csh": "csh", "tcsh": "csh", "fish": "fish"}
    return [(path, syntax) for name, syntax in known.items() if (path := shutil.which(name))]


def test_printed_lines_set_both_variables(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["env"]) == 0
    after = evaluate("sh", capsys.readouterr().out, {})
    assert after["PXR_PLUGINPATH_NAME"].split(os.pathsep) == PLUGINS
    assert after["PYTHONPATH"].split(os.pathsep) == MODULES


def test_usd_finds_schemas_and_validators_through_them(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["env"]) == 0
    program = (
        "from pxr import Usd, UsdValidation\n"
        "assert Usd.SchemaRegistry().FindAppliedAPIPrimDefinition('FoliageCrownAPI')\n"
        "assert UsdValidation.ValidationRegistry().GetOrLoadValidatorByName('usdFoliageValidators:Crown')\n"
    )
    script = f'{capsys.readouterr().out}\n{sys.executable} -c "{program}"'
    subprocess.run(["sh", "-c", script], check=True)


@pytest.mark.parametrize(("shell", "syntax"), shells())
def test_quoting_and_earlier_values_of_the_variables(shell: str, syntax: str) -> None:
    folders = [folder for folder in AWKWARD if not (syntax == "csh" and "$" in folder)]
    script = env.FORMATS[syntax]({"PXR_PLUGINPATH_NAME": folders})
    joined = os.pathsep.join(folders)
    assert evaluate(shell, script, {})["PXR_PLUGINPATH_NAME"] == joined
    assert evaluate(shell, script, {"PXR_PLUGINPATH_NAME": ""})["PXR_PLUGINPATH_NAME"] == joined
    old = "/one of mine:/another"
    assert evaluate(shell, script, {"PXR_PLUGINPATH_NAME": old})["PXR_PLUGINPATH_NAME"] == f"{joined}{os.pathsep}{old}"


def test_fish_text() -> None:
    assert env.format_fish({"PYTHONPATH": ["/a b", "/it's \\ here"]}) == (
        'if test -n "$PYTHONPATH"; set -gx PYTHONPATH \'/a b:/it\\\'s \\\\ here:\'"$PYTHONPATH"; '
        "else; set -gx PYTHONPATH '/a b:/it\\'s \\\\ here'; end"
    )


def test_csh_and_powershell_text(capsys: pytest.CaptureFixture[str]) -> None:
    """Where neither shell is installed, at least the words."""
    assert main(["env", "--shell", "csh"]) == 0
    for line in capsys.readouterr().out.splitlines():
        assert line.startswith("if ( ")
        assert line.endswith(" ;")
    text = env.format_powershell({"PYTHONPATH": ["/a b", "/it's"]})
    separator = os.pathsep
    assert text == (
        f"$env:PYTHONPATH = '/a b{separator}/it''s' + \"$(if ($env:PYTHONPATH) {{ '{separator}' + $env:PYTHONPATH }})\""
    )


def test_json(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["env", "--shell", "json"]) == 0
    assert json.loads(capsys.readouterr().out) == {"PXR_PLUGINPATH_NAME": PLUGINS, "PYTHONPATH": MODULES}


@pytest.mark.parametrize(
    ("version", "announced"), [("26.8", True), ("26.08", True), ("0.26.11", True), ("26.3", False), ("v25.08.1", False)]
)
def test_validators_are_announced_where_they_can_load(capsys, version, announced):
    assert main(["env", "--shell", "json", "--usd", version]) == 0
    folders = json.loads(capsys.readouterr().out)["PXR_PLUGINPATH_NAME"]
    assert folders == (PLUGINS if announced else [PLUGINS[0], PLUGINS[2]])


@pytest.mark.parametrize("version", ["", "usd", "8", "26.x", "1.2"])
def test_what_is_no_version_of_usd_is_refused(capsys, version):
    with pytest.raises(SystemExit) as ended:
        main(["env", "--usd", version])
    assert ended.value.code == 2
    assert "is no version of USD, such as 25.8" in capsys.readouterr().err


def installed(tmp_path: Path) -> Path:
    """The folders of an installed package, as the build lays them out."""
    package = tmp_path / "site-packages" / "usdfoliage"
    for folder in ("schemas", "usd_plugins"):
        shutil.copytree(ROOT / folder, package / "share" / folder)
    return package


def test_installed_package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    package = installed(tmp_path)
    monkeypatch.setattr(resources, "_PACKAGE", package)
    monkeypatch.setattr(resources, "_PLACES", (package.parents[1], package / "share"))
    share = package / "share"
    assert resources.plugin_folders() == (share / "schemas/usdFoliage", share / "usd_plugins/usdFoliageValidators")
    assert resources.plugin_path_folders() == (*resources.plugin_folders(), share / "usd_plugins/usdviewFoliage")
    assert resources.python_folders() == (share / "usd_plugins",)


def test_usdviews_plugin_finds_how_looks_are_written_in_an_installed_package(tmp_path: Path) -> None:
    package = installed(tmp_path)
    program = "from usdviewFoliage import look_layer; print(look_layer._module.__file__)"

    def load() -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            [sys.executable, "-c", program],
            env={**os.environ, "PYTHONPATH": str(package / "share" / "usd_plugins")},
            capture_output=True,
            text=True,
            check=False,
        )

    assert "leave usd_plugins where usdfoliage was installed" in load().stderr
    (package / "asset").mkdir()
    wanted = package / "asset" / "look_layer.py"
    shutil.copy(Path(usdfoliage.__file__).parent / "asset" / "look_layer.py", wanted)
    assert load().stdout.strip() == str(wanted)


def test_a_broken_installation_is_reported(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(resources, "_PLACES", (tmp_path,))
    assert main(["env"]) == 2
    assert "install usdfoliage again" in capsys.readouterr().err


class FakeVariable:
    """A path variable as rez gives it to commands()."""

    def __init__(self) -> None:
        self.folders: list[str] = []

    def prepend(self, folder: str) -> None:
        self.folders.insert(0, folder)


class FakeEnvironment:
    """rez's `env`: a variable for every name."""

    def __init__(self) -> None:
        self.variables: dict[str, FakeVariable] = {}

    def __getattr__(self, name: str) -> FakeVariable:
        return self.variables.setdefault(name, FakeVariable())


def test_rez_package(tmp_path: Path) -> None:
    environment = FakeEnvironment()
    package = runpy.run_path(str(ROOT / "package.py"), init_globals={"env": environment})
    package["commands"]()
    assert package["name"] == "usdfoliage"
    assert package["version"] == usdfoliage.__version__
    assert any(requirement.startswith("usd_core-26.11") for requirement in package["requires"])
    assert ["python-3.11"] in package["variants"]

    (tmp_path / "python").mkdir()
    shutil.copytree(installed(tmp_path), tmp_path / "python" / "usdfoliage")
    set_folders = {
        name: [Path(folder.format(root=tmp_path)) for folder in variable.folders]
        for name, variable in environment.variables.items()
    }
    assert set(set_folders) == {"PATH", "PYTHONPATH", "PXR_PLUGINPATH_NAME"}
    assert [path.is_dir() for path in set_folders["PYTHONPATH"]] == [True, True]
    assert [(path / "plugInfo.json").is_file() for path in set_folders["PXR_PLUGINPATH_NAME"]] == [True] * 3


def test_rez_package_requires_what_the_project_requires() -> None:
    import tomllib

    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    package = runpy.run_path(str(ROOT / "package.py"), init_globals={"env": FakeEnvironment()})
    plain = {requirement.split("-")[0].lower() for requirement in package["requires"]}
    assert plain == {requirement.split(">")[0].replace("-", "_").lower() for requirement in project["dependencies"]}
