"""What the window in which strokes are drawn asks of this process, and how it is answered.

A line of JSON each; "id" is any number of the window's own, and stands in every reply:

    {"id", "op": "trace", "tree": tree, "settings"}       {"id", "foliage": file, "branches", "rough", "seconds"}
    {"id", "op": "grow", "strokes": file's JSON,          {"id", "step", "share"}, {"id", "shoots", "first"}, and at
     "tree": number}                                      the end {"id", "asset": file, "facts", "remarks"}
    {"id", "op": "stop"}                                  the growth ends with {"id", "stopped": true}
    {"id", "op": "read", "path"}                          {"id", "strokes": file's JSON}
    {"id", "op": "propose"}                               {"id", "strokes": file's JSON}
    {"id", "op": "write", "path", "strokes"}              {"id", "written": file}
    {"id", "op": "make", "path", "strokes_path",          {"id", "step", "share"}, and at the end {"id", "asset": file,
     "strokes", "preview": true}                          "facts", "remarks"}

and, for what cannot be done, {"id", "error": text}. A tree is {"crown": points, "branches": list of points} in pixels
of the photograph; its crown may be empty. Tracing goes on while a tree grows; of several strokes that wait, the last is
traced. A growth stops where another one begins.
"""

import json
import shutil
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any, BinaryIO

import cv2
import numpy as np
from numpy.typing import NDArray

from usdfoliage import __version__
from usdfoliage.asset.packages.plant_package import write_plant_asset
from usdfoliage.asset.plant import asset_name
from usdfoliage.asset.provenance import Provenance
from usdfoliage.capture.folder.images import Photo
from usdfoliage.errors import CaptureError, FoliageError
from usdfoliage.jobs.report.pictures import write_picture
from usdfoliage.jobs.report.table import Row
from usdfoliage.jobs.sketch.model import (
    SketchModelSettings,
    apply_choices,
    model_tree,
    scale_strokes,
    to_display,
    work_picture,
)
from usdfoliage.jobs.sketch.run import SketchRequest, make_sketch_asset, propose_tree, sketch_rows
from usdfoliage.remarks import Remark, RenderSetting, as_plan_setting, list_sentences, warnings_of
from usdfoliage.sketch.axes import Axis
from usdfoliage.sketch.foliage import Foliage
from usdfoliage.sketch.reconstruct import SketchSettings, foliage_of_strokes, mixture_seeds, trace_strokes
from usdfoliage.sketch.strokes import (
    Strokes,
    TreeStrokes,
    check_strokes,
    format_strokes,
    parse_strokes,
    read_strokes,
    write_strokes,
)

Reply = Callable[[Mapping[str, Any]], None]

DRAFT_FACES = 40_000  # of the surface of branches, of a tree in the window
_QUICK_PX = 500  # longer side of the picture that strokes are traced in while somebody waits
_ROUGH_PX = 8_000  # pixels of a crown's box, in which its leaves are looked for then
_KEPT = 3  # drafts, and pictures of leaves
_STEP_S = 0.12  # between pictures of a tree that grows


class _StoppedError(Exception):
    """A growth that nobody waits for any more."""


@dataclass(frozen=True, kw_only=True, eq=False)
class _FoundFoliage:
    """Leaves, and what they were found of."""

    strokes: TreeStrokes
    seed: int
    foliage: Foliage


@dataclass(eq=False)
class DrawingSession:
    """A photograph that somebody draws over, and what is known of its strokes."""

    photo: Photo
    color_space: str | None
    work: Path  # a folder for files
    settings: SketchModelSettings = field(default_factory=SketchModelSettings)
    render_setting: RenderSetting = as_plan_setting

    def __post_init__(self) -> None:
        linear, self.shrunk = work_picture(self.photo.linear)
        self.linear = linear
        self.srgb = to_display(linear)
        self._quick_scale = min(1.0, _QUICK_PX / max(self.srgb.shape[:2]))
        width, height = (max(1, round(side * self._quick_scale)) for side in self.srgb.shape[1::-1])
        self._quick = cv2.resize(self.srgb, (width, height), interpolation=cv2.INTER_AREA).astype(np.uint8)
        self._found: _FoundFoliage | None = None
        self._rough: _FoundFoliage | None = None
        self._files: dict[str, list[Path]] = {}
        self._named = 0

    @property
    def head(self) -> dict[str, Any]:
        """What stands before the trees in a file of strokes."""
        return {"image": self.photo.path.name, "width": self.photo.width_px, "height": self.photo.height_px}

    def next_path(self, name: str) -> Path:
        """A new file or folder in the work folder. Of those of a name the last few stay, which the window reads."""
        self._named += 1
        path = self.work / f"{self._named:05d}_{name}"
        before = self._files.setdefault(name, [])
        before.append(path)
        while len(before) > _KEPT:
            old = before.pop(0)
            if old.is_dir():
                shutil.rmtree(old, ignore_errors=True)
            else:
                old.unlink(missing_ok=True)
        return path

    def parse(self, strokes: Any) -> Strokes:
        """Strokes of the window; CaptureError where they are none."""
        found = parse_strokes(strokes, Path("the drawing"))
        check_strokes(found, self.photo.width_px, self.photo.height_px, "of the drawing")
        return found

    def trace(self, order: Mapping[str, Any], reply: Reply) -> bool:
        """Find the leaves and branches of one tree at once, in a small picture; whether nothing exacter is to come."""
        begun = time.perf_counter()
        strokes, settings = self._strokes_of(order)
        if strokes is None:
            reply({"foliage": "", "branches": [], "rough": False, "seconds": 0.0})
            return True
        small = scale_strokes(strokes, self._quick_scale)
        known = _recall(self._found, strokes, settings.seed)
        foliage = _recall(self._rough, small, settings.seed) if known is None else _shrink(known, self._quick)
        if foliage is None:
            rough = replace(settings.foliage, max_pixels=_ROUGH_PX, rounds=1)
            foliage = foliage_of_strokes(self._quick, small, mixture_seeds(settings)[0], rough)
            self._rough = _FoundFoliage(strokes=small, seed=settings.seed, foliage=foliage)
        traced = self._show_traced(self._quick, self._quick_scale, small, foliage, settings)
        is_exact = known is not None and self._quick_scale == 1
        reply({**traced, "rough": not is_exact, "seconds": time.perf_counter() - begun})
        return is_exact

    def trace_exactly(self, order: Mapping[str, Any], is_awaited: Callable[[], bool], reply: Reply) -> None:
        """As trace, with the leaves that a tree grows of; without a reply where nobody waits for it any more."""
        begun = time.perf_counter()
        strokes, settings = self._strokes_of(order)
        if strokes is None or not is_awaited():
            return
        foliage = _recall(self._found, strokes, settings.seed)
        if foliage is None:
            foliage = foliage_of_strokes(self.srgb, strokes, mixture_seeds(settings)[0], settings.foliage)
            self._found = _FoundFoliage(strokes=strokes, seed=settings.seed, foliage=foliage)
        if is_awaited():
            traced = self._show_traced(self.srgb, 1.0, strokes, foliage, settings)
            reply({**traced, "rough": False, "seconds": time.perf_counter() - begun})

    def _strokes_of(self, order: Mapping[str, Any]) -> tuple[TreeStrokes | None, SketchSettings]:
        """Strokes in pixels of the work picture, None without a crown, and the settings with the window's seed."""
        tree, seed = order["tree"], int(order.get("settings", {}).get("seed", self.settings.tree.seed))
        settings = replace(self.settings.tree, seed=seed)
        crown, branches = _points(tree["crown"]), [_points(line) for line in tree["branches"]]
        if len(crown) < 3:
            return None, settings
        return scale_strokes(TreeStrokes(crown_px=crown, branches_px=tuple(branches)), self.shrunk), settings

    def _show_traced(
        self,
        srgb: NDArray[np.uint8],
        scale: float,
        strokes: TreeStrokes,
        foliage: Foliage,
        settings: SketchSettings,
    ) -> dict[str, Any]:
        """Leaves as a picture and branches as lines, for the window; scale: of srgb in the work picture."""
        file = self.next_path("leaves.png")
        write_picture(file, (255 * foliage.mask).astype(np.uint8))
        branches = []
        if strokes.branches_px:
            traced = trace_strokes(srgb, strokes, foliage, settings)
            branches = [np.round(each.points_px / (scale * self.shrunk), 1).tolist() for each in traced.branches]
        return {"foliage": str(file), "branches": branches}

    def grow(self, drawn: Any, number: int, check: Callable[[], None], reply: Reply) -> None:
        """Grow one tree of a drawing, and write it as a draft: as it will be, with a coarser surface and no crown."""
        strokes = self.parse(drawn)
        settings = replace(apply_choices(self.settings, strokes.choices), max_faces=DRAFT_FACES, has_crown=False)
        tree = scale_strokes(strokes.trees[number], self.shrunk)
        scale_m = settings.tree.height_m / max(_height(tree), 1.0)  # about: growth alone finds the top

        def report(step: str, share: float) -> None:
            check()
            reply({"step": step, "share": share})

        known = _recall(self._found, tree, settings.tree.seed)
        model = model_tree(self.linear, tree, settings, {}, report, _show_growth(scale_m, check, reply), known)
        folder = self.next_path("draft")
        folder.mkdir()
        provenance = Provenance(
            species="",
            capture=self.photo.path.name,
            generator=f"usdfoliage {__version__}",
            seed=settings.tree.seed,
            settings={},
            input_sha256="",
        )
        asset = write_plant_asset(
            folder,
            "draft",
            provenance=provenance,
            asset_from_capture=model.asset_from_photo,
            branches=model.branches,
            foliage=model.foliage,
        )
        check()
        reply({"asset": str(asset), **self._describe(sketch_rows(model), model.remarks)})

    def make(self, order: Mapping[str, Any], reply: Reply) -> None:
        """Write the strokes and the asset, as usdfoliage sketch makes it of them."""
        strokes_path, output = Path(order["strokes_path"]), Path(order["path"])
        write_strokes(strokes_path, self.parse(order["strokes"]))
        request = SketchRequest(
            photo=self.photo.path,
            strokes=strokes_path,
            output=output,
            name=asset_name(output.resolve().name),
            color_space=self.color_space,
            settings=self.settings,
            preview=bool(order.get("preview", True)),
            render_setting=self.render_setting,
        )
        made = make_sketch_asset(request, lambda step, share: reply({"step": step, "share": share}))
        reply({"asset": str(made.asset), **self._describe(made.rows, made.remarks)})

    def answer_briefly(self, order: Mapping[str, Any], reply: Reply) -> None:
        """What takes no time: strokes of files."""
        if order["op"] == "read":
            found = read_strokes(Path(order["path"]))
            check_strokes(found, self.photo.width_px, self.photo.height_px, str(order["path"]))
            reply({"strokes": json.loads(format_strokes(found))})
        elif order["op"] == "write":
            write_strokes(Path(order["path"]), self.parse(order["strokes"]))
            reply({"written": str(order["path"])})
        else:
            raise ValueError(f"nothing is known of {order['op']!r}")

    def _describe(self, rows: Sequence[Row], remarks: Sequence[Remark]) -> dict[str, Any]:
        return {
            "facts": [f"{row.name} {row.value}" for row in rows],
            "remarks": list_sentences(warnings_of(remarks), self.render_setting),
        }

    def propose(self, reply: Reply) -> None:
        """Strokes that nobody drew."""
        _, tree = propose_tree(self.photo, to_display(self.photo.linear), self.settings.tree.seed)
        width, height = self.photo.width_px, self.photo.height_px
        strokes = Strokes(image=self.photo.path.name, width_px=width, height_px=height, trees=(tree,))
        reply({"strokes": json.loads(format_strokes(strokes))})


def answer_drawing(session: DrawingSession, requests: BinaryIO, replies: BinaryIO) -> None:
    """Answer the window until it is closed; an asset that is being made then is finished."""
    writing, latest = threading.Lock(), {"trace": -1, "grow": -1}

    def send(number: int, reply: Mapping[str, Any]) -> None:
        with writing:
            try:
                replies.write(json.dumps({"id": number, **reply}).encode() + b"\n")
                replies.flush()
            except (BrokenPipeError, ValueError):  # the window is gone
                return

    def run(number: int, work: Callable[[Reply], None]) -> None:
        def reply(content: Mapping[str, Any]) -> None:
            send(number, content)

        try:
            work(reply)
        except _StoppedError:
            reply({"stopped": True})
        except (FoliageError, OSError, ValueError, KeyError, TypeError, IndexError, MemoryError) as error:
            reply({"error": str(error) or type(error).__name__})

    def check(number: int) -> None:
        if latest["grow"] != number:
            raise _StoppedError

    def trace(order: Mapping[str, Any], number: int, reply: Reply) -> None:
        if latest["trace"] == number and not session.trace(order, reply):
            finder.submit(run, number, partial(find, order, number))

    def find(order: Mapping[str, Any], number: int, reply: Reply) -> None:
        session.trace_exactly(order, lambda: latest["trace"] == number, reply)

    def grow(order: Mapping[str, Any], number: int, reply: Reply) -> None:
        check(number)
        session.grow(order["strokes"], int(order["tree"]), lambda: check(number), reply)

    with ThreadPoolExecutor(1) as grower, ThreadPoolExecutor(1) as finder, ThreadPoolExecutor(1) as tracer:
        for line in requests:
            try:
                order = json.loads(line)
                number, op = int(order["id"]), order["op"]
            except (ValueError, KeyError, TypeError):
                continue  # it has no number to answer to
            if op == "trace":
                latest["trace"] = number
                tracer.submit(run, number, partial(trace, order, number))
            elif op == "propose":
                tracer.submit(run, number, session.propose)
            elif op == "grow":
                latest["grow"] = number
                grower.submit(run, number, partial(grow, order, number))
            elif op == "make":
                latest["grow"] = -1
                grower.submit(run, number, partial(session.make, order))
            elif op == "stop":
                latest["grow"] = -1
            else:
                run(number, partial(session.answer_briefly, order))
        latest["grow"] = -1


def _recall(found: _FoundFoliage | None, strokes: TreeStrokes, seed: int) -> Foliage | None:
    """The leaves that were found, where they are those of these strokes."""
    if found is None or found.seed != seed or not np.array_equal(found.strokes.crown_px, strokes.crown_px):
        return None
    # Strokes of branches decide whether what is thin is leaves.
    same = len(found.strokes.branches_px) == len(strokes.branches_px) and all(
        map(np.array_equal, found.strokes.branches_px, strokes.branches_px)
    )
    return found.foliage if same or not found.foliage.is_thin else None


def _shrink(foliage: Foliage, srgb: NDArray[np.uint8]) -> Foliage:
    """The same leaves in a smaller picture."""
    size = srgb.shape[1::-1]
    mask, pure, inside = (
        np.asarray(cv2.resize(each.astype(np.float32), size, interpolation=cv2.INTER_AREA) > 0.5)
        for each in (foliage.mask, foliage.pure, foliage.inside)
    )
    return replace(foliage, mask=mask, pure=pure, inside=inside)


def _points(listed: Any) -> NDArray[np.float64]:
    """(N, 2) points of the window."""
    points = np.array(listed, np.float64).reshape(-1, 2)
    if not np.isfinite(points).all():
        raise CaptureError("a stroke has points that are no numbers")
    return points


def _height(tree: TreeStrokes) -> float:
    """From the lowest to the highest place of the strokes, in pixels."""
    return float(np.ptp(np.concatenate([tree.crown_px, *tree.branches_px])[:, 1]))


def _show_growth(scale_m: float, check: Callable[[], None], reply: Reply) -> Callable[[Sequence[Axis]], None]:
    """What to call with a tree that grows: its new branches go to the window, a few times a second."""
    sent, last = 0, 0.0

    def watch(axes: Sequence[Axis]) -> None:
        nonlocal sent, last
        check()
        now = time.monotonic()
        if now - last < _STEP_S or len(axes) == sent:
            return
        root = axes[0].points[0]
        shoots = [(np.round((axis.points - root) * scale_m, 4)).tolist() for axis in axes[sent:]]
        reply({"shoots": shoots, "first": sent})
        sent, last = len(axes), now

    return watch
