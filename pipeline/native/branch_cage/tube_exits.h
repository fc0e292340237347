// How far along its own axis a branch comes out of its parent's surface.

#pragma once

#include <cstddef>
#include <cstdint>

#include "branch_cage/tube_axes.h"

namespace usdfoliage {

struct ExitWalkSettings {
    double cage_factor;  // how much farther from its axis a cage is than its limit
    double thickest;     // of its parent's radius, a branch where it leaves
    double skin;         // radii that do not matter
    int max_steps;
    bool whole_disc;  // else the axis alone is to be outside
};

// Walk on along tubes until they are outside their parents.
//
// @param tube, parent  of n walks.
// @param clearance     of its radius, by how much a disc is to be clear.
// @param at            the parent's segment next to the walk, in and out.
// @param arc           where on the tube the walk is, in and out; at most that of the tip.
// @param done          whether it came out.
void walk_out(const TubeAxes& axes, const std::int64_t* tube, const std::int64_t* parent, const double* clearance,
              std::size_t n, const ExitWalkSettings& settings, std::int64_t* at, double* arc, std::uint8_t* done, int threads);

}  // namespace usdfoliage
