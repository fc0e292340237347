// The start of an axis moved aside, so that it comes back to where it was farther along.

#pragma once

#include <cstddef>
#include <vector>

namespace usdfoliage {

struct BentAxis {
    std::vector<double> old_arc;  // of each point, before
    std::vector<double> points;   // 3 each, moved
    std::vector<double> radius;
    std::vector<double> moved;    // 3 each, by how much
    std::vector<double> new_arc;
};

struct StartBendSettings {
    double kept_m, fade_m;  // arc up to which all is moved by the same step, and length over which that fades
    int samples;            // stretches that the fading is cut into
    double min_apart;       // of fade_m, between points that are added and those that are there
};

// Move the start of an axis of n points, 2 or more, by a step of 3 numbers.
BentAxis bend_start(const double* points, const double* radius, std::size_t n, const double* step,
                    const StartBendSettings& settings);

}  // namespace usdfoliage
