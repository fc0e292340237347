#include "leaf/fit.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <vector>

#include "leaf/curves.h"
#include "leaf/jacobian.h"
#include "leaf/scanlines.h"
#include "leaf/step.h"
#include "parallel.h"

namespace usdfoliage {
namespace {

constexpr double kDeviation = 1.482602218505602;  // standard deviations a median absolute deviation of normal noise counts
constexpr double kTukey = 4.685, kHuber = 1.345;  // 95 % as good as least squares where there are no outliers
constexpr double kExact = 1e-5;                   // leaf lengths; what is closer to the surface is no outlier
constexpr int kWeightTurns = 4;                   // then the weights stay, or they and the mapping may chase each other
constexpr std::size_t kMinLines = 8;
constexpr int kNearestSteps = 6;

// Weights of the points by their height over the surface; what moves in the leaf's plane is the UV mapping's.
void weigh_robustly(Robustness robustness, const std::vector<double>& heights, const std::vector<unsigned char>& counts,
                    std::vector<double>* weights) {
    std::vector<double> sorted;
    sorted.reserve(heights.size());
    for (std::size_t i = 0; i < heights.size(); ++i)
        if (counts[i]) sorted.push_back(std::abs(heights[i]));
    if (sorted.empty()) return;
    const auto middle = sorted.begin() + static_cast<std::ptrdiff_t>(sorted.size() / 2);
    std::nth_element(sorted.begin(), middle, sorted.end());
    const double deviation = std::max(kDeviation * *middle, kExact);
    for (std::size_t i = 0; i < heights.size(); ++i) {
        const double far = std::abs(heights[i]) / deviation;
        double& weight = (*weights)[i];
        if (!counts[i] || robustness == Robustness::kNone) continue;
        if (robustness == Robustness::kHuber) {
            weight = far > kHuber ? kHuber / far : 1.0;
        } else {
            const double share = far / kTukey;
            weight = share < 1 ? (1 - share * share) * (1 - share * share) : 0.0;
        }
    }
}

// Square of the distance from a point to the surface, from (u, v) on it: Gauss and Newton's steps over the patch.
double nearest_square(const LeafCurves& curves, const double* point, double u, double v) {
    double best = -1;
    for (int step = 0; step <= kNearestSteps; ++step) {
        const LeafRow row = leaf_row(curves, along_at(v)), row_slope = leaf_row(curves, along_slope_at(v));
        double at[3], by_u[3], by_v[3];
        leaf_point(row, across_at(u), at);
        leaf_point(row, across_slope_at(u), by_u);
        leaf_point(row_slope, across_at(u), by_v);
        double uu = 0, uv = 0, vv = 0, gu = 0, gv = 0, square = 0;
        for (int c = 0; c < 3; ++c) {
            const double away = point[c] - at[c];
            square += away * away;
            uu += by_u[c] * by_u[c];
            uv += by_u[c] * by_v[c];
            vv += by_v[c] * by_v[c];
            gu += by_u[c] * away;
            gv += by_v[c] * away;
        }
        const bool better = best < 0 || square < best;
        if (better && best >= 0 && best - square <= 1e-6 * best) return square;
        if (!better) return best;
        best = square;
        const double ridge = 1e-9 * (uu + vv), determinant = (uu + ridge) * (vv + ridge) - uv * uv;
        if (!(determinant > 0)) return best;
        double du = ((vv + ridge) * gu - uv * gv) / determinant, dv = ((uu + ridge) * gv - uv * gu) / determinant;
        // At the rim only what moves along it counts.
        const bool at_u = (u >= 1 && du > 0) || (u <= -1 && du < 0), at_v = (v >= 1 && dv > 0) || (v <= 0 && dv < 0);
        if (at_u) dv = vv > 0 ? gv / (vv + ridge) : 0.0;
        if (at_v) du = uu > 0 ? gu / (uu + ridge) : 0.0;
        u = std::clamp(u + du, -1.0, 1.0);
        v = std::clamp(v + dv, 0.0, 1.0);
    }
    return best;
}

// Share of the leaf's width, over all scanlines, that points reach.
double coverage(const double* leaf, const LeafCurves& curves, const std::vector<Scanline>& scanlines) {
    double seen = 0, all = 0;
    for (const Scanline& scanline : scanlines) {
        const double width = std::max(half_width_at(leaf, curves, scanline.v), 0.0);
        all += 2 * width;
        for (const double reach : scanline.reach) seen += std::min(reach, width);
    }
    return all > 0 ? seen / all : 0.0;
}

struct Alternation {
    double leaf[kLeafNumbers];
    int iterations;
    double coverage, mean_square;  // of the distances, in leaf lengths
};

Alternation alternate(const std::vector<double>& points, const std::vector<unsigned char>& kept, const LeafEllipse& ellipse,
                      const LeafFitSettings& settings) {
    const std::size_t n = kept.size();
    const auto used = static_cast<std::size_t>(std::count(kept.begin(), kept.end(), 1));
    Alternation state{};
    double start[kLeafNumbers];
    ellipse_leaf(ellipse.half_width, start);
    std::copy(start, start + kLeafNumbers, state.leaf);
    std::vector<Mapped> mapped(n);
    for (std::size_t i = 0; i < n; ++i) mapped[i] = {0, std::clamp(points[3 * i + 1], 0.0, 1.0), -1};
    std::vector<double> weights(kept.begin(), kept.end()), heights(n, 0.0);
    std::vector<unsigned char> counts(n);
    std::vector<Scanline> scanlines(scanline_count(used, settings.scanlines));
    std::vector<LineMoments> moments(scanlines.size());
    while (state.iterations < settings.max_iterations) {
        ++state.iterations;
        map_points(state.leaf, ellipse, points.data(), kept, &mapped, &scanlines);
        const LeafCurves before = leaf_curves(state.leaf);
        for (std::size_t j = 0; j < scanlines.size(); ++j) moments[j] = empty_moments(scanlines[j].v);
        for (std::size_t i = 0; i < n; ++i) {
            const Mapped& place = mapped[i];
            counts[i] = kept[i] != 0 && place.line >= 0;
            if (!counts[i] || weights[i] == 0) continue;
            LineMoments& line = moments[static_cast<std::size_t>(place.line)];
            // Moved along its curve of equal u to the scanline, by the leaf as it is, so that the width of a strip brings
            // no error.
            const Across across = across_at(place.u);
            double here[3], there[3], target[3];
            leaf_point(leaf_row(before, along_at(place.v)), across, here);
            leaf_point(leaf_row(before, line.along), across, there);
            for (int c = 0; c < 3; ++c) target[c] = points[3 * i + c] + there[c] - here[c];
            add_point(weights[i] * scanlines[static_cast<std::size_t>(place.line)].weight[place.u < 0], across, target, &line);
        }
        double previous[kLeafNumbers];
        std::copy(state.leaf, state.leaf + kLeafNumbers, previous);
        minimise(moments, start, settings.prior, ellipse.half_width, state.leaf);
        const double change = mean_change(moments, previous, state.leaf);
        if (settings.robustness != Robustness::kNone && state.iterations <= kWeightTurns) {
            const LeafCurves now = leaf_curves(state.leaf);
            for (std::size_t i = 0; i < n; ++i) {
                if (!counts[i]) continue;
                double at[3];
                leaf_point(leaf_row(now, along_at(mapped[i].v)), across_at(mapped[i].u), at);
                heights[i] = points[3 * i + 2] - at[2];
            }
            weigh_robustly(settings.robustness, heights, counts, &weights);
        }
        if (change <= settings.tolerance) break;
    }
    const LeafCurves curves = leaf_curves(state.leaf);
    state.coverage = coverage(state.leaf, curves, scanlines);
    for (std::size_t i = 0; i < n; ++i) {
        const double v = std::clamp(mapped[i].v, 0.0, 1.0);
        state.mean_square += nearest_square(curves, points.data() + 3 * i, mapped[i].u, v) / static_cast<double>(n);
    }
    return state;
}

}  // namespace

std::size_t scanline_count(std::size_t points, std::size_t max_lines) {
    const auto wanted = static_cast<std::size_t>(0.8 * std::sqrt(static_cast<double>(points)));
    return std::min(std::max(wanted, std::min(kMinLines, max_lines)), max_lines);
}

void ellipse_leaf(double half_width, double* leaf) {
    // Least squares of 2 sqrt(v (1 - v)) by a quartic that vanishes at both ends and is its own mirror.
    constexpr double kNear = 1.93281579, kMiddle = 0.0;
    std::fill(leaf, leaf + kLeafNumbers, 0.0);
    leaf[1] = 1.0 / 3;
    leaf[4] = 2.0 / 3;
    for (int i = 0; i < 3; ++i) {
        leaf[6 + 3 * i] = 0.25 * (i + 1);
        leaf[7 + 3 * i] = half_width * (i == 1 ? kMiddle : kNear);
    }
}

void fit_leaves(const double* points, const double* normals, const long long* offsets, std::size_t leaves,
                const LeafFitSettings& settings, const LeafFits& fits, int threads) {
    const LeafFrameSettings frame_settings{settings.min_points, settings.robustness != Robustness::kNone, settings.isolation};
    parallel_for(leaves, threads, [&](std::size_t i) {
        const auto begin = static_cast<std::size_t>(offsets[i]), n = static_cast<std::size_t>(offsets[i + 1]) - begin;
        LeafFrame frame;
        std::vector<unsigned char> kept;
        fits.outcomes[i] = leaf_frame(points + 3 * begin, normals + 3 * begin, n, frame_settings, &frame, &kept);
        if (fits.outcomes[i] != kFitted) return;
        std::vector<double> local(3 * n);
        for (std::size_t k = 0; k < n; ++k) {
            const double* point = points + 3 * (begin + k);
            for (int a = 0; a < 3; ++a) {
                double sum = 0;
                for (int c = 0; c < 3; ++c) sum += frame.axes[a][c] * (point[c] - frame.base[c]);
                local[3 * k + a] = sum / frame.length;
            }
        }
        const Alternation fit = alternate(local, kept, {frame.half_width, frame.half_length}, settings);
        std::copy(fit.leaf, fit.leaf + kLeafNumbers, fits.parameters + kLeafNumbers * i);
        ellipse_leaf(frame.half_width, fits.ellipses + kLeafNumbers * i);
        std::copy(frame.base, frame.base + 3, fits.bases + 3 * i);
        for (int a = 0; a < 3; ++a) std::copy(frame.axes[a], frame.axes[a] + 3, fits.axes + 9 * i + 3 * a);
        fits.lengths[i] = frame.length;
        fits.residuals[i] = frame.length * std::sqrt(fit.mean_square);
        fits.coverages[i] = fit.coverage;
        fits.iterations[i] = fit.iterations;
    });
}

}  // namespace usdfoliage
