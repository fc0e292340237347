"""Crowns from single photographs, measured: time and memory of every step, silhouettes, seams, colours, radius errors.

usage: tools/bench/crown.py [--size 256 512] [--only NAME …] [--data ../shared/data] [-o FOLDER]

Runs each size and photograph in a process of its own, so that the peak memory is that of one crown. Captures with a
true radius cubemap (truth/crown.npz) also give the radius error in percent of the mean true radius, front and back
apart, after bringing both to one height and one centre in x and y; "sphere" is what a ball of the right height scores.
"""

import argparse
import json
import resource
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

REPOSITORY = Path(__file__).resolve().parents[2]
DATA = REPOSITORY.parent / "shared" / "data"


@dataclass(frozen=True, kw_only=True)
class Case:
    """One photograph with its mask, and the capture whose truth it has."""

    name: str
    photo: Path
    mask: Path
    capture: Path | None = None


def find_cases(data: Path) -> list[Case]:
    """The demo's photograph, and every photograph of data that has a mask."""
    demo = REPOSITORY / "tools" / "demo"
    cases = [Case(name="demo", photo=demo / "crown.jpg", mask=demo / "crown_mask.png")]
    for capture in sorted(data.glob("synthetic/tree_photo/*/")):
        photo, truth = capture / "images" / "000.jpg", capture / "truth"
        cases.append(Case(name=capture.name, photo=photo, mask=truth / "crown_mask_filled.png", capture=capture))
        # The same with its sky gaps open.
        cases.append(Case(name=f"{capture.name}_gaps", photo=photo, mask=truth / "crown_mask.png", capture=capture))
    for mask in sorted(data.glob("tree-photos-*/masks/*.png")):
        cases.append(Case(name=mask.stem, photo=mask.parents[1] / f"{mask.stem}.jpg", mask=mask))
    for mask in sorted(data.glob("tree-photos-*/*_mask.png")):
        photo = mask.with_name(mask.name.replace("_mask.png", ".jpg"))
        cases.append(Case(name=photo.stem, photo=photo, mask=mask))
    return cases


def seam_ratio(cubemap) -> float:
    """Mean step across the 12 cube edges over the mean step inside faces, both over two texels."""
    from usdfoliage.geometry.cubemap import FACE_AXES, sample_cubemap

    size = cubemap.shape[1]
    step = 2 / (size - 1)
    along = np.linspace(-0.95, 0.95, 400)[:, None]
    steps = []
    for face in range(6):
        normal, right, up = FACE_AXES[face]
        for out, side in ((right, up), (-right, up), (up, right), (-up, right)):
            here = normal + out * (1 - step) + along * side
            beyond = out + normal * (1 - step) + along * side
            steps.append(np.abs(sample_cubemap(cubemap, here) - sample_cubemap(cubemap, beyond)).mean())
    rows = np.abs(cubemap[:, 2:] - cubemap[:, :-2]).mean()
    columns = np.abs(cubemap[:, :, 2:] - cubemap[:, :, :-2]).mean()
    return float(np.mean(steps) / max((rows + columns) / 2, 1e-12))


def radius_errors(radius, capture: Path) -> tuple[float, float]:
    """Mean radius error in percent of the mean true radius, front and back, against truth/crown.npz.

    The truth is an OpenGL cubemap in the capture's axes; the COLMAP pose of its one image turns it to x right, y up,
    z towards the camera.
    """
    from usdfoliage.geometry.cubemap import face_directions, sample_cubemap

    true_radius = np.load(capture / "truth" / "crown.npz")["radius"].astype(np.float64)
    size = true_radius.shape[1]
    s, t = np.meshgrid(*[(np.arange(size) + 0.5) / size * 2 - 1] * 2)
    one = np.ones_like(s)
    faces = ((one, -t, -s), (-one, -t, s), (s, one, t), (s, -one, -t), (s, -t, one), (-s, -t, -one))
    directions = np.stack([np.stack(face, axis=-1) for face in faces])
    directions /= np.linalg.norm(directions, axis=-1, keepdims=True)
    line = next(
        row
        for row in (capture / "cameras" / "images.txt").read_text().splitlines()
        if row.strip() and not row.startswith("#")
    )
    w, x, y, z = map(float, line.split()[1:5])
    camera_from_world = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )
    truth = (directions * true_radius[..., None]).reshape(-1, 3) @ camera_from_world.T * [1, -1, -1]
    ours = (face_directions(radius.shape[1]) * radius[..., None].astype(np.float64)).reshape(-1, 3)
    scale = np.ptp(truth[:, 1]) / np.ptp(ours[:, 1])
    shift = (truth.min(axis=0) + truth.max(axis=0) - scale * (ours.min(axis=0) + ours.max(axis=0))) / 2 * [1, 1, 0]
    # Seen from the shifted centre our surface is no cubemap any more: march each true ray to its radius.
    true_length = np.linalg.norm(truth, axis=1)
    ray = truth / true_length[:, None]
    length = true_length.copy()
    for _ in range(30):
        point = (ray * length[:, None] - shift) / scale
        length += 0.5 * scale * (sample_cubemap(radius, point) - np.linalg.norm(point, axis=1))
    error = np.abs(length - true_length) / true_length.mean() * 100
    front = truth[:, 2] > 0
    return float(error[front].mean()), float(error[~front].mean())


def measure(case: Case, size: int, out: Path | None) -> dict[str, object]:
    from usdfoliage.capture.folder.images import read_photo
    from usdfoliage.capture.folder.masks import clean_mask, read_mask
    from usdfoliage.jobs.crown.photograph import CrownSettings, reconstruct_crown

    start, start_cpu = time.perf_counter(), time.process_time()
    photo = read_photo(case.photo)
    crown = clean_mask(read_mask(case.mask, photo.linear.shape, photo.orientation))
    settings = CrownSettings(size=size)
    model, measures = reconstruct_crown(photo.linear, crown.mask, settings, foliage=crown.foliage)
    wall, cpu = time.perf_counter() - start, time.process_time() - start_cpu
    inside, texels = photo.linear[crown.foliage], model.color.reshape(-1, 3)
    row: dict[str, object] = {
        "name": case.name,
        "size": size,
        "wall": wall,
        "cpu": cpu,
        "peak_mib": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024,
        "steps": measures.seconds,
        "iou": measures.iou,
        "iou_aligned": measures.iou_aligned,
        "bound": measures.star_bound,
        "seam_radius": seam_ratio(model.radius_m.astype(np.float64)),
        "seam_color": seam_ratio(model.color.astype(np.float64)),
        "mean": (texels.mean(axis=0) / inside.mean(axis=0)).tolist(),
        "std": (texels.std(axis=0) / inside.std(axis=0)).tolist(),
    }
    if case.capture is not None:
        row["error"] = radius_errors(model.radius_m, case.capture)
        row["sphere"] = radius_errors(np.ones((6, 64, 64)), case.capture)
    if out is not None:
        np.savez_compressed(out / f"{case.name}_{size}.npz", radius_m=model.radius_m, color=model.color)
    return row


def print_row(row: dict[str, object]) -> None:
    steps = row["steps"]
    print(
        f"{row['name']} size {row['size']}: {row['wall']:.1f} s wall, {row['cpu']:.1f} s cpu, {row['peak_mib']:.0f} MiB"
    )
    print("   ", ", ".join(f"{name} {seconds:.2f} s" for name, seconds in steps.items()))  # type: ignore[union-attr]
    print(
        f"    silhouette IoU {row['iou']:.4f}, aligned {row['iou_aligned']:.4f}, star-shaped bound {row['bound']:.4f}; "
        f"seams: radius {row['seam_radius']:.3f}, colour {row['seam_color']:.3f}"
    )
    ratios = (" ".join(f"{value:.3f}" for value in row[key]) for key in ("mean", "std"))  # type: ignore[union-attr]
    print("    colour over the photograph's, linear: mean {}, standard deviation {}".format(*ratios))
    if "error" in row:
        (front, back), (ball_front, ball_back) = row["error"], row["sphere"]  # type: ignore[misc]
        print(
            f"    radius error: front {front:.2f} %, back {back:.2f} %; a sphere: front {ball_front:.2f} %, "
            f"back {ball_back:.2f} %"
        )


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--size", type=int, nargs="+", default=[256, 512])
    parser.add_argument("--only", nargs="+", help="names of photographs")
    parser.add_argument("--data", type=Path, default=DATA)
    parser.add_argument("-o", "--output", type=Path, help="keep the cubemaps here")
    parser.add_argument("--in-process", action="store_true", help="no process of its own: print JSON")
    options = parser.parse_args()
    cases = [case for case in find_cases(options.data) if not options.only or case.name in options.only]
    if not cases:
        print(f"error: no photograph of that name; {options.data} has none of them", file=sys.stderr)
        return 2
    if options.output:
        options.output.mkdir(parents=True, exist_ok=True)
    if options.in_process:
        print(json.dumps(measure(cases[0], options.size[0], options.output)))
        return 0
    if not options.data.exists():
        print(f"{options.data} is absent: only the demo's photograph is measured")
    for size in options.size:
        # Of the larger sizes two photographs are enough.
        for case in cases if size == options.size[0] else cases[:2]:
            command = [sys.executable, __file__, "--in-process", "--size", str(size), "--only", case.name]
            command += ["--data", str(options.data), *(["-o", str(options.output)] if options.output else [])]
            done = subprocess.run(command, capture_output=True, text=True, check=False)
            if done.returncode:
                print(f"{case.name} size {size}: failed\n{done.stderr}")
                continue
            print_row(json.loads(done.stdout.splitlines()[-1]))
            sys.stdout.flush()
    return 0


if __name__ == "__main__":
    sys.exit(main())
