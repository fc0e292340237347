// Derivatives of a leaf's points by its 21 parameters, for fits.

#pragma once

#include <cstddef>

#include "leaf/curves.h"

namespace usdfoliage {

// Derivatives of the control points of Q and D by what they hang on; i numbers the control points.
struct CurveSlopes {
    double foot_axis[3][2];     // by either control point of the axis, the same for each coordinate
    double foot_v[3][3];        // by the control point's own v
    double step_axis[3][2][4];  // by either control point of the axis: [2 rows of D][x, y]
    double step_v[3][2];        // by the control point's own v
    double step_x[3][2];        // by its distance from the axis
};

// Where the axis stands upright its normal has no derivative and is taken as constant.
CurveSlopes curve_slopes(const double* leaf);

// Derivatives of a point by the parameters; with the slopes of the weights by u or by v, those of a tangent.
//
// @param jacobian  3 * 21, written
template <typename Real>
void write_jacobian(const CurveSlopes& slopes, const Along& along, const Across& across, Real* jacobian);

// Derivatives of the part of a point along a direction, for loops over many points.
//
// @param slopes_along  21, written
inline void write_directional_slopes(const CurveSlopes& slopes, const Along& along, const Across& across,
                                     const double* direction, double* slopes_along) {
    const double dx = direction[0], dy = direction[1], dz = direction[2];
    const double foot = across.foot - across.axis, step = across.step;
    for (std::size_t k = 0; k < 2; ++k) {
        double own = 0, by_x = 0, by_y = 0;
        for (std::size_t i = 0; i < 3; ++i) {
            own += along.quartic[i] * slopes.foot_axis[i][k];
            by_x += along.quartic[i] * (slopes.step_axis[i][k][0] * dx + slopes.step_axis[i][k][2] * dy);
            by_y += along.quartic[i] * (slopes.step_axis[i][k][1] * dx + slopes.step_axis[i][k][3] * dy);
        }
        own = across.axis * along.axis[k] + foot * own;
        slopes_along[3 * k] = own * dx + step * by_x;
        slopes_along[3 * k + 1] = own * dy + step * by_y;
        slopes_along[3 * k + 2] = own * dz;
    }
    for (std::size_t i = 0; i < 3; ++i) {
        const double weight = along.quartic[i], upwards = weight * dz, sideways = weight * step;
        slopes_along[6 + 3 * i] =
            weight * foot * (slopes.foot_v[i][0] * dx + slopes.foot_v[i][1] * dy + slopes.foot_v[i][2] * dz) +
            sideways * (slopes.step_v[i][0] * dx + slopes.step_v[i][1] * dy);
        slopes_along[7 + 3 * i] = sideways * (slopes.step_x[i][0] * dx + slopes.step_x[i][1] * dy);
        slopes_along[8 + 3 * i] = upwards * across.height[2];
        slopes_along[15 + i] = upwards * across.height[0];
        slopes_along[18 + i] = upwards * across.height[1];
    }
}

// Points of leaves and their derivatives by the parameters, in the order in which a leaf holds them.
//
// Where the axis stands upright its normal has no derivative and is taken as constant.
//
// @param leaves     n * 21
// @param uv         n * p * 2, or p * 2 that all leaves share
// @param points     n * p * 3, written; may be null
// @param jacobians  n * p * 3 * 21, written
template <typename Real>
void leaf_jacobians(const double* leaves, std::size_t n, const double* uv, std::size_t p, bool shared_uv, Real* points,
                    Real* jacobians, int threads);

}  // namespace usdfoliage
