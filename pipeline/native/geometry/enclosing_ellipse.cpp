#include "geometry/enclosing_ellipse.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "parallel.h"

namespace usdfoliage {
namespace {

constexpr double kFlat = 1e-9;      // points closer to a line than this share of their reach lie on it
constexpr int kMaxSteps = 100000;  // never reached by the linear convergence of steps towards and away
constexpr double kPi = 3.14159265358979323846;

// Principal axes of a symmetric 2 x 2 matrix (xx, xy, yy): the larger value first, the angle of its direction.
struct Principal {
    double value[2], angle;
};

Principal principal_axes(double xx, double xy, double yy) {
    const double mean = (xx + yy) / 2, reach = std::hypot((xx - yy) / 2, xy);
    const double larger = mean + reach;  // the smaller one as a difference would lose its digits
    return {{larger, std::max(xx * yy - xy * xy, 0.0) / larger}, 0.5 * std::atan2(2 * xy, xx - yy)};
}

double half_turn(double angle) {
    if (angle <= -kPi / 2) return angle + kPi;
    if (angle > kPi / 2) return angle - kPi;
    return angle;
}

// The middle of the points, their principal axes and reaches along those.
struct Spread {
    double middle[2], along[2], reach[2];
};

Spread spread_of(const std::vector<double>& corners) {
    const std::size_t h = corners.size() / 2;
    Spread spread{{0, 0}, {1, 0}, {0, 0}};
    for (std::size_t i = 0; i < h; ++i)
        for (int c = 0; c < 2; ++c) spread.middle[c] += corners[2 * i + c] / static_cast<double>(h);
    double xx = 0, xy = 0, yy = 0;
    for (std::size_t i = 0; i < h; ++i) {
        const double x = corners[2 * i] - spread.middle[0], y = corners[2 * i + 1] - spread.middle[1];
        xx += x * x;
        xy += x * y;
        yy += y * y;
    }
    const double angle = principal_axes(xx, xy, yy).angle;
    spread.along[0] = std::cos(angle);
    spread.along[1] = std::sin(angle);
    for (std::size_t i = 0; i < h; ++i) {
        const double x = corners[2 * i] - spread.middle[0], y = corners[2 * i + 1] - spread.middle[1];
        spread.reach[0] = std::max(spread.reach[0], std::abs(x * spread.along[0] + y * spread.along[1]));
        spread.reach[1] = std::max(spread.reach[1], std::abs(y * spread.along[0] - x * spread.along[1]));
    }
    return spread;
}

// Weights of points in general position, whose weighted covariance is the ellipse's.
std::vector<double> khachiyan_weights(const std::vector<double>& points, double tolerance) {
    const std::size_t h = points.size() / 2;
    std::vector<double> weights(h, 0.0), kappa(h);
    // Kumar and Yildirim: the farthest points along one direction, then along the one across what those span.
    double direction[2] = {1, 0};
    for (int k = 0; k < 2; ++k) {
        std::size_t low = 0, high = 0;
        const auto along = [&](std::size_t i) { return points[2 * i] * direction[0] + points[2 * i + 1] * direction[1]; };
        for (std::size_t i = 1; i < h; ++i) {
            if (along(i) < along(low)) low = i;
            if (along(i) > along(high)) high = i;
        }
        weights[low] += 0.25;
        weights[high] += 0.25;
        const double x = points[2 * high] - points[2 * low], y = points[2 * high + 1] - points[2 * low + 1];
        direction[0] = -y;
        direction[1] = x;
    }
    for (int step = 0; step < kMaxSteps; ++step) {
        double x = 0, y = 0, xx = 0, xy = 0, yy = 0;
        for (std::size_t i = 0; i < h; ++i) {
            x += weights[i] * points[2 * i];
            y += weights[i] * points[2 * i + 1];
        }
        for (std::size_t i = 0; i < h; ++i) {
            const double dx = points[2 * i] - x, dy = points[2 * i + 1] - y;
            xx += weights[i] * dx * dx;
            xy += weights[i] * dx * dy;
            yy += weights[i] * dy * dy;
        }
        const double determinant = xx * yy - xy * xy;
        std::size_t far = 0, near = h;
        for (std::size_t i = 0; i < h; ++i) {
            const double dx = points[2 * i] - x, dy = points[2 * i + 1] - y;
            kappa[i] = 1 + (yy * dx * dx - 2 * xy * dx * dy + xx * dy * dy) / determinant;
            if (kappa[i] > kappa[far]) far = i;
            if (weights[i] > 0 && (near == h || kappa[i] < kappa[near])) near = i;
        }
        const double over = kappa[far] / 3 - 1, under = 1 - kappa[near] / 3;
        if (std::max(over, under) <= tolerance) break;
        if (over >= under) {
            const double share = (kappa[far] - 3) / (3 * (kappa[far] - 1));
            for (double& weight : weights) weight *= 1 - share;
            weights[far] += share;
        } else {
            const double max_share = weights[near] < 1 ? weights[near] / (1 - weights[near]) : 0.0;
            const double best = kappa[near] > 1 ? (3 - kappa[near]) / (3 * (kappa[near] - 1)) : max_share;
            const bool leaves = best >= max_share;
            const double share = leaves ? max_share : best;
            for (double& weight : weights) weight *= 1 + share;
            weights[near] = leaves ? 0.0 : weights[near] - share;
        }
    }
    return weights;
}

}  // namespace

std::vector<double> convex_hull(const double* points, std::size_t n) {
    std::vector<std::pair<double, double>> sorted(n);
    for (std::size_t i = 0; i < n; ++i) sorted[i] = {points[2 * i], points[2 * i + 1]};
    std::sort(sorted.begin(), sorted.end());
    sorted.erase(std::unique(sorted.begin(), sorted.end()), sorted.end());
    const std::size_t m = sorted.size();
    std::vector<std::pair<double, double>> hull;
    const auto extend = [&](const std::pair<double, double>& p, std::size_t base) {
        while (hull.size() >= base + 2) {
            const auto &a = hull[hull.size() - 2], &b = hull.back();
            if ((b.first - a.first) * (p.second - a.second) - (b.second - a.second) * (p.first - a.first) > 0) break;
            hull.pop_back();
        }
        hull.push_back(p);
    };
    for (std::size_t i = 0; i < m; ++i) extend(sorted[i], 0);
    const std::size_t lower = m > 0 ? hull.size() - 1 : 0;
    for (std::size_t i = m; i-- > 1;) extend(sorted[i - 1], lower);
    if (m > 1) hull.pop_back();  // the first corner again
    std::vector<double> corners;
    corners.reserve(2 * hull.size());
    for (const auto& corner : hull) {
        corners.push_back(corner.first);
        corners.push_back(corner.second);
    }
    return corners;
}

Ellipse enclosing_ellipse(const double* points, std::size_t n, double tolerance) {
    constexpr double kNone = std::numeric_limits<double>::quiet_NaN();
    if (n == 0) return {{kNone, kNone}, {0, 0}, 0};
    const std::vector<double> corners = convex_hull(points, n);
    const std::size_t h = corners.size() / 2;
    const Spread spread = spread_of(corners);
    const double cosine = spread.along[0], sine = spread.along[1];
    // Both axes of the spread are made equally long, which the smallest ellipse does not mind but its arithmetic does.
    std::vector<double> even(corners.size());
    double low = std::numeric_limits<double>::infinity(), high = -low;
    for (std::size_t i = 0; i < h; ++i) {
        const double x = corners[2 * i] - spread.middle[0], y = corners[2 * i + 1] - spread.middle[1];
        const double along = x * cosine + y * sine;
        low = std::min(low, along);
        high = std::max(high, along);
        even[2 * i] = along / (spread.reach[0] > 0 ? spread.reach[0] : 1.0);
        even[2 * i + 1] = (y * cosine - x * sine) / (spread.reach[1] > 0 ? spread.reach[1] : 1.0);
    }
    if (h < 3 || !(spread.reach[1] > kFlat * spread.reach[0])) {
        const double at = (low + high) / 2;
        return {{spread.middle[0] + at * cosine, spread.middle[1] + at * sine},
                {(high - low) / 2, 0},
                half_turn(std::atan2(sine, cosine))};
    }
    const std::vector<double> weights = khachiyan_weights(even, tolerance);
    double x = 0, y = 0, xx = 0, xy = 0, yy = 0;
    for (std::size_t i = 0; i < h; ++i) {
        x += weights[i] * even[2 * i];
        y += weights[i] * even[2 * i + 1];
    }
    for (std::size_t i = 0; i < h; ++i) {
        const double dx = even[2 * i] - x, dy = even[2 * i + 1] - y;
        xx += weights[i] * dx * dx;
        xy += weights[i] * dx * dy;
        yy += weights[i] * dy * dy;
    }
    const double determinant = xx * yy - xy * xy;
    double farthest = 0;  // 2 but for the tolerance; so that no point stays outside
    for (std::size_t i = 0; i < h; ++i) {
        const double dx = even[2 * i] - x, dy = even[2 * i + 1] - y;
        farthest = std::max(farthest, (yy * dx * dx - 2 * xy * dx * dy + xx * dy * dy) / determinant);
    }
    const double *reach = spread.reach, across[2] = {x * reach[0], y * reach[1]};
    const Principal axes = principal_axes(xx * reach[0] * reach[0], xy * reach[0] * reach[1], yy * reach[1] * reach[1]);
    return {{spread.middle[0] + across[0] * cosine - across[1] * sine, spread.middle[1] + across[0] * sine + across[1] * cosine},
            {std::sqrt(farthest * axes.value[0]), std::sqrt(farthest * axes.value[1])},
            half_turn(half_turn(axes.angle) + half_turn(std::atan2(sine, cosine)))};
}

void enclosing_ellipses(const double* points, const long long* offsets, std::size_t sets, double tolerance, double* centers,
                        double* halves, double* angles, int threads) {
    parallel_for(sets, threads, [&](std::size_t i) {
        const std::size_t begin = static_cast<std::size_t>(offsets[i]), end = static_cast<std::size_t>(offsets[i + 1]);
        const Ellipse ellipse = enclosing_ellipse(points + 2 * begin, end - begin, tolerance);
        for (int c = 0; c < 2; ++c) {
            centers[2 * i + c] = ellipse.center[c];
            halves[2 * i + c] = ellipse.half[c];
        }
        angles[i] = ellipse.angle;
    });
}

}  // namespace usdfoliage
