// Rings along the axes of tubes: how many stand between those that must be, and how wide they may be in bends.

#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "branch_cage/tube_axes.h"

namespace usdfoliage {

// A stretch between two rings that are given.
struct RingGap {
    std::int64_t tube;
    double low, length;       // arc at which it begins
    double below, above;      // spacing that is asked for at its ends
};

struct RingSpacingSettings {
    double tolerance;     // of its radius, by how much a tube may leave its axis
    double longest;       // spacing, in radii
    double growth;        // of the spacing, per length away from the ends of a gap
    double steady;        // spacing in radii on segments that are long
    double long_segment;  // radii: its corners have rings of their own
    double max_reach_m;    // over which bends are measured
    std::int64_t min_samples, max_samples;  // of the spacing in a gap
};

struct AddedRings {
    std::vector<std::int64_t> gap;
    std::vector<double> arc;
};

// Rings in gaps, so many as bends ask for, closer towards the ends; gap after gap, in order along each.
//
// @param turned  of each point of the axes, by how much its tube has turned up to there.
AddedRings fill_gaps(const TubeAxes& axes, const double* turned, const RingGap* gaps, std::size_t n, const RingSpacingSettings& settings,
                     int threads);

struct RingCircles {
    const std::int64_t* tube;  // of each ring; those of a tube follow one another
    const double* center;      // 3 each
    const double* tangent;     // 3 each, unit
    const double* first;       // 3 each, unit, with the second one right-handed with the tangent
    const double* second;
    const double* angles;  // 6 each
    std::size_t n;
};

// The six points of each ring (18 each).
//
// @param at_vertices  how much farther out they are than the radius.
// @param radius       in and out: less where neighbouring rings would cross.
void round_rings(const RingCircles& rings, double at_vertices, double* radius, double* points, int threads);

}  // namespace usdfoliage
