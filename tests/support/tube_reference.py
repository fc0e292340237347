"""What the native functions of tubes compute, plainly: for comparison."""

import numpy as np
from usdfoliage.branch.cage.rings import GROWTH, LONG, MAX_SAMPLES, PER_INTERVAL, STEADY
from usdfoliage.branch.cage.tubes import arcs_along, rotate_between

SIDES = 6


def axis(tubes, tube, arc_m):
    at = tubes.segment(tube, arc_m)
    share = np.clip((arc_m - tubes.arc_m[at]) / (tubes.arc_m[at + 1] - tubes.arc_m[at]), 0, 1)
    points = tubes.points_m[at] + share[:, None] * (tubes.points_m[at + 1] - tubes.points_m[at])
    return points, tubes.radius_m[at] + share * (tubes.radius_m[at + 1] - tubes.radius_m[at])


def tangents(tubes, tube, arc_m, reach_m):
    ahead, _ = axis(tubes, tube, np.minimum(arc_m + reach_m, tubes.length_m[tube]))
    behind, _ = axis(tubes, tube, np.maximum(arc_m - reach_m, 0))
    chord = ahead - behind
    folded = np.linalg.norm(chord, axis=1) < 0.2 * reach_m
    chord[folded] = tubes.direction[tubes.segment(tube[folded], arc_m[folded])]
    return chord / np.linalg.norm(chord, axis=1, keepdims=True)


def frames(tubes, tube, arc_m, tangent):
    at = tubes.segment(tube, arc_m)
    first = rotate_between(tubes.direction[at], tangent, tubes.reference[at])
    first -= np.sum(first * tangent, axis=1, keepdims=True) * tangent
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    return first, np.cross(tangent, first)


def nearest(tubes, tube, at, places):
    """Points, arcs and radii: of each place on its own."""
    found = []
    for number, segment, place in zip(tube.tolist(), at.tolist(), places, strict=True):
        low, high = tubes.first[number], tubes.first[number] + tubes.counts[number] - 2

        def along(k, place=place):
            return (place - tubes.points_m[k]) @ tubes.direction[k]

        def away(k, place=place, along=along):
            nearest = np.clip(along(k), 0, tubes.arc_m[k + 1] - tubes.arc_m[k])
            return np.linalg.norm(place - tubes.points_m[k] - nearest * tubes.direction[k])

        while True:
            step = tubes.arc_m[segment + 1] - tubes.arc_m[segment]
            share = along(segment) / step
            following = min(max(segment + (share > 1) - (share < 0), low), high)
            if not away(following) < away(segment):
                break
            segment = following
        share = np.clip(share, 0, 1)
        point = tubes.points_m[segment] + share * step * tubes.direction[segment]
        radius = (1 - share) * tubes.radius_m[segment] + share * tubes.radius_m[segment + 1]
        found.append((point, tubes.arc_m[segment] + share * step, radius))
    return tuple(np.array(values) for values in zip(*found, strict=True))


def fill_gaps(tubes, tube, gaps, tolerance, longest):
    """Gaps and arcs of rings, gap after gap."""
    max_reach = 0.25 * tubes.stride_m
    added = []
    for number, (of, (low, length, below, above)) in enumerate(zip(tube.tolist(), gaps.tolist(), strict=True)):
        own = np.full(2, of)
        thinnest = axis(tubes, own, np.array([low, low + length]))[1].min()
        count = int(np.clip(np.ceil(length / thinnest), PER_INTERVAL, MAX_SAMPLES))
        arc = low + (np.arange(count) + 0.5) / count * length
        of = np.full(count, of)
        local = axis(tubes, of, arc)[1]
        wanted = np.minimum(below + GROWTH * (arc - low), above + GROWTH * (low + length - arc))
        wanted = np.minimum(wanted, longest * local)
        wanted = np.minimum(wanted, bend_spacing(tubes, of, arc, local, tolerance, max_reach))
        walked = np.cumsum(length / count / np.maximum(wanted, 0.9 * local))
        rows = max(round(walked[-1]), 1)
        aims = walked[-1] * np.arange(1, rows) / rows
        ends = low + np.arange(count + 1) / count * length
        added += [(number, place) for place in np.interp(aims, np.append(0, walked), ends)]
    return added


def bend_spacing(tubes, tube, arc, radius, tolerance, max_reach):
    at = tubes.segment(tube, arc)
    key, reach = tube * tubes.stride_m, np.minimum(radius, max_reach)
    ahead = np.interp(key + np.minimum(arc + reach, tubes.length_m[tube]), tubes.key_m, tubes.turned_rad)
    behind = np.interp(key + np.maximum(arc - reach, 0), tubes.key_m, tubes.turned_rad)
    spacing = np.sqrt(8 * tolerance * radius / np.maximum((ahead - behind) / (2 * reach), 1e-12))
    return np.where(tubes.arc_m[at + 1] - tubes.arc_m[at] > LONG * radius, STEADY * radius, spacing)


def round_rings(tube, center, tangent, first, second, angles, radius, at_vertices):
    """Points and radii, all rings once more as long as any two cross."""
    radius = radius.copy()
    same_next = np.diff(tube) == 0
    for _ in range(8):
        points = center[:, None] + (at_vertices * radius)[:, None, None] * (
            np.cos(angles)[..., None] * first[:, None] + np.sin(angles)[..., None] * second[:, None]
        )
        forward = np.einsum("njk,nk->nj", np.diff(points, axis=0), tangent[1:] + tangent[:-1]).min(axis=1)
        folded = same_next & (forward < 0.2 * np.linalg.norm(np.diff(center, axis=0), axis=1))
        if not folded.any():
            break
        radius[np.append(folded, False) | np.insert(folded, 0, False)] *= 0.8
    return points, radius


def bend_start(points, radius, step, kept, fade, samples, min_apart):
    """Old arcs, points, radii, by how much they moved, and new arcs."""
    arc = arcs_along(points)
    added = kept + fade * np.linspace(0, 1, samples + 1)
    added = added[added < arc[-1]]
    apart = np.abs(added[:, None] - arc).min(axis=1) > min_apart * fade
    both = np.sort(np.concatenate([arc, added[apart]]))
    share = np.clip((both - kept) / fade, 0, 1)
    moved = (1 - share**2 * (3 - 2 * share))[:, None] * step
    bent = np.stack([np.interp(both, arc, column) for column in points.T], axis=1) + moved
    return both, bent, np.interp(both, arc, radius), moved, arcs_along(bent)
