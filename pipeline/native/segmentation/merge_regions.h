// Points that are joined to regions, and regions to larger ones, the most strongly linked first.

#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

namespace usdfoliage {

// What was joined: one entry for each join, in the order of the rounds, and of the pairs' points in a round.
struct MergedRegions {
    std::vector<std::int64_t> children;  // two of each: nodes, the larger first; a point's node is its number
    std::vector<double> linkage;         // strength of the link between the two
    std::vector<double> across;          // weight of it: the sum of the links between them
    std::vector<std::int64_t> size;      // points
    std::vector<std::int64_t> rounds;    // where the joins of each round begin, and their number at the end
};

// Join regions that are each other's most strongly linked neighbour, all such pairs of a round at once, until none is left.
//
// A region is known by the point that it began with; of two the larger keeps its own, of equals that of the lower point.
// Of equal links the one with the lowest points is the strongest. The strength of a link is the sum of the weights
// between both regions, divided by a power of the size of the smaller. A round looks only at regions of which a link has
// changed in the round before, so that a region that grows point by point costs no more than its own links each time.
//
// Source: F. Murtagh, A survey of recent advances in hierarchical clustering algorithms, 1983, section 3.
//
// @param count    points
// @param first    n, of each link the lower point
// @param second   n, the higher; links are in the order of both, none is twice
// @param weight   n, of each link
// @param divisor  count + 1, by which a weight is divided, for each size of the smaller region
// @param weakest  strength at which nothing is joined any more
MergedRegions merge_regions(std::size_t count, const std::int64_t* first, const std::int64_t* second, const double* weight,
                            std::size_t n, const double* divisor, double weakest);

}  // namespace usdfoliage
