#include "leaf/jacobian.h"

#include <algorithm>

#include "leaf/curves.h"
#include "parallel.h"

namespace usdfoliage {
namespace {

constexpr std::size_t kBlockSamples = 1024;  // places a thread takes at once

}  // namespace

CurveSlopes curve_slopes(const double* leaf) {
    CurveSlopes slopes;
    for (int i = 0; i < 3; ++i) {
        const double v = leaf[6 + 3 * i], x = leaf[7 + 3 * i];
        const AxisAt at = axis_at(leaf, v);
        const AxisFrame frame = axis_frame(at);
        const Along along = along_at(v), along_slope = along_slope_at(v);
        const bool upright = !(frame.speed > kNoDirection);
        const auto turned = [&](double dx, double dy, double* normal) {
            normal[0] = normal[1] = 0;
            if (!upright) turn_normal(frame, dx, dy, normal);
        };
        for (int c = 0; c < 3; ++c) slopes.foot_v[i][c] = at.slope[c];
        double by_x[2], by_y[2], by_v[2];
        turned(1, 0, by_x);
        turned(0, 1, by_y);
        turned(at.bend[0], at.bend[1], by_v);
        for (int c = 0; c < 2; ++c) {
            slopes.step_v[i][c] = x * by_v[c];
            slopes.step_x[i][c] = frame.normal[c];
        }
        for (int k = 0; k < 2; ++k) {
            slopes.foot_axis[i][k] = along.axis[k];
            for (int c = 0; c < 2; ++c) {
                slopes.step_axis[i][k][2 * c] = x * along_slope.axis[k] * by_x[c];
                slopes.step_axis[i][k][2 * c + 1] = x * along_slope.axis[k] * by_y[c];
            }
        }
    }
    return slopes;
}

template <typename Real>
void write_jacobian(const CurveSlopes& slopes, const Along& along, const Across& across, Real* jacobian) {
    constexpr std::size_t kRow = kLeafNumbers;
    std::fill(jacobian, jacobian + 3 * kRow, Real(0));
    const auto put = [jacobian](std::size_t coordinate, std::size_t number, double value) {
        jacobian[kRow * coordinate + number] = static_cast<Real>(value);
    };
    const double foot = across.foot - across.axis;  // what Q counts for: L = b_0 A + (1 - b_0) Q + ...
    for (std::size_t k = 0; k < 2; ++k) {
        double own = across.axis * along.axis[k], turned[4] = {0, 0, 0, 0};
        for (std::size_t i = 0; i < 3; ++i) {
            own += foot * along.quartic[i] * slopes.foot_axis[i][k];
            for (int m = 0; m < 4; ++m) turned[m] += across.step * along.quartic[i] * slopes.step_axis[i][k][m];
        }
        put(0, 3 * k, own + turned[0]);
        put(0, 3 * k + 1, turned[1]);
        put(1, 3 * k, turned[2]);
        put(1, 3 * k + 1, own + turned[3]);
        put(2, 3 * k + 2, own);
    }
    for (std::size_t i = 0; i < 3; ++i) {
        const double weight = along.quartic[i];
        for (std::size_t c = 0; c < 2; ++c) {
            put(c, 6 + 3 * i, weight * (foot * slopes.foot_v[i][c] + across.step * slopes.step_v[i][c]));
            put(c, 7 + 3 * i, weight * across.step * slopes.step_x[i][c]);
        }
        put(2, 6 + 3 * i, weight * foot * slopes.foot_v[i][2]);
        put(2, 8 + 3 * i, weight * across.height[2]);
        put(2, 15 + i, weight * across.height[0]);
        put(2, 18 + i, weight * across.height[1]);
    }
}

template <typename Real>
void leaf_jacobians(const double* leaves, std::size_t n, const double* uv, std::size_t p, bool shared_uv, Real* points,
                    Real* jacobians, int threads) {
    if (p == 0) return;
    const std::size_t block = std::max<std::size_t>(1, kBlockSamples / p);
    parallel_for((n + block - 1) / block, threads, [&](std::size_t b) {
        for (std::size_t i = b * block; i < std::min(n, (b + 1) * block); ++i) {
            const double* leaf = leaves + kLeafNumbers * i;
            const LeafCurves curves = leaf_curves(leaf);
            const CurveSlopes slopes = curve_slopes(leaf);
            const double* place = shared_uv ? uv : uv + 2 * p * i;
            for (std::size_t k = 0; k < p; ++k, place += 2) {
                const Along along = along_at(place[1]);
                const Across across = across_at(place[0]);
                if (points != nullptr) {
                    double point[3];
                    leaf_point(leaf_row(curves, along), across, point);
                    for (int c = 0; c < 3; ++c) points[3 * (p * i + k) + c] = static_cast<Real>(point[c]);
                }
                write_jacobian(slopes, along, across, jacobians + 3 * kLeafNumbers * (p * i + k));
            }
        }
    });
}

template void write_jacobian<double>(const CurveSlopes&, const Along&, const Across&, double*);

template void leaf_jacobians<float>(const double*, std::size_t, const double*, std::size_t, bool, float*, float*, int);
template void leaf_jacobians<double>(const double*, std::size_t, const double*, std::size_t, bool, double*, double*, int);

}  // namespace usdfoliage
