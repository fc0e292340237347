// Even samples of the points of leaves, and which of them lie apart.

#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

namespace usdfoliage {

// Points of leaves, leaf after leaf.
struct LeafCloud {
    const double* points;         // 3 a point
    const std::uint8_t* edge;     // whether the leaf ends there
    const std::int64_t* offsets;  // leaves + 1
    std::size_t leaves;
};

struct SampleSettings {
    std::int64_t interior, edge;  // points of a leaf at most
    std::int64_t before_spread;   // times as many are looked at as are wanted
    double apart;                 // median distances to the fourth neighbour, beyond which a point lies apart
};

struct SampledPoints {
    std::vector<std::int64_t> index;    // among the points, along a curve that fills the box of each leaf
    std::vector<std::uint8_t> apart;    // of each
    std::vector<std::int64_t> offsets;  // leaves + 1
};

// The same points whatever the number of threads; those that are not finite are never among them.
SampledPoints sample_leaf_points(const LeafCloud& cloud, const SampleSettings& settings, int threads);

}  // namespace usdfoliage
