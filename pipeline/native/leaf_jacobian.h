// Derivatives of a leaf's points by its 21 parameters, for fits.

#pragma once

#include <cstddef>

#include "leaf_curves.h"

namespace usdfoliage {

// Derivatives of the control points of Q and D by what they hang on; i numbers the control points.
struct CurveSlopes {
    double foot_axis[3][2];     // by either control point of the axis, alike for each coordinate
    double foot_v[3][3];        // by the control point's own v
    double step_axis[3][2][4];  // by either control point of the axis: [2 rows of D][x, y]
    double step_v[3][2];        // by the control point's own v
    double step_x[3][2];        // by its distance from the axis
};

// Where the axis stands upright its normal has no derivative and is held.
CurveSlopes curve_slopes(const double* leaf);

// Derivatives of a point by the parameters; with the slopes of the weights by u or by v, those of a tangent.
//
// @param jacobian  3 * 21, written
template <typename Real>
void write_jacobian(const CurveSlopes& slopes, const Along& along, const Across& across, Real* jacobian);

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
