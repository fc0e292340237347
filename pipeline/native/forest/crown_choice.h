// The best of crowns that lie within one another.

#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

namespace usdfoliage {

// Take crowns one after another, but none that is near to one that was taken.
//
// @param place_m   n * 2
// @param radius_m  n, above 0
// @param order     n numbers of crowns, the best first
// @param apart     of the sum of two radii, within which only one is taken
// @return          numbers of those that were taken, in that order
std::vector<std::int32_t> choose_crowns(const double* place_m, const double* radius_m, const std::int32_t* order,
                                        std::size_t n, double apart);

}  // namespace usdfoliage
