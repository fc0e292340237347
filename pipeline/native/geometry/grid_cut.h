// Minimum cut of a 4-connected grid of pixels.

#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

namespace usdfoliage {

// Divide the pixels of a grid between two ends so that the capacities of the cut edges sum to as little as possible.
//
// @param down      rows * columns, capacity from a pixel to the next one below; the last row's leads to the first row,
//                  0 where the grid does not close
// @param right     the same to the next one on the right
// @param terminal  rows * columns: capacity to the first end where positive, to the second end where negative
// @return          rows * columns, 0 for the first end and 1 for the second, which gets what either could have
//
// Source: Y. Boykov and V. Kolmogorov, An Experimental Comparison of Min-Cut/Max-Flow Algorithms, PAMI 2004, section 3.
std::vector<std::uint8_t> cut_grid(const std::int32_t* down, const std::int32_t* right, const std::int32_t* terminal,
                                   std::size_t rows, std::size_t columns);

}  // namespace usdfoliage
