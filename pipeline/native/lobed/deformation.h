// A lobed leaf in space: functions of each branch rotate a turtle that walks along its flat skeleton.

#pragma once

#include <cstddef>
#include <cstdint>

namespace usdfoliage {

// The flat leaf, two coordinates a place.
struct LobedShape {
    const double* nodes;             // of the skeleton, the base first, each after its parent
    const std::int32_t* parents;     // of each node; the base has none
    const std::int32_t* branches;    // that leads to each node
    const double* spans;             // 2 a node: the parts of its branch at which the step to it begins and ends
    std::size_t node_count, branch_count;
    const std::int32_t* tie_nodes;   // where each tie begins
    const double* feet;              // where it ends
    std::size_t tie_count;
};

// Keys of the functions turn, bend and twist of branches, leaf after leaf: for leaf i, function f and branch b the keys
// are at place (3 i + f) * branches + b of first and counts.
struct LobedFunctions {
    const std::int64_t* first;
    const std::int32_t* counts;
    const double* keys;  // 2 each: position on the branch, and rotation in radians a length of the branch
};

// Leaves of one shape, each deformed by its functions.
//
// @param points  3 a place: for each leaf its nodes, then its feet
void deform_lobed_leaves(const LobedShape& shape, const LobedFunctions& functions, std::size_t leaves, double* points,
                         int threads);

}  // namespace usdfoliage
