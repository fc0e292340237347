#include "leaf/curves.h"

#include "parallel.h"

namespace usdfoliage {
namespace {

constexpr std::size_t kBlock = 256;  // leaves a thread takes at once

template <typename Fn>
void for_each_leaf(std::size_t n, int threads, const Fn& fn) {
    parallel_for((n + kBlock - 1) / kBlock, threads, [&](std::size_t block) {
        for (std::size_t i = block * kBlock; i < std::min(n, (block + 1) * kBlock); ++i) fn(i);
    });
}

}  // namespace

void leaf_net(const double* leaf, double* net) {
    const LeafCurves curves = leaf_curves(leaf);
    const auto at = [net](int row, int column) { return net + 3 * (7 * row + column); };
    for (int column = 0; column < 7; ++column) {
        const int part = std::abs(column - 3);
        const double share = (column - 3) / 3.0;
        for (int c = 0; c < 3; ++c) {
            at(0, column)[c] = 0;
            at(4, column)[c] = c == 1 ? 1 : 0;
        }
        for (int i = 0; i < 3 && part > 0; ++i) {
            for (int c = 0; c < 2; ++c) at(1 + i, column)[c] = curves.foot[i][c] + share * curves.step[i][c];
            at(1 + i, column)[2] = curves.foot[i][2] + curves.height[part - 1][i];
        }
    }
    for (int c = 0; c < 3; ++c) {  // the axis, raised to degree four
        at(1, 3)[c] = 0.75 * curves.axis[0][c];
        at(2, 3)[c] = 0.5 * (curves.axis[0][c] + curves.axis[1][c]);
        at(3, 3)[c] = 0.75 * curves.axis[1][c] + (c == 1 ? 0.25 : 0.0);
    }
}

void leaf_nets(const double* leaves, std::size_t n, double* nets, int threads) {
    for_each_leaf(n, threads, [&](std::size_t i) { leaf_net(leaves + kLeafNumbers * i, nets + 105 * i); });
}

void leaf_axes(const double* leaves, std::size_t n, const double* v, std::size_t p, bool shared_v, double* points,
               double* normals, int threads) {
    for_each_leaf(n, threads, [&](std::size_t i) {
        const double* at_v = shared_v ? v : v + p * i;
        for (std::size_t k = 0; k < p; ++k) {
            const AxisAt at = axis_at(leaves + kLeafNumbers * i, at_v[k]);
            if (points != nullptr) std::copy(at.point, at.point + 3, points + 3 * (p * i + k));
            if (normals != nullptr) {
                const AxisFrame frame = axis_frame(at);
                double* normal = normals + 3 * (p * i + k);
                normal[0] = frame.normal[0];
                normal[1] = frame.normal[1];
                normal[2] = 0;
            }
        }
    });
}

}  // namespace usdfoliage
