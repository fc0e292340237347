// Frames along the axes of tubes that do not turn about them.

#pragma once

#include <cstddef>
#include <cstdint>

namespace usdfoliage {

// Turn a vector by the smallest rotation that takes one unit vector to another, and make it a unit normal of that.
void carry_normal(const double* from, const double* to, const double* vector, double* out);

// Carry a unit normal along each tube, by the smallest rotations from segment to segment.
//
// @param direction  3 each, unit, of the segment that starts at each point.
// @param reference  3 each; that of each tube's first point is given, the others are filled in.
void carry_references(const double* direction, const std::int64_t* first, const std::int64_t* counts, std::size_t n_tubes,
                      double* reference, int threads);

}  // namespace usdfoliage
