#include "leaf/bounds.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <vector>

#include "leaf/curves.h"
#include "parallel.h"

namespace usdfoliage {
namespace {

constexpr std::size_t kBlock = 256;  // leaves a thread takes at once
constexpr int kAlong = 32;           // cells from base to apex, a power of two
constexpr int kAcross = 16;          // cells from the axis to a silhouette
constexpr int kRows = 5, kColumns = 7, kMiddle = 3;

// Bernstein polynomials at the samples, and an order of the rows in which they soon cover the leaf.
struct Weights {
    double along[kAlong + 1][kRows], across[kAcross + 1][4];
    std::vector<int> order;
    Weights() {
        for (int r = 0; r <= kAlong; ++r) {
            const double v = static_cast<double>(r) / kAlong, w = 1 - v;
            const double at[kRows] = {w * w * w * w, 4 * w * w * w * v, 6 * w * w * v * v, 4 * w * v * v * v, v * v * v * v};
            std::copy(at, at + kRows, along[r]);
        }
        for (int s = 0; s <= kAcross; ++s) {
            const double a = static_cast<double>(s) / kAcross, b = 1 - a;
            const double at[4] = {b * b * b, 3 * b * b * a, 3 * b * a * a, a * a * a};
            std::copy(at, at + 4, across[s]);
        }
        order = {0, kAlong};
        for (int step = kAlong; step > 1; step /= 2) {
            for (int r = step / 2; r < kAlong; r += step) order.push_back(r);
        }
    }
};

// How far jitter reaches in x and in y, at most, in every cell from base to apex.
struct Reach {
    double cell[kAlong][2];
};

// The normal's parts are bounded over a cell by a box around the axis' tangent: a parabola, whose box is that of its ends
// and of what it rises above its chord.
Reach jitter_reach(const double* leaf, double reach) {
    const double step = 1.0 / kAlong;
    double rise[2];
    for (int c = 0; c < 2; ++c) rise[c] = step * step / 8 * 6 * std::abs((c == 1 ? 1.0 : 0.0) - 3 * leaf[3 + c] + 3 * leaf[c]);
    Reach bounded;
    AxisAt from = axis_at(leaf, 0);
    for (int r = 0; r < kAlong; ++r) {
        const AxisAt to = axis_at(leaf, (r + 1) * step);
        double smallest[2], largest[2];  // of the sizes of the tangent's parts
        for (int c = 0; c < 2; ++c) {
            const double low = std::min(from.slope[c], to.slope[c]) - rise[c], high = std::max(from.slope[c], to.slope[c]) + rise[c];
            smallest[c] = std::max({low, -high, 0.0});
            largest[c] = std::max(-low, high);
        }
        const double middle = 2 * std::clamp(0.5, r * step, (r + 1) * step) - 1, squared = middle * middle;
        const double faded = reach * (1 - squared * squared * squared * squared);
        for (int c = 0; c < 2; ++c) {  // the normal is (t_y, -t_x)
            const double far = largest[1 - c], near = smallest[c], size = std::sqrt(far * far + near * near);
            bounded.cell[r][c] = size > 0 ? faded * far / size : 0;
        }
        from = to;
    }
    return bounded;
}

using Net = std::array<std::array<double, kColumns>, kRows>;

// How far a curve may lie outside the values at its samples, at most: f - f_linear <= h^2 / 8 max(-f''), f_linear - f
// likewise. Of a Bezier curve f'' is the second differences of its control points times degree (degree - 1).
struct Margins {
    double below = 0, above = 0;
    void add(double second_difference, double scale) {
        below = std::max(below, scale * second_difference);
        above = std::max(above, -scale * second_difference);
    }
};

constexpr double kBendAlong = 4.0 * 3 / 8 / (kAlong * kAlong), kBendAcross = 3.0 * 2 / 8 / (kAcross * kAcross);

// The second differences of a net along v: parabolas over which those of the surface are spread.
struct BendAlong {
    double bend[3][kColumns], rise = 0;  // how far a parabola rises over a cell above its ends
    Margins all;                         // what holds anywhere

    explicit BendAlong(const Net& net) {
        for (int c = 0; c < kColumns; ++c) {
            for (int k = 0; k < 3; ++k) {
                bend[k][c] = net[k][c] - 2 * net[k + 1][c] + net[k + 2][c];
                all.add(bend[k][c], kBendAlong);
            }
            rise = std::max(rise, std::abs(bend[0][c] - 2 * bend[1][c] + bend[2][c]) / (4 * kAlong * kAlong));
        }
    }

    // What holds in the cells on both sides of a row.
    Margins around(int row) const {
        Margins margins;
        for (int r = std::max(row - 1, 0); r <= std::min(row + 1, kAlong); ++r) {
            const double v = static_cast<double>(r) / kAlong, w = 1 - v;
            for (int c = 0; c < kColumns; ++c) {
                const double at = w * w * bend[0][c] + 2 * w * v * bend[1][c] + v * v * bend[2][c];
                margins.add(at + rise, kBendAlong);
                margins.add(at - rise, kBendAlong);
            }
        }
        return margins;
    }
};

// Widen a range to hold one component. `reach`: how far jitter moves the silhouettes in it, a cell; null for none.
//
// With P_u, P_v linear interpolation between the samples, f = P_v P_u f + P_v (f - P_u f) + (f - P_v f), of which the
// second term asks for the curves across at the sampled rows alone.
void component_bounds(const Net& net, const double* reach, double* low, double* high) {
    static const Weights weights;
    double hull_low = net[0][0], hull_high = net[0][0];
    for (const auto& row : net) {
        for (const double value : row) hull_low = std::min(hull_low, value), hull_high = std::max(hull_high, value);
    }
    double max_reach = 0;
    for (int r = 0; r < kAlong && reach != nullptr; ++r) max_reach = std::max(max_reach, reach[r]);
    hull_low -= max_reach;
    hull_high += max_reach;
    if (hull_low >= *low && hull_high <= *high) return;
    const BendAlong along(net);
    double sample_low = *low, sample_high = *high;
    for (const int r : weights.order) {
        double column[kColumns];
        for (int c = 0; c < kColumns; ++c) {
            column[c] = 0;
            for (int k = 0; k < kRows; ++k) column[c] += weights.along[r][k] * net[k][c];
        }
        const double moved = reach == nullptr ? 0 : std::max(reach[std::max(r - 1, 0)], reach[std::min(r, kAlong - 1)]);
        Margins margins = along.all;
        for (int side = -1; side <= 1; side += 2) {
            const double axis = column[kMiddle], inner = column[kMiddle + side], outer = column[kMiddle + 2 * side],
                         silhouette = column[kMiddle + 3 * side];
            Margins across;
            across.add(axis - 2 * inner + outer, kBendAcross);
            across.add(inner - 2 * outer + silhouette, kBendAcross);
            if (std::min({axis, inner, outer, silhouette}) - moved - across.below - margins.below >= sample_low &&
                std::max({axis, inner, outer, silhouette}) + moved + across.above + margins.above <= sample_high)
                continue;  // as most rows lie within what is known
            margins = along.around(r);
            for (int s = 0; s <= kAcross; ++s) {
                const double value = weights.across[s][0] * axis + weights.across[s][1] * inner +
                                     weights.across[s][2] * outer + weights.across[s][3] * silhouette;
                const double reached = weights.across[std::min(s + 1, kAcross)][3] * moved;  // of the cell outside it
                sample_low = std::min(sample_low, value - reached - across.below - margins.below);
                sample_high = std::max(sample_high, value + reached + across.above + margins.above);
            }
        }
    }
    *low = std::min(*low, std::max(hull_low, sample_low));
    *high = std::max(*high, std::min(hull_high, sample_high));
}

void widen_bounds(const double* leaf, const double* net, const double* placement, double reach, double* bounds) {
    constexpr double kStay[12] = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0};
    const double* matrix = placement != nullptr ? placement : kStay;
    Reach jitter;
    if (reach > 0) jitter = jitter_reach(leaf, reach);
    for (int c = 0; c < 3; ++c) {
        const double *along = matrix + 4 * c, x = along[0], y = along[1];
        Net component;
        for (int k = 0; k < kRows; ++k) {
            for (int m = 0; m < kColumns; ++m) {
                const double* point = net + 3 * (kColumns * k + m);
                component[k][m] = x * point[0] + y * point[1] + along[2] * point[2] + along[3];
            }
        }
        double moved[kAlong];
        for (int r = 0; r < kAlong && reach > 0; ++r)
            moved[r] = std::min(std::abs(x) * jitter.cell[r][0] + std::abs(y) * jitter.cell[r][1], std::sqrt(x * x + y * y) * reach);
        component_bounds(component, reach > 0 ? moved : nullptr, bounds + c, bounds + 3 + c);
    }
}

}  // namespace

void leaf_bounds(const double* leaves, std::size_t n, const double* placements, double reach, std::size_t group, double* bounds,
                 int threads) {
    const std::size_t boxes = (n + group - 1) / group, block = std::max<std::size_t>(1, kBlock / group);
    parallel_for((boxes + block - 1) / block, threads, [&](std::size_t b) {
        double net[kRows * kColumns * 3];
        for (std::size_t box = b * block; box < std::min(boxes, (b + 1) * block); ++box) {
            double* own = bounds + 6 * box;
            std::fill(own, own + 3, std::numeric_limits<double>::infinity());
            std::fill(own + 3, own + 6, -std::numeric_limits<double>::infinity());
            for (std::size_t i = box * group; i < std::min(n, (box + 1) * group); ++i) {
                const double* leaf = leaves + kLeafNumbers * i;
                leaf_net(leaf, net);
                widen_bounds(leaf, net, placements != nullptr ? placements + 12 * i : nullptr, reach, own);
            }
        }
    });
}

}  // namespace usdfoliage
