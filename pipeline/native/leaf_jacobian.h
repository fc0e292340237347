// Derivatives of a leaf's points by its 21 parameters, for fits.

#pragma once

#include <cstddef>

namespace usdfoliage {

// Points of leaves and their derivatives by the parameters, in the order in which a leaf holds them.
//
// Where the axis stands upright its normal has no derivative and is held.
//
// @param leaves     n * 21
// @param uv         n * p * 2, or p * 2 for all leaves alike
// @param points     n * p * 3, written; may be null
// @param jacobians  n * p * 3 * 21, written
template <typename Real>
void leaf_jacobians(const double* leaves, std::size_t n, const double* uv, std::size_t p, bool alike, Real* points,
                    Real* jacobians, int threads);

}  // namespace usdfoliage
