// Axes of tubes, and what is at a place along one.

#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>

namespace usdfoliage {

// Axes of tubes, one after another.
struct TubeAxes {
    const double* points;     // 3 each
    const double* radius;     // of each point
    const double* arc;        // of each point, from the start of its tube
    const double* direction;  // 3 each, unit, of the segment that starts there
    const std::int64_t* first;   // of each tube
    const std::int64_t* counts;  // of each tube, at least 2
};

using TubeVector = std::array<double, 3>;

struct TubePlace {
    TubeVector point;
    double arc, radius;
};

inline double dot(const TubeVector& a, const TubeVector& b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }
inline TubeVector cross(const TubeVector& a, const TubeVector& b) {
    return {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
}
inline TubeVector between(const TubeVector& from, const TubeVector& to) {
    return {to[0] - from[0], to[1] - from[1], to[2] - from[2]};
}
inline double length(const TubeVector& a) { return std::sqrt(dot(a, a)); }
inline TubeVector vector_at(const double* values, std::int64_t at) {
    return {values[3 * at], values[3 * at + 1], values[3 * at + 2]};
}

inline double tube_length(const TubeAxes& axes, std::int64_t tube) {
    return axes.arc[axes.first[tube] + axes.counts[tube] - 1];
}

// First point of the segment at a place.
inline std::int64_t tube_segment(const TubeAxes& axes, std::int64_t tube, double arc) {
    const std::int64_t first = axes.first[tube], last = first + axes.counts[tube] - 2;
    const auto found = std::upper_bound(axes.arc + first, axes.arc + last + 2, arc) - axes.arc - 1;
    return std::clamp(static_cast<std::int64_t>(found), first, last);
}

// Point and radius; beyond the ends those of the end.
inline TubePlace tube_axis(const TubeAxes& axes, std::int64_t tube, double arc) {
    const std::int64_t at = tube_segment(axes, tube, arc);
    const double share = std::clamp((arc - axes.arc[at]) / (axes.arc[at + 1] - axes.arc[at]), 0.0, 1.0);
    const TubeVector low = vector_at(axes.points, at), step = between(low, vector_at(axes.points, at + 1));
    return {{low[0] + share * step[0], low[1] + share * step[1], low[2] + share * step[2]},
            arc,
            axes.radius[at] + share * (axes.radius[at + 1] - axes.radius[at])};
}

// Unit chord over the axis from reach before a place to reach after it.
inline TubeVector tube_tangent(const TubeAxes& axes, std::int64_t tube, double arc, double reach) {
    TubeVector chord = between(tube_axis(axes, tube, std::max(arc - reach, 0.0)).point,
                               tube_axis(axes, tube, std::min(arc + reach, tube_length(axes, tube))).point);
    // Where the axis comes back on itself the chord has no direction, and the segment's is taken.
    if (length(chord) < 0.2 * reach) chord = vector_at(axes.direction, tube_segment(axes, tube, arc));
    const double size = length(chord);
    return {chord[0] / size, chord[1] / size, chord[2] / size};
}

inline double segment_share(const TubeAxes& axes, std::int64_t at, const TubeVector& place) {
    return dot(between(vector_at(axes.points, at), place), vector_at(axes.direction, at)) / (axes.arc[at + 1] - axes.arc[at]);
}

inline double segment_distance(const TubeAxes& axes, std::int64_t at, const TubeVector& place) {
    TubeVector offset = between(vector_at(axes.points, at), place);
    const TubeVector direction = vector_at(axes.direction, at);
    const double along = std::clamp(dot(offset, direction), 0.0, axes.arc[at + 1] - axes.arc[at]);
    for (std::size_t k = 0; k < 3; ++k) offset[k] -= along * direction[k];
    return length(offset);
}

// The place of a tube next to a point, from the segment (in and out) where the last one was.
inline TubePlace tube_nearest(const TubeAxes& axes, std::int64_t tube, const TubeVector& place, int max_steps,
                              std::int64_t& at) {
    const std::int64_t low = axes.first[tube], high = low + axes.counts[tube] - 2;
    for (int step = 0; step < max_steps; ++step) {
        const double share = segment_share(axes, at, place);
        const std::int64_t next = share > 1 && at < high ? at + 1 : share < 0 && at > low ? at - 1 : at;
        // Only to a neighbour that is nearer, or a corner would be stepped over for ever.
        if (next == at || !(segment_distance(axes, next, place) < segment_distance(axes, at, place))) break;
        at = next;
    }
    const double share = std::clamp(segment_share(axes, at, place), 0.0, 1.0);
    const TubeVector start = vector_at(axes.points, at), direction = vector_at(axes.direction, at);
    const double along = share * (axes.arc[at + 1] - axes.arc[at]);
    return {{start[0] + along * direction[0], start[1] + along * direction[1], start[2] + along * direction[2]},
            axes.arc[at] + along,
            axes.radius[at] + share * (axes.radius[at + 1] - axes.radius[at])};
}

}  // namespace usdfoliage
