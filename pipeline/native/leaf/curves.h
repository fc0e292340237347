// The curves along a leaf of 21 parameters, from which its surface is made.
//
// Source: Chaurasia and Beardsley, Editable Parametric Dense Foliage from 3D Capture, section 3.

#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>

namespace usdfoliage {

// Numbers a leaf has: rows axis1, axis2, silhouette1..3 (v, x, z), inner, outer, three each, as in usdfoliage.leaf.model.
constexpr std::size_t kLeafNumbers = 21;

// A tangent of the axis shorter than this, seen from above, has no direction.
constexpr double kNoDirection = 1e-12;

// Point, first and second derivative of the axis, a cubic from (0, 0, 0) to (0, 1, 0).
struct AxisAt {
    double point[3], slope[3], bend[3];
};

inline AxisAt axis_at(const double* leaf, double v) {
    const double w = 1 - v;
    AxisAt at;
    for (int c = 0; c < 3; ++c) {
        const double first = leaf[c], second = leaf[3 + c], apex = c == 1 ? 1.0 : 0.0;
        at.point[c] = 3 * w * w * v * first + 3 * w * v * v * second + v * v * v * apex;
        at.slope[c] = 3 * w * w * first + 6 * w * v * (second - first) + 3 * v * v * (apex - second);
        at.bend[c] = 6 * w * (second - 2 * first) + 6 * v * (apex - 2 * second + first);
    }
    return at;
}

// The axis' unit tangent and normal in the leaf's plane; the normal is +x for a straight axis.
struct AxisFrame {
    double tangent[2], normal[2];
    double speed;  // length of the tangent before it was made a unit, not below kNoDirection
};

inline AxisFrame axis_frame(const AxisAt& at) {
    const double speed = std::max(std::sqrt(at.slope[0] * at.slope[0] + at.slope[1] * at.slope[1]), kNoDirection);
    const double x = at.slope[0] / speed, y = at.slope[1] / speed;
    return {{x, y}, {y, -x}, speed};
}

// Derivative of the axis' normal when its tangent, before it was made a unit, changes by (x, y).
inline void turn_normal(const AxisFrame& frame, double x, double y, double* turned) {
    const double rate = (frame.normal[0] * x + frame.normal[1] * y) / frame.speed;
    turned[0] = -rate * frame.tangent[0];
    turned[1] = -rate * frame.tangent[1];
}

// A leaf as curves along v.
//
// The control points of the inner curve, the outer curve and the silhouette lie at 1/3, 2/3 and all of the way from a
// foot on the axis, and a cubic Bezier with evenly spaced control points is linear, so that with b_c the cubic Bernstein
// polynomials of |u|
//
//     L(u, v) = Q(v) + b_0 (A(v) - Q(v)) + u D(v) + z (b_1 inner(v) + b_2 outer(v) + b_3 silhouette(v))
//
// where A is the axis, Q the quartic of the feet, D that of the steps from them to the right silhouette. All ends are the
// base or the apex.
struct LeafCurves {
    double axis[2][3];    // interior control points of A
    double foot[3][3];    // of Q
    double step[3][2];    // of D, which has no height
    double height[3][3];  // [inner, outer, silhouette][i]
};

inline LeafCurves leaf_curves(const double* leaf) {
    LeafCurves curves;
    for (int c = 0; c < 3; ++c) {
        curves.axis[0][c] = leaf[c];
        curves.axis[1][c] = leaf[3 + c];
    }
    for (int i = 0; i < 3; ++i) {
        const double* silhouette = leaf + 6 + 3 * i;
        const AxisAt at = axis_at(leaf, silhouette[0]);
        const AxisFrame frame = axis_frame(at);
        for (int c = 0; c < 3; ++c) curves.foot[i][c] = at.point[c];
        for (int c = 0; c < 2; ++c) curves.step[i][c] = silhouette[1] * frame.normal[c];
        curves.height[0][i] = leaf[15 + i];
        curves.height[1][i] = leaf[18 + i];
        curves.height[2][i] = silhouette[2];
    }
    return curves;
}

// Weights, at one v, of the control points: of the axis without its base, of a quartic without its base.
struct Along {
    double axis[3], quartic[4];
};

inline Along along_at(double v) {
    const double w = 1 - v;
    return {{3 * w * w * v, 3 * w * v * v, v * v * v},
            {4 * w * w * w * v, 6 * w * w * v * v, 4 * w * v * v * v, v * v * v * v}};
}

inline Along along_slope_at(double v) {
    const double w = 1 - v;
    return {{3 * w * w - 6 * w * v, 6 * w * v - 3 * v * v, 3 * v * v},
            {4 * w * w * w - 12 * w * w * v, 12 * w * w * v - 12 * w * v * v, 12 * w * v * v - 4 * v * v * v, 4 * v * v * v}};
}

// Weights, at one u, of the terms of L: of Q, A - Q, D, the three heights, and of what the right silhouette is moved by.
struct Across {
    double foot, axis, step, height[3], moved;
};

inline Across across_at(double u) {
    const double a = std::abs(u), b = 1 - a, edge = a * a * a;
    return {1, b * b * b, u, {3 * b * b * a, 3 * b * a * a, edge}, u < 0 ? -edge : edge};
}

// Their derivatives by u; those of the right half at u = 0.
inline Across across_slope_at(double u) {
    const double a = std::abs(u), b = 1 - a, side = u < 0 ? -1.0 : 1.0;
    return {0, -3 * side * b * b, 1, {3 * side * (b * b - 2 * a * b), 3 * side * (2 * a * b - a * a), 3 * side * a * a}, 3 * a * a};
}

// The terms of L at one v.
struct LeafRow {
    double foot[3], axis[3];    // Q, A - Q
    double step[2], height[3];  // D, heights
    double moved[2] = {0, 0};   // what jitter moves the right silhouette by
};

inline LeafRow leaf_row(const LeafCurves& curves, const Along& along) {
    LeafRow row;
    for (int c = 0; c < 3; ++c) {
        const double apex = c == 1 ? 1.0 : 0.0;
        row.foot[c] = along.quartic[0] * curves.foot[0][c] + along.quartic[1] * curves.foot[1][c] +
                      along.quartic[2] * curves.foot[2][c] + along.quartic[3] * apex;
        row.axis[c] =
            along.axis[0] * curves.axis[0][c] + along.axis[1] * curves.axis[1][c] + along.axis[2] * apex - row.foot[c];
        row.height[c] = along.quartic[0] * curves.height[c][0] + along.quartic[1] * curves.height[c][1] +
                        along.quartic[2] * curves.height[c][2];
    }
    for (int c = 0; c < 2; ++c)
        row.step[c] =
            along.quartic[0] * curves.step[0][c] + along.quartic[1] * curves.step[1][c] + along.quartic[2] * curves.step[2][c];
    return row;
}

inline void leaf_point(const LeafRow& row, const Across& across, double* point) {
    for (int c = 0; c < 2; ++c)
        point[c] = across.foot * row.foot[c] + across.axis * row.axis[c] + across.step * row.step[c] + across.moved * row.moved[c];
    point[2] = across.foot * row.foot[2] + across.axis * row.axis[2] + across.height[0] * row.height[0] +
               across.height[1] * row.height[1] + across.height[2] * row.height[2];
}

// Point of the surface and its derivatives.
struct SurfacePlace {
    double point[3], by_u[3], by_v[3];
};

inline SurfacePlace surface_place(const LeafCurves& curves, double u, double v) {
    SurfacePlace place;
    const LeafRow row = leaf_row(curves, along_at(v));
    const Across across = across_at(u);
    leaf_point(row, across, place.point);
    leaf_point(row, across_slope_at(u), place.by_u);
    // leaf_row's control points without a base are those of the curve, so that only the weights differ for a derivative.
    leaf_point(leaf_row(curves, along_slope_at(v)), across, place.by_v);
    return place;
}

// Control nets: rows along v from base to apex, columns from the left silhouette over the axis to the right one.
//
// @param leaves  n * 21
// @param nets    n * 5 * 7 * 3, written
void leaf_net(const double* leaf, double* net);
void leaf_nets(const double* leaves, std::size_t n, double* nets, int threads);

// The axis and its normals in the leaf's plane.
//
// @param v        n * p, or p that all leaves share
// @param points   n * p * 3, written; may be null
// @param normals  n * p * 3, written; may be null
void leaf_axes(const double* leaves, std::size_t n, const double* v, std::size_t p, bool shared_v, double* points,
               double* normals, int threads);

}  // namespace usdfoliage
