"""From a scan to its leaves: a model of each piece of the mask, in metres."""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import QhullError

from usdfoliage.capture.folder.images import Photo, read_photo
from usdfoliage.capture.folder.masks import read_mask
from usdfoliage.capture.folder.raster import read_image_spec
from usdfoliage.errors import CaptureError, FitError
from usdfoliage.jobs.lobed.pieces import LeafPieces, cut_out_scan, split_pieces
from usdfoliage.jobs.lobed.request import DEFAULT_HEIGHT_M, METRES_PER_INCH, LobedRequest
from usdfoliage.leaf.lobed.cutout import Finding
from usdfoliage.leaf.lobed.model import FlatLobedLeaf, model_lobed_leaf
from usdfoliage.leaf.lobed.placed import LobedLeaf, PictureCrop, place_leaf
from usdfoliage.remarks import Argument, Remark, remark

MAX_PX = 150_000_000  # of a scan: a page of A4 at 1200 pixels an inch
MODELLED_PX = 1600  # longer side of a leaf at most, where it is modelled: finer, its outline is the scanner's noise
_MARGIN_PX = 4  # of nothing around a leaf there
_OPAQUE = 0.5
_HOLES = 0.002  # of the leaf's pixels; fewer are dust on it
_GOOD_IOU = 0.96


@dataclass(frozen=True, kw_only=True, eq=False)
class Scan:
    """A picture, and the leaves in it."""

    photo: Photo
    pieces: LeafPieces
    mask_source: str  # what the mask is
    remarks: tuple[Remark, ...]


@dataclass(frozen=True, kw_only=True, eq=False)
class ModelledLeaf:
    """One leaf of a scan."""

    number: int  # of the piece, from 0
    flat: FlatLobedLeaf  # in pixels of the crop
    crop: PictureCrop
    leaf: LobedLeaf
    mask: NDArray[np.bool_]  # (H, W) of the whole scan
    iou: float  # of the faces and the mask without its holes
    remarks: tuple[Remark, ...]


def read_scan(request: LobedRequest) -> Scan:
    """Read the picture and its mask; without one the alpha of the picture is the mask, else what stands out from it.

    Raises:
        CaptureError: see read_photo, read_mask, split_pieces and cut_out_scan; or the picture is too large.
    """
    spec = read_image_spec(request.scan)
    if spec is not None and spec.width * spec.height > MAX_PX:
        raise CaptureError(
            f"{request.scan} states {spec.width} x {spec.height} pixels; a scan of leaves has at most "
            f"{MAX_PX // 10**6} million",
            "reduce it: two thousand pixels along a leaf are enough",
        )
    photo = read_photo(request.scan, request.color_space)
    remarks = list(photo.remarks)
    if request.mask is not None:
        mask, source = read_mask(request.mask, photo.linear.shape, photo.orientation), request.mask.name
    elif photo.alpha is not None:
        mask, source = photo.alpha >= _OPAQUE, "alpha"
        remarks.append(remark("lobed-mask-of-alpha", "the mask is the alpha channel of the scan"))
    else:
        try:
            (mask, findings), source = cut_out_scan(photo.linear), "colours"
        except CaptureError as error:
            raise CaptureError(f"{error.text} ({request.scan})", error.remedy) from error
        text = f"the mask is what differs in colour from the ground of the scan, {mask.mean():.0%} of it"
        remarks.append(remark("lobed-mask-of-colours", text, remedy=("look at it in the report, or give ", _MASK)))
        if Finding.TOUCHING in findings:
            remarks.append(remark("lobed-touching", "a leaf of the scan seems to be several that touch each other"))
        if Finding.LOW_CONTRAST in findings:
            remarks.append(remark("lobed-low-contrast", "a leaf differs little from its ground: see its silhouette"))
    try:
        pieces = split_pieces(mask, request.pieces)
    except CaptureError as error:
        raise CaptureError(f"{error.text} ({request.mask or request.scan})", error.remedy) from error
    if pieces.dust:
        text = f"{pieces.dust} pieces of the mask are dust: each has less than {request.pieces.smallest:.0%} of the "
        remarks.append(remark("lobed-dust", f"{text}largest one's pixels"))
    return Scan(photo=photo, pieces=pieces, mask_source=source, remarks=tuple(remarks))


_MASK = Argument(name="mask")


def model_leaves(scan: Scan, request: LobedRequest) -> tuple[Sequence[ModelledLeaf], Sequence[Remark]]:
    """The leaves of a scan that have a model, and remarks on size and on those that have none.

    Raises:
        FitError: No leaf has a model.
    """
    found: list[tuple[int, FlatLobedLeaf, PictureCrop, NDArray[np.bool_]]] = []
    remarks: list[Remark] = []
    reason = ""
    for number in range(len(scan.pieces.numbers)):
        small, crop = _crop(scan.pieces, number)
        try:
            found.append((number, model_lobed_leaf(small, request.model), crop, small))
        except (ValueError, QhullError) as error:
            reason = " ".join(str(error).split())[:200]
            if len(scan.pieces.numbers) > 1:
                remarks.append(remark("lobed-leaf-left-out", f"leaf {number + 1} of the scan has no model: {reason}"))
    if not found:
        raise FitError(
            f"no model of the leaf was found: {reason} ({request.mask or request.scan})",
            ("see that the mask is one closed area, and give it with ", _MASK),
        )
    metres_per_px, size_remarks = _metres_per_px(request, found)
    leaves = [_place(scan, each, metres_per_px) for each in found]
    return leaves, [*remarks, *size_remarks]


def _crop(pieces: LeafPieces, number: int) -> tuple[NDArray[np.bool_], PictureCrop]:
    """The mask of one leaf with little around it, no larger than it is modelled at."""
    left, top, width, height = pieces.boxes_px[number]
    part = pieces.labels[top : top + height, left : left + width] == pieces.numbers[number]
    scale = min(1.0, MODELLED_PX / max(width, height))
    if scale < 1:
        # Whole pixels of the same size both ways, so that the crop is a similar picture.
        pixel = 1 / scale
        columns, rows = int(np.ceil(width / pixel)), int(np.ceil(height / pixel))
        matrix = np.array([[scale, 0, 0.5 * scale - 0.5], [0, scale, 0.5 * scale - 0.5]])
        soft = cv2.GaussianBlur(part.astype(np.float32), (0, 0), 0.4 * pixel)
        part = cv2.warpAffine(soft, matrix, (columns, rows), flags=cv2.INTER_LINEAR) >= 0.5
    pixel = 1 / scale
    framed = np.pad(part, _MARGIN_PX)
    return framed, PictureCrop(left_px=left - _MARGIN_PX * pixel, top_px=top - _MARGIN_PX * pixel, pixel=pixel)


def _metres_per_px(
    request: LobedRequest, found: Sequence[tuple[int, FlatLobedLeaf, PictureCrop, NDArray[np.bool_]]]
) -> tuple[float, Sequence[Remark]]:
    """The size of a pixel of the scan; the largest leaf is the one that a width or a height is about."""
    extents_px = [np.ptp(flat.ties.places(), axis=0) * crop.pixel for _, flat, crop, _ in found]
    width_px, height_px = max(extents_px, key=lambda extent: float(extent[0] * extent[1])).tolist()
    size = request.size
    if size.dpi is not None:
        return METRES_PER_INCH / size.dpi, ()
    if size.width_m is not None:
        return size.width_m / width_px, ()
    if size.height_m is not None:
        return size.height_m / height_px, ()
    remedy = ("give ", Argument(name="dpi"), ", ", Argument(name="width"), " or ", Argument(name="height"))
    text = f"the scale of the scan is not known: the leaf is {DEFAULT_HEIGHT_M:g} m high"
    return DEFAULT_HEIGHT_M / height_px, (remark("lobed-size-assumed", text, remedy=remedy),)


def _place(
    scan: Scan, found: tuple[int, FlatLobedLeaf, PictureCrop, NDArray[np.bool_]], metres_per_px: float
) -> ModelledLeaf:
    number, flat, crop, small = found
    remarks = []
    if scan.pieces.is_cut(number):
        remarks.append(remark("lobed-at-border", "the leaf reaches the border of the scan, and is cut there"))
    folded = int((flat.ties.areas() <= 0).sum())
    if folded:
        remarks.append(remark("lobed-faces-folded", f"{folded} of {len(flat.ties.node)} faces are folded"))
    cover = np.zeros(small.shape, np.uint8)
    corners = np.round(((flat.ties.places() * [1, -1])[flat.ties.quads()] - 0.5) * 16).astype(np.int32)
    for corner in corners:
        cv2.fillPoly(cover, [corner], 1, shift=4)
    found_px, _ = cv2.findContours(small.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    whole = cv2.drawContours(np.zeros(small.shape, np.uint8), found_px, -1, 1, cv2.FILLED) > 0
    holes = float((whole & ~small).sum() / small.sum())
    if holes >= _HOLES:
        text = f"the mask has holes, {holes:.0%} of the leaf: there the texture is transparent, and the faces go on"
        remarks.append(remark("lobed-holes", text))
    covered = cover > 0
    iou = float((covered & whole).sum() / (covered | whole).sum())
    if iou < _GOOD_IOU:
        text = f"the faces agree with the mask by an IoU of {iou:.3f}, below {_GOOD_IOU:g}"
        remarks.append(remark("lobed-faces-inexact", text))
    return ModelledLeaf(
        number=number,
        flat=flat,
        crop=crop,
        leaf=place_leaf(flat, (scan.photo.width_px, scan.photo.height_px), metres_per_px, crop),
        mask=scan.pieces.mask(number),
        iou=iou,
        remarks=tuple(remarks),
    )
