// The shortest links that make one piece of points in several.

#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

namespace usdfoliage {

// Of all sets of links that join every piece with every other one, that which is shortest in sum: a minimum spanning tree
// of the pieces. Which of links of the same length is taken is left open, but always the same for the same input.
//
// Source: O. Boruvka, 1926, with a kd-tree whose boxes know when all their points are of one piece, as W. B. March,
// P. Ram and A. G. Gray, Fast Euclidean minimum spanning tree, 2010, but from one point at a time.
//
// @param points    n * 3, finite
// @param piece_of  n, from 0 on
// @param pieces    how many there are, none without a point
// @return          start and end of each link, pieces - 1 of them
std::vector<std::int64_t> bridge_pieces(const double* points, const std::int32_t* piece_of, std::size_t n,
                                        std::size_t pieces);

}  // namespace usdfoliage
