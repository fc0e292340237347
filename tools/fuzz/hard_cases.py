"""Good files, and a machine that refuses: no room for what is written, for temporary files, and folders of others.

And children of a command that somebody kills.
"""

import os
import shutil
import signal
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

import numpy as np

from tools.fuzz.cases import CHILDREN_KILLED, Case
from tools.fuzz.hardship import TEMPORARY, fill_temporary, limit_files, obey_permissions
from tools.fuzz.killing import end_own_child

_SMALL = ("--size", "32", "--mesh-size", "17", "--no-preview")
_COMMANDS = (
    ("scatter", "-n", "2", "--texture", "photo/oak alpha.png", "-o", "out"),
    ("crown", "photo/oak.png", "--mask", "photo/mask.png", *_SMALL, "-o", "out"),
    ("branches", "cloud/tree.ply", "--no-preview", "-o", "out"),
    ("leaves", "bed", "--no-preview", "-o", "out"),
    ("capture", "bed", "--settings", "bed/fast.toml", "--no-report", "-o", "out"),
    ("edit", "plants/spray", "--width", "2", "-o", "out.usda"),
    ("bake", "plants/look.usda", "-o", "out"),
    ("submit", "bed", "-o", "plant", "--template", "out.yaml", "--bundle", "out"),
)
_MORE = (
    ("info", "plants/spray"),
    ("validate", "plants/spray"),
    ("validate", "plants/tree"),
    ("build", "bed", "-o", "out/bed", "--work", "work", "--dry-run"),
    ("batch", "library/list.txt", "-o", "out", "--dry-run"),
    ("branches", "cloud/tree.ply", "--leaves", "plants/spray", "--no-preview", "-o", "out"),
    ("preview", "plants/spray", "-o", "out.png", "--size", "32", "32"),
)
_WITH_CHILDREN = (
    ("edit", "plants/spray", "--width", "2", "-o", "out.usda"),
    ("bake", "plants/look.usda", "-o", "out"),
    ("info", "plants/spray"),
    ("validate", "plants/spray"),
    ("preview", "plants/spray", "--size", "64", "64", "-o", "out.png"),
    ("crown", "photo/oak.png", "--mask", "photo/mask.png", "--size", "32", "--mesh-size", "17", "-o", "out"),
)
_DELAYS_S = (0.1, 0.6, 1.5)
_TREES = ("photo", "cloud", "bed", "plants")
_ALL_TREES = (*_TREES, "library", "toml", "work")
_CLOSED = (0o000, 0o111, 0o444, 0o555)  # of folders: nothing, pass, list, list and pass
_LIMITS_KIB = (1, 4, 12, 40)
_OTHER = 65534
_SHARE = 0.5  # of the folders that are closed
_TIMES = 4  # of each command, with other folders closed


def hard_cases(seeds: Path, seed: int = 0) -> list[Case]:
    """Every command with every hardship; the seed chooses which folders are closed to the user."""
    made: list[tuple[str, str, tuple[str, ...], Callable[[Path], None], Callable[[], None]]] = []
    for words in _COMMANDS:
        for kib in _LIMITS_KIB:
            made.append(("small files", f"{words[0]} {kib} KiB", words, _copy(seeds), partial(limit_files, kib)))
        for kib in (0, 8):
            made.append(("full TMPDIR", f"{words[0]} {kib} KiB", words, _copy(seeds), partial(fill_temporary, kib)))
        for owned in (_own_asset, _own_output_folder, _close_input):
            words_there = tuple("out/x" if word == "out" and owned is _own_output_folder else word for word in words)
            name = f"{words[0]} {owned.__name__}"
            made.append(("other users", name, words_there, _copy(seeds, owned), obey_permissions))
    for words in _WITH_CHILDREN:
        for delay_s in _DELAYS_S:
            for ended_by in (signal.SIGKILL, signal.SIGTERM):
                name = f"{words[0]} {ended_by.name} after {delay_s} s"
                made.append((CHILDREN_KILLED, name, words, _copy(seeds), partial(end_own_child, delay_s, ended_by)))
    return [
        Case(
            kind=kind,
            number=number,
            mutation=what,
            target="",
            words=words,
            prepare=prepare,
            names_file=False,
            harden=harden,
        )
        for number, (kind, what, words, prepare, harden) in enumerate(made)
    ] + _closed_folders(seeds, seed)


def _closed_folders(seeds: Path, seed: int) -> list[Case]:
    """Every command as an ordinary user who has no rights, or some, on half of all folders: which half differs."""
    cases = []
    for number, words in enumerate((*_COMMANDS, *_MORE) * _TIMES):
        rng = np.random.default_rng([seed, number])
        cases.append(
            Case(
                kind="closed folders",
                number=number,
                mutation=words[0],
                # A refusal names what is closed, or a folder or a file in it.
                target="/".join((*_ALL_TREES, TEMPORARY)),
                words=words,
                prepare=_copy(seeds, partial(_close_folders, rng), trees=_ALL_TREES),
                harden=obey_permissions,
            )
        )
    return cases


def _close_folders(rng: np.random.Generator, folder: Path) -> None:
    """Take the rights on half of the folders, by chance; the innermost first, since the outer ones close them."""
    folders = sorted((each for each in folder.rglob("*") if each.is_dir()), reverse=True)
    for each in folders:
        if rng.random() < _SHARE:
            each.chmod(int(rng.choice(_CLOSED)))


def _copy(
    seeds: Path, change: Callable[[Path], None] | None = None, trees: Sequence[str] = _TREES
) -> Callable[[Path], None]:
    def prepare(folder: Path) -> None:
        for tree in trees:
            shutil.copytree(seeds / tree, folder / tree)
        (folder / TEMPORARY).mkdir()
        if change is not None:
            change(folder)

    return prepare


def _own_asset(folder: Path) -> None:
    """There is an asset of another user in a folder where all may write."""
    shutil.copytree(folder / "plants" / "spray", folder / "out")
    _own(folder / "out", 0o755)
    folder.chmod(0o777)


def _own_output_folder(folder: Path) -> None:
    """The folder of the output is another user's."""
    (folder / "out").mkdir()
    _own(folder / "out", 0o755)


def _close_input(folder: Path) -> None:
    """Half of what is read is another user's, who lets nobody read it."""
    for number, path in enumerate(sorted(each for tree in _TREES for each in (folder / tree).rglob("*"))):
        if number % 2:
            _own(path, 0o000, below=False)


def _own(path: Path, mode: int, *, below: bool = True) -> None:
    """Give a path, and what is below it, to another user; an ordinary user only closes it."""
    for each in (path, *(path.rglob("*") if below else ())):
        if each.is_dir() or not mode:
            each.chmod(mode if os.geteuid() == 0 or not mode else 0o555)
        if os.geteuid() == 0:
            os.chown(each, _OTHER, _OTHER)
