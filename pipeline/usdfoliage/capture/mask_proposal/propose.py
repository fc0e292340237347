"""A mask proposed for a photograph that came without one: the crown of the tree in the middle.

The sky is found first; then an envelope distinguishes the crown from its neighbours and from the ground; clusters of
colour and texture, learnt inside and around it, decide which pixels belong to it; GrabCut and a guided filter draw the
silhouette.

Source: C. Rother et al., GrabCut, 2004; K. He and J. Sun, Fast Guided Filter, 2015. The priors and the order: our own.
"""

import logging
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from usdfoliage.capture.folder.masks import CleanMaskSettings, clean_mask
from usdfoliage.capture.mask_proposal.envelope import Candidate, fit_crown_envelopes
from usdfoliage.capture.sky import segment_sky
from usdfoliage.errors import CaptureError, FitError
from usdfoliage.geometry.color import encode_srgb, luminance
from usdfoliage.remarks import Argument

logger = logging.getLogger(__name__)

_CLUSTERS = 24
_WORTH_FOLIAGE = 0.15  # colours of foliage instead of walls and roads
_WORTH_LIKENESS = 0.12  # colours seen before the sky rather than beside the envelope
_LOW_CONFIDENCE = 0.5
_GIVE_MASK = ("give its mask with ", Argument(name="mask"))


@dataclass(frozen=True, kw_only=True)
class MaskProposalSettings:
    """How much work a proposal is worth."""

    coarse_px: int = 400  # longest side while the crown is looked for
    fine_px: int = 600  # longest side while its silhouette is drawn
    min_contrast: float = 0.08  # below it the picture shows no crown that differs from what is around it

    def __post_init__(self) -> None:
        if not 100 <= self.coarse_px <= self.fine_px:
            raise ValueError(f"coarse_px and fine_px must be at least 100 and in order, not {self}")
        if not 0 <= self.min_contrast < 1:
            raise ValueError(f"min_contrast must be in [0, 1), not {self.min_contrast}")


@dataclass(frozen=True, kw_only=True, eq=False)
class MaskProposal:
    """A mask to be looked at."""

    mask: NDArray[np.bool_]  # (H, W), one component without holes
    confidence: float  # 0 to 1
    remark: str  # one sentence for the report


def propose_mask(
    photo_linear: NDArray[np.float32],
    settings: MaskProposalSettings = MaskProposalSettings(),
    *,
    seed: int = 0,
) -> MaskProposal:
    """Propose the crown's mask, trunk and ground left out, sky gaps filled.

    Args:
        photo_linear: (H, W, 3), linear Rec.709.
        settings: Resolutions and when to give up.
        seed: For clusters, search and GrabCut; the same seed gives the same mask.

    Raises:
        ValueError: photo_linear is not (H, W, 3).
        FitError: No crown is found; a mask must be given.
    """
    if photo_linear.ndim != 3 or photo_linear.shape[2] != 3:
        raise ValueError(f"photo_linear must be (H, W, 3), not {photo_linear.shape}")
    full = _display_bgr(photo_linear)
    coarse = _shrink(full, settings.coarse_px)
    rng = np.random.default_rng(seed)
    sky_seed, cluster_seed, cut_seed = (int(number) for number in rng.integers(0, 2**31 - 1, 3))  # OpenCV's own

    lab = cv2.cvtColor(coarse.astype(np.float32) / 255, cv2.COLOR_BGR2LAB)
    texture = _local_std(lab[..., 0], 1.5)
    sky = segment_sky(lab, texture, sky_seed)
    if np.count_nonzero(~sky) < 0.02 * sky.size:
        raise FitError("no crown was found in the photograph, nearly all of it is sky", _GIVE_MASK)
    clusters = _cluster(lab, texture, ~sky, cluster_seed)
    liking = _WORTH_FOLIAGE * _foliage(coarse, lab, texture, clusters)
    candidates = fit_crown_envelopes(clusters, sky, liking, 4, rng)
    liking += _WORTH_LIKENESS * _likeness(clusters, sky, candidates)
    candidates = fit_crown_envelopes(clusters, sky, liking, 8, rng)
    contrast = sum(candidate.weight * candidate.contrast for candidate in candidates)
    if contrast < settings.min_contrast:
        raise FitError(
            f"no crown was found in the photograph: the best candidate differs from what is around it by "
            f"{contrast:.2f}, {settings.min_contrast:.2f} needed",
            _GIVE_MASK,
        )
    crown = _classify(coarse, texture, clusters, sky, candidates)
    crown = _draw_silhouette(_shrink(full, settings.fine_px), crown, sky, candidates, cut_seed)
    mask = _to_full_size(full, crown)
    try:
        mask = clean_mask(mask, CleanMaskSettings()).mask
    except CaptureError as error:
        raise FitError(f"no crown was found in the photograph ({error.text})", _GIVE_MASK) from error

    confidence, remark = _assess(mask, _belief(candidates, clusters.shape) > 0.5, contrast, bool(sky.any()))
    logger.info("mask proposed, confidence %.2f: %s", confidence, remark)
    return MaskProposal(mask=mask, confidence=confidence, remark=remark)


def _display_bgr(photo_linear: NDArray[np.float32]) -> NDArray[np.uint8]:
    """(H, W, 3) uint8, sRGB; exposed anew if the photograph is far from white or beyond it, as an EXR may be."""
    white = float(np.percentile(luminance(photo_linear[::4, ::4]), 99))
    gain = 1 / white if white > 1.5 or 0 < white < 0.1 else 1.0
    encoded = encode_srgb(np.clip(photo_linear[..., ::-1] * np.float32(gain), 0, 1))
    return np.asarray(np.rint(encoded * 255), np.uint8)


def _shrink(image: NDArray[np.uint8], longest_px: int) -> NDArray[np.uint8]:
    height, width = image.shape[:2]
    scale = min(1.0, longest_px / max(height, width))
    size = max(1, round(width * scale)), max(1, round(height * scale))
    return np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA), np.uint8)


def _local_std(values: NDArray[np.float32], sigma_px: float) -> NDArray[np.float32]:
    mean = cv2.GaussianBlur(values, (0, 0), sigma_px)
    return np.asarray(np.sqrt(np.maximum(cv2.GaussianBlur(values**2, (0, 0), sigma_px) - mean**2, 0)))


def _disc(radius_px: int) -> NDArray[np.uint8]:
    return np.asarray(cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * radius_px + 1, 2 * radius_px + 1)))


def _cluster(
    lab: NDArray[np.float32], texture: NDArray[np.float32], solid: NDArray[np.bool_], seed: int
) -> NDArray[np.intp]:
    """(H, W), which of the clusters of colour and texture each pixel is most like."""
    features = np.dstack(
        [
            0.6 * cv2.GaussianBlur(lab[..., 0], (0, 0), 2),  # light and shadow differ within a crown
            cv2.GaussianBlur(lab[..., 1], (0, 0), 1.5),
            cv2.GaussianBlur(lab[..., 2], (0, 0), 1.5),
            2.5 * np.minimum(cv2.GaussianBlur(texture, (0, 0), 4), 20),
        ]
    ).astype(np.float32)
    samples = features[solid]
    samples = samples[:: max(1, len(samples) // 6000)]
    cv2.setRNGSeed(seed)
    stop = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 15, 0.5)
    _, _, centers = cv2.kmeans(samples, min(_CLUSTERS, len(samples)), None, stop, 2, cv2.KMEANS_PP_CENTERS)
    distances = np.stack([np.sum((features - center) ** 2, axis=2) for center in centers])
    return np.asarray(np.argmin(distances, axis=0))


def _foliage(
    bgr: NDArray[np.uint8], lab: NDArray[np.float32], texture: NDArray[np.float32], clusters: NDArray[np.intp]
) -> NDArray[np.float64]:
    """(K,), -1 to 1: foliage is coloured, but not blue, or dark, and never smooth."""
    blue, green, red = np.moveaxis(cv2.GaussianBlur(bgr.astype(np.float32), (0, 0), 1.5), 2, 0)
    high = np.maximum(np.maximum(blue, green), red)
    saturation = (high - np.minimum(np.minimum(blue, green), red)) / np.maximum(high, 20)
    value = np.clip((saturation - 0.2) / 0.15, -1, 1)
    value = np.where((blue > red) & (blue >= green), -0.5, value)
    value = np.where(lab[..., 0] < 22, np.maximum(value, 0), value)
    value = np.minimum(value, np.clip(cv2.GaussianBlur(texture, (0, 0), 4) - 2, -1, 1))
    count = np.bincount(clusters.ravel())
    return np.asarray(np.bincount(clusters.ravel(), value.ravel()) / np.maximum(count, 1))


def _classify(
    bgr: NDArray[np.uint8],
    texture: NDArray[np.float32],
    clusters: NDArray[np.intp],
    sky: NDArray[np.bool_],
    candidates: list[Candidate],
) -> NDArray[np.uint8]:
    """The crown, (H, W) of 0 and 1: near the envelope, and looking like what is inside rather than around it."""
    prior = np.full(sky.shape, 0.3)  # log odds
    reach = np.zeros(sky.shape)  # of 1 where an envelope is near
    for envelope, share, _ in candidates:
        inside = envelope.fill(sky.shape).astype(np.uint8)
        radius_px = np.sqrt(max(1, inside.sum()) / np.pi)
        depth = cv2.distanceTransform(inside, cv2.DIST_L2, 5) - cv2.distanceTransform(1 - inside, cv2.DIST_L2, 5)
        prior += share * np.clip(8 * depth / radius_px, -4, 2)
        reach += share * (depth > -0.8 * radius_px)
    exposed = _exposed(sky, candidates)
    prior = np.where(exposed, np.maximum(prior, 0.7), prior)
    prior += np.clip(cv2.GaussianBlur(texture, (0, 0), 4) - 2.5, -2, 0.3)

    weight = np.where(sky, 0.0, 0.1 + reach)  # what is far away counts little
    crown = np.where(sky, 0, 1 / (1 + np.exp(-2 * prior)))
    for _ in range(5):
        seen_in = np.bincount(clusters.ravel(), (weight * crown).ravel())
        seen_out = np.bincount(clusters.ravel(), (weight * (1 - crown)).ravel())
        odds = np.log((seen_in / seen_in.sum() + 0.005) / (seen_out / max(seen_out.sum(), 1e-9) + 0.005))
        evidence = np.where(sky, -6, np.clip(odds, -2.5, 2.5)[clusters] + prior).astype(np.float32)
        evidence = cv2.ximgproc.guidedFilter(bgr, evidence, 6, 25.0**2)
        crown = np.where(sky, 0, 1 / (1 + np.exp(-evidence)))
    return _one_crown((crown > 0.5).astype(np.uint8))


def _exposed(sky: NDArray[np.bool_], candidates: list[Candidate]) -> NDArray[np.bool_]:
    """What stands before the sky above the widest row and not far from the axis."""
    height, width = sky.shape
    rows, columns = np.arange(height)[:, None], np.arange(width)
    belief = np.zeros(sky.shape)
    for envelope, share, _ in candidates:
        widest_row = envelope.top_px + envelope.widest * (envelope.bottom_px - envelope.top_px)
        west, east = envelope.axis_px - 1.15 * envelope.left_px, envelope.axis_px + 1.15 * envelope.right_px
        belief += share * ((rows < widest_row) & (columns > west) & (columns < east))
    return np.asarray(~sky & (belief > 0.5))


def _belief(candidates: list[Candidate], shape: tuple[int, int]) -> NDArray[np.float64]:
    """(H, W), 0 to 1, the share of the candidates that hold each pixel."""
    belief = np.zeros(shape)
    for envelope, share, _ in candidates:
        belief += share * envelope.fill(shape)
    return belief


def _likeness(clusters: NDArray[np.intp], sky: NDArray[np.bool_], candidates: list[Candidate]) -> NDArray[np.float64]:
    """(K,), -1 to 1: whether a cluster is seen before the sky, where only the crown can be, or around the envelope."""
    crown = _exposed(sky, candidates)
    around = ~sky & ~crown & (_belief(candidates, sky.shape) < 0.5)
    count = int(clusters.max()) + 1
    if np.count_nonzero(crown) < 0.01 * sky.size or not around.any():
        return np.zeros(count)
    seen_in = np.bincount(clusters[crown], minlength=count) / np.count_nonzero(crown)
    seen_out = np.bincount(clusters[around], minlength=count) / np.count_nonzero(around)
    return np.asarray(np.clip(np.log((seen_in + 0.005) / (seen_out + 0.005)) / 2, -1, 1))


def _one_crown(crown: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """The largest component with its gaps closed and the trunk taken off."""
    count, labels, stats, _ = cv2.connectedComponentsWithStats(crown)
    if count < 2:
        raise FitError("no crown was found in the photograph", _GIVE_MASK)
    largest = 1 + int(np.argmax(stats[1:, cv2.CC_STAT_AREA]))
    size_px = float(np.sqrt(stats[largest, cv2.CC_STAT_AREA]))
    crown = _morph((labels == largest).astype(np.uint8), cv2.MORPH_CLOSE, max(1, round(0.025 * size_px)))

    _, labels, stats, _ = cv2.connectedComponentsWithStats(1 - crown, connectivity=4)
    is_hole = np.ones(len(stats), np.bool_)
    is_hole[0] = False
    for border in (labels[0], labels[-1], labels[:, 0], labels[:, -1]):
        is_hole[border] = False
    crown = np.maximum(crown, is_hole[labels].astype(np.uint8))

    # Below its middle a crown is broad: what an opening takes away there is trunk, stakes and posts.
    middle = int(np.average(np.arange(len(crown)), weights=crown.sum(axis=1)))
    radius = max(2, round(0.06 * size_px))
    broad = cv2.dilate(_morph(crown, cv2.MORPH_OPEN, radius), _disc(max(1, radius // 3))) & crown
    broad[:middle] = crown[:middle]
    _, labels, stats, _ = cv2.connectedComponentsWithStats(broad)
    largest = 1 + int(np.argmax(stats[1:, cv2.CC_STAT_AREA]))
    return np.asarray(labels == largest, np.uint8)


def _morph(mask: NDArray[np.uint8], operation: int, radius_px: int) -> NDArray[np.uint8]:
    """Open or close as if the picture went on beyond its border."""
    margin = 2 * radius_px
    wide = cv2.copyMakeBorder(mask, margin, margin, margin, margin, cv2.BORDER_REPLICATE)
    return np.asarray(cv2.morphologyEx(wide, operation, _disc(radius_px))[margin:-margin, margin:-margin])


def _draw_silhouette(
    bgr: NDArray[np.uint8],
    crown: NDArray[np.uint8],
    sky: NDArray[np.bool_],
    candidates: list[Candidate],
    seed: int,
) -> NDArray[np.uint8]:
    """GrabCut in a band along the silhouette; what stands before the sky beside it is crown."""
    size = bgr.shape[1], bgr.shape[0]
    exposed = _exposed(sky, candidates).astype(np.uint8)
    crown = cv2.resize(crown, size, interpolation=cv2.INTER_NEAREST)
    exposed = cv2.resize(exposed, size, interpolation=cv2.INTER_NEAREST)
    band = max(2, round(0.03 * float(np.sqrt(crown.sum()))))
    labels = np.full(crown.shape, cv2.GC_BGD, np.uint8)
    labels[cv2.dilate(crown, _disc(band)) > 0] = cv2.GC_PR_BGD
    labels[crown > 0] = cv2.GC_PR_FGD
    labels[cv2.erode(crown, _disc(band)) > 0] = cv2.GC_FGD
    labels[(labels == cv2.GC_PR_BGD) & (exposed > 0)] = cv2.GC_PR_FGD
    rows, columns = (np.nonzero(np.any(labels != cv2.GC_BGD, axis=axis))[0] for axis in (1, 0))
    top, left = (
        max(0, rows[0] - 2 * band),
        max(0, columns[0] - 2 * band),
    )  # colours farther off would only blur the model
    around = np.s_[top : rows[-1] + 2 * band + 1, left : columns[-1] + 2 * band + 1]
    cut = labels[around].copy()
    if np.any(cut == cv2.GC_FGD) and np.any(cut == cv2.GC_BGD):
        cv2.setRNGSeed(seed)
        models = np.zeros((1, 65)), np.zeros((1, 65))
        cv2.grabCut(np.ascontiguousarray(bgr[around]), cut, None, *models, 2, cv2.GC_INIT_WITH_MASK)
        labels[around] = cut
    drawn = ((labels == cv2.GC_FGD) | (labels == cv2.GC_PR_FGD)).astype(np.uint8)
    return _one_crown(drawn)


def _to_full_size(full: NDArray[np.uint8], crown: NDArray[np.uint8]) -> NDArray[np.bool_]:
    height, width = full.shape[:2]
    if crown.shape == (height, width):
        return crown > 0
    scale = max(height, width) / max(crown.shape)
    soft = cv2.resize(crown.astype(np.float32), (width, height), interpolation=cv2.INTER_LINEAR)
    soft = cv2.ximgproc.guidedFilter(full, soft, max(2, round(2 * scale)), 10.0**2, None, -1, 1 / scale)
    return np.asarray(soft > 0.5)


def _assess(mask: NDArray[np.bool_], envelope: NDArray[np.bool_], contrast: float, has_sky: bool) -> tuple[float, str]:
    """How far to trust the proposal, and why not further."""
    small = cv2.resize(mask.astype(np.uint8), envelope.shape[::-1], interpolation=cv2.INTER_AREA) > 0
    agreement = np.count_nonzero(small & envelope) / np.count_nonzero(small | envelope)
    borders = {"left": mask[:, 0], "right": mask[:, -1], "top": mask[0], "bottom": mask[-1]}
    cut = [name for name, pixels in borders.items() if np.mean(pixels) > 0.1]

    factors = {
        f"the crown differs little from what is around it ({contrast:.2f} of 1)": min(1.0, contrast / 0.5),
        f"its silhouette is far from a crown's shape ({agreement:.0%} in common)": min(1.0, agreement / 0.85),
        "no sky is seen behind it": 1.0 if has_sky else 0.6,
        f"it reaches the image border ({', '.join(cut)})": 0.7 if cut else 1.0,
    }
    confidence = float(np.prod(list(factors.values())))
    problems = [problem for problem, factor in factors.items() if factor < 0.8]
    if not problems:
        return confidence, "the crown stands out clearly"
    lead = "uncertain" if confidence < _LOW_CONFIDENCE else "to be checked"
    return confidence, f"{lead}: {'; '.join(problems)}"
