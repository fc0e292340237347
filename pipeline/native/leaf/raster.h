// Leaves drawn into a camera's picture: which leaf every pixel shows, and how far away.

#pragma once

#include <cstddef>
#include <cstdint>

namespace usdfoliage {

// Draw n grids with a z-buffer. A pixel shows what its centre, at half a pixel, shows; of two leaves equally near the first.
//
// @param places  n * rows * columns * 3: x and y in pixels and planar depth; a cell one of whose corners is not finite or
//                not before the camera is left out
// @param ids     height * width, written: number of the grid, -1 for none
// @param depth   height * width, written: planar depth, 0 for none
// @param threads at most this many, 0 for one per core; the result does not depend on it
void draw_leaf_grids(const double* places, std::size_t n, std::size_t rows, std::size_t columns, std::int32_t* ids, float* depth,
                     std::size_t height, std::size_t width, int threads);

}  // namespace usdfoliage
