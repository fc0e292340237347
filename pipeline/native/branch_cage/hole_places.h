// Places along a plant's branches for the holes that other branches leave through.

#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

namespace usdfoliage {

constexpr int kCageSides = 6;

// A hole that looks for a place. Metres along its parent, radians about it.
struct HoleWant {
    double arc;
    double azimuth;
    double half;        // of its sector, at the middle ring of its block
    double tight;       // the same where neighbours are close
    double end_half;    // at the two others
    double half_block;  // along the parent
    double half_along;
    double half_across;
    double parent_radius;
};

// What n_tubes tubes are, parents before children.
struct HoleTubes {
    const double* start;   // n_tubes, from where a tube has rings
    const double* end;     // n_tubes, up to where it may have holes
    const double* length;  // n_tubes
    const double* phase;   // n_tubes, where the first column is to begin; NaN where nothing asks for anything
    const double* steep;   // 2 * n_steep, from and to: stretches without room, in order and apart
    const std::int64_t* steep_first;  // n_tubes + 1
    const std::int64_t* want_first;   // n_tubes + 1, wants by their parents
    const std::int64_t* want_tube;    // the tube of each want
    const std::uint8_t* gone;         // n_tubes, that have no surface
    std::size_t n_tubes;
};

struct HoleSettings {
    double tightest;        // share of its length that a hole may be pressed to
    double relaxed;         // parent radii behind a block, in which columns go back to even ones
    double min_column_rad;  // between neighbouring columns
};

struct HolePlacement {
    std::vector<std::int64_t> block_tube;
    std::vector<double> block_arcs;  // 3 each
    std::vector<std::int64_t> want;  // of each hole
    std::vector<std::int64_t> block;
    std::vector<std::int64_t> sector;
    std::vector<double> arc;     // of each hole, on the parent
    std::vector<double> azimuth;
    std::vector<double> half_along;
    std::vector<double> half_across;
    std::vector<std::int64_t> turn_tube;
    std::vector<double> turn_arc;
    std::vector<double> turn_angles;   // 6 each
    std::vector<std::int64_t> homeless;  // wants without a place
};

// Find a place for each want, those of a tube in their order: the first move least. What has none takes its own along.
//
// @param wants         by parents in the order of want_first: first those that are to move least.
HolePlacement place_holes(const HoleTubes& tubes, std::vector<HoleWant> wants, const HoleSettings& settings);

}  // namespace usdfoliage
