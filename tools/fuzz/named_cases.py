"""Hostile input made on purpose: files of odd names, bombs, folders of another kind; broken captures."""

import os
import shutil
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

from tools.fuzz.broken_captures import DAMAGES, PHOTOGRAPHS
from tools.fuzz.cases import Case
from tools.fuzz.mutations import PLACES

Damage = Callable[[Path], None]

NAMES = (
    *("a b", "ünïcode 木 \U0001f333", "e\u0301", "a\nb", "a\tb", os.fsdecode(b"\xff\xfe"), "-o", "--help", "x" * 230),
    *("木" * 76, "<UDIM>", "%04d", "@x@", "#", "$HOME", "'\"", "a:b", "a?b", "[1]", "{a}", "a;b", "a\\b", "\u202eb"),
    *("~", "\x07", "1 %s", "\x1b[31m", "\x9b2J"),
)
_BED = (
    ("leaves", "bed", "--no-preview", "-o", "out"),
    ("capture", "bed", "--settings", "bed/fast.toml", "--no-report", "-o", "out"),
)


def named_cases(seeds: Path) -> list[Case]:
    """All of them."""
    found = [*_odd_names(seeds), *_broken_captures(seeds), *_other(seeds)]
    return [
        Case(
            kind=kind,
            number=number,
            mutation=what,
            target=target,
            words=words,
            prepare=prepare,
            names_file=bool(target),
        )
        for number, (kind, what, target, words, prepare) in enumerate(found)
    ]


_Made = tuple[str, str, str, Sequence[str], Damage]


def _odd_names(seeds: Path) -> Iterator[_Made]:
    """Good files, folders and outputs of names that file systems allow."""

    def copy(source: str, name: str) -> Damage:
        def prepare(folder: Path) -> None:
            kept = seeds / source
            (shutil.copytree if kept.is_dir() else shutil.copy)(kept, folder / name)
            shutil.copy(seeds / "photo" / "mask.png", folder / "mask.png")

        return prepare

    small = ("--size", "32", "--mesh-size", "17", "--no-preview")
    for number, name in enumerate(NAMES):
        given = f"./{name}"
        for source, words in (
            ("photo/oak.png", ("crown", f"{given}.png", "--mask", "mask.png", *small, "-o", "out")),
            ("photo/oak.png", ("scatter", "-n", "1", "--texture", f"{given}.png", "-o", f"out{name}")),
            ("cloud/tree.xyz", ("branches", f"{given}.xyz", "--no-preview", "-o", "out")),
            ("bed", ("leaves", given, "--no-preview", "-o", f"out{name}")),
            ("bed", ("capture", given, "--settings", f"{given}/fast.toml", "--no-report", "-o", "out")),
            ("plants/spray", ("info", given)),
            ("bed", ("build", given, "-o", f"out{name}", "--dry-run")),
            ("cloud/tree.xyz", ("build", f"{given}.xyz", "-o", f"out{name}", "--dry-run")),
            ("plants/spray", ("validate", given)),
            ("plants/spray", ("edit", given, "--width", "2", "-o", f"out{name}.usda")),
        )[number % 2 :: 2]:
            yield f"name {words[0]}", repr(name[:20]), "", words, copy(source, name + Path(source).suffix)
    for path in ("photo/../photo/oak.png", "link/../photo/oak.png", "photo//./oak.png"):

        def prepare(folder: Path) -> None:
            shutil.copytree(seeds / "photo", folder / "photo")
            (folder / "link").symlink_to("photo")

        yield "name crown", path, "", ("crown", path, "--mask", "photo/mask.png", *small, "-o", "out"), prepare


def _broken_captures(seeds: Path) -> Iterator[_Made]:
    """The bed with things done to it."""

    def damaged(damage: Damage, tree: str = "bed") -> Damage:
        def prepare(folder: Path) -> None:
            shutil.copytree(seeds / tree, folder / "bed")
            damage(folder / "bed")

        return prepare

    for damage in DAMAGES:
        for words in _BED:
            yield "broken capture", damage.__name__, "", words, damaged(damage)
    for damage in PHOTOGRAPHS:
        words = ("capture", "bed/images", "--settings", "bed/fast.toml", "--no-report", "-o", "out", "--dry-run")
        yield "broken photographs", damage.__name__, "", words, damaged(damage)
    for place in PLACES:
        for below in ("images", "cameras", "depth", "masks", "cloud.ply"):

            def damage(bed: Path, place: Damage = place, below: str = below) -> None:
                path = bed / below
                if path.is_dir():
                    shutil.rmtree(path)
                    path.write_bytes(b"0" * 64)
                place(path)

            yield "folder replaced", f"{below} {place.__name__}", "", _BED[0], damaged(damage)


def _other(seeds: Path) -> Iterator[_Made]:
    """Files that no damage makes: bombs, lines without end, a drawing of what cannot be drawn."""

    def written(target: str, data: Callable[[], bytes], *trees: str) -> Damage:
        def prepare(folder: Path) -> None:
            for tree in trees:
                shutil.copytree(seeds / tree, folder / tree)
            (folder / target).parent.mkdir(parents=True, exist_ok=True)
            (folder / target).write_bytes(data())

        return prepare

    header = "ply\nformat {} 1.0\nelement vertex {}\nproperty float x\nproperty float y\nproperty float z\nend_header\n"
    for what, target, data in (
        ("a line of 40 MB", "a.xyz", lambda: b"1 2 3 " * 7_000_000),
        ("a million numbers a line", "a.xyz", lambda: b"1 " * 1_000_000 + b"\n1 2 3\n" * 60),
        ("zeros without end", "a.pts", lambda: b"\0" * 10_000_000),
        ("a count of 10^12", "a.ply", lambda: header.format("binary_little_endian", 10**12).encode() + b"\0" * 600),
        ("a count of 10^12, text", "a.ply", lambda: header.format("ascii", 10**12).encode() + b"1 2 3\n" * 60),
        ("numbers of a million digits", "a.xyz", lambda: (b"9" * 1_000_000 + b" 1 2\n") * 8),
        ("one place", "a.xyz", lambda: b"1 2 3\n" * 1000),
        ("a line of points", "a.xyz", lambda: b"".join(b"%d 0 0\n" % number for number in range(1000))),
        ("no number", "a.xyz", lambda: b"nan nan nan\n" * 1000),
        ("far apart", "a.xyz", lambda: b"".join(b"%d 1e%d 3\n" % (k, k % 11) for k in range(1000))),
    ):
        yield "cloud made", what, target, ("branches", target, "--no-preview", "-o", "out"), written(target, data)
    for what, data in (
        ("deep lists", lambda: b"a = " + b"[" * 100_000),
        ("deep tables", lambda: b"a = " + b"{a = " * 50_000),
        ("deep dots", lambda: b"a" + b".a" * 20_000 + b" = 1"),
        ("long number", lambda: b"metres_per_unit = " + b"9" * 100_000),
        ("long text", lambda: b"name = '" + b"x" * 10_000_000 + b"'"),
        ("no Unicode", lambda: b"name = '\xff\xfe'"),
    ):
        for words in (
            ("leaves", "bed", "-o", "out", "--dry-run"),
            ("capture", "bed", "-o", "out", "--dry-run"),
            ("branches", "bed", "-o", "out", "--dry-run"),
            ("leaves", "--print-settings", "--settings", "bed/capture.toml"),
            (
                "branches",
                "bed/cloud.ply",
                "--dry-run",
                "-o",
                "out",
                "--species-file",
                "bed/capture.toml",
                "--species",
                "x",
            ),
            ("validate", "plants/spray", "--profile", "bed/capture.toml"),
            ("build", "bed", "-o", "out", "--dry-run"),
            ("build", "--print-plan", "--plan", "bed/capture.toml"),
        ):
            yield "toml made", what, "bed/capture.toml", words, written("bed/capture.toml", data, "bed", "plants")
    for what, target, data in (
        ("a field of 200 kB", "list.csv", lambda: b"capture\n" + b"x" * 200_000),
        ("columns of 200 kB", "list.csv", lambda: b"x" * 200_000 + b"\nbed"),
        ("an open quote", "list.csv", lambda: b'capture\n"bed\n'),
        ("too few cells", "list.csv", lambda: b"name,plan,capture\nbed\n"),
        ("one column twice", "list.csv", lambda: b"capture,capture\nbed,bed\n"),
        ("a zero byte", "list.txt", lambda: b"be\0d\n"),
        ("nobody's home", "list.txt", lambda: b"~nobody_of_that_name/bed\n"),
        ("itself", "list.txt", lambda: b"list.txt\n"),
        ("a name of 100 kB", "list.txt", lambda: b"bed\t" + b"x" * 100_000),
        ("a path of 100 kB", "list.txt", lambda: b"x" * 100_000),
        ("a path of many parts", "list.txt", lambda: b"../" * 5000 + b"bed"),
        ("100,000 lines", "list.txt", lambda: b"".join(b"oak%d\n" % number for number in range(100_000))),
        ("a device", "list.txt", lambda: b"/dev/zero\n"),
        ("a plan that is the list", "list.txt", lambda: b"bed\tb\tlist.txt\n"),
    ):
        words = ("batch", target, "-o", "out", "--dry-run")
        yield "library made", what, target, words, written(target, data, "bed")
    for what, data in (
        ("deep lists", lambda: b"[" * 100_000),
        ("deep tables", lambda: b'{"stamp": ' * 100_000),
        ("a long number", lambda: b'{"stamp": ' + b"9" * 100_000 + b"}"),
        ("a list", lambda: b"[]"),
        ("no Unicode", lambda: b'"\xff"'),
        ("text for tables", lambda: b'{"stamp": "", "seal": "", "tasks": "", "earlier": ""}'),
        ("numbers for tables", lambda: b'{"stamp": 1, "seal": 1, "tasks": [1], "earlier": {"a": 1}}'),
        ("nothing", lambda: b"null"),
    ):
        for part in ("tasks", "builds"):

            def prepare(folder: Path, part: str = part, data: Callable[[], bytes] = data) -> None:
                for tree in ("bed", "work"):
                    shutil.copytree(seeds / tree, folder / tree)
                min((folder / "work" / part).glob("*.json")).write_bytes(data())

            for words in (("work", "work"), ("build", "bed", "-o", "out", "--work", "work", "--dry-run")):
                yield f"work made {part}", what, "", words, prepare
    deep = b"#usda 1.0\n" + b'def Xform "a" {\n' * 20_000 + b"}\n" * 20_000
    for words in (
        ("info", "deep.usda"),
        ("validate", "deep.usda"),
        ("edit", "deep.usda", "--width", "2", "-o", "out.usda"),
    ):
        yield "usd made", "deep prims", "deep.usda", words, written("deep.usda", lambda: deep)
    chain = "".join(f'class "c{k}" (inherits = </c{k + 1}>) {{}}\n' for k in range(20_000))
    plant = 'class "c20000" {}\ndef Xform "a" (inherits = </c0>) {}\n'
    for what, text in (
        ("parentheses", 'def Xform "a" { custom int x = ' + "(" * 100_000 + ")" * 100_000 + "}"),
        ("brackets", 'def Xform "a" { custom int[] x = ' + "[" * 100_000 + "]" * 100_000 + "}"),
        ("dictionaries", 'def Xform "a" (customData = {' + "dictionary a = {" * 400 + "}" * 400 + "}) {}"),
        ("a chain of classes", chain + plant),
        ("a circle of classes", 'class "a" (inherits = </b>) {}\nclass "b" (inherits = </a>) {}'),
        ("itself", 'def Xform "a" (references = @a.usda@) {}'),
        ("100,000 prims", "".join(f'def Xform "p{k}" {{}}\n' for k in range(100_000))),
        ("an array of 2^31", 'def Points "a" { int[] ids.timeSamples = { 0: [' + "0," * 1_000_000 + "] } }"),
        ("a device", 'def Xform "a" (references = @/dev/zero@) {}'),
    ):
        for command in ("info", "validate"):
            data = f"#usda 1.0\n{text}\n".encode()
            yield "usd made", what, "a.usda", (command, "a.usda"), written("a.usda", lambda data=data: data)
    for place in PLACES:

        def prepare(folder: Path, place: Damage = place) -> None:
            shutil.copytree(seeds / "plants", folder / "plants")
            place(folder / "plants" / "spray" / "maps" / "spray_leaf.png")

        for words in (
            ("info", "plants/spray"),
            ("validate", "plants/spray"),
            ("bake", "plants/spray", "-o", "out"),
            ("edit", "plants/spray", "--width", "2", "-o", "out.usda"),
        ):
            yield "usd texture", f"{words[0]} {place.__name__}", "", words, prepare
    for what, data in (
        ("a zip of nothing", lambda: b"PK\x05\x06" + bytes(18)),
        ("a broken zip", lambda: b"PK\x03\x04" + b"\xff" * 300),
        ("no zip", lambda: b"no zip"),
    ):
        for command in ("info", "validate"):
            yield "usd made", what, "a.usdz", (command, "a.usdz"), written("a.usdz", data)
    for name in ("photo", "cloud", "toml"):

        def prepare(folder: Path, name: str = name) -> None:
            shutil.copytree(seeds / name, folder / name)

        for command in ("info", "validate", "crown", "branches", "leaves", "capture"):
            more = () if command in ("info", "validate") else ("-o", "out")
            yield "a wrong folder", f"{command} {name}", "", (command, name, *more), prepare
