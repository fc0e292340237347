// Boxes around leaves.

#pragma once

#include <cstddef>

namespace usdfoliage {

// Boxes that contain leaves and leave little room.
//
// A leaf lies within its control net, and no farther from its samples than the second differences of the net allow; the
// box is where both agree.
//
// @param leaves      n * 21
// @param placements  n * 12, rows of 3 x 4 matrices for column vectors; null to stay in leaf space
// @param reach       how far jitter may move a silhouette where it is not faded, in leaf lengths
// @param group       leaves that follow each other and share a box, 1 or more
// @param bounds      a box a group: 2 * 3, least and greatest, written
// @param threads     at most this many, 0 for one per core; the result does not depend on it
void leaf_bounds(const double* leaves, std::size_t n, const double* placements, double reach, std::size_t group, double* bounds,
                 int threads);

}  // namespace usdfoliage
