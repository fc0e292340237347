#include "local_planes.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numeric>

#include "parallel.h"

namespace usdfoliage {

namespace {

constexpr std::size_t kChunk = 1024;     // pixels a thread takes at once
constexpr double kLeastSupport = 4;      // neighbours that a plane needs
constexpr double kReach = 0.75;          // of the first tolerance: a surface this part of the steepest slope off counts
constexpr double kNoises = 3;            // standard deviations that count as near
constexpr double kSlopePrior = 1e-3;     // holds the slope of neighbours in a line

struct Neighbour {
    int right;
    int down;
    std::ptrdiff_t step;   // to its index
    float distance_px;
};

std::vector<Neighbour> disc(int radius, int width) {
    std::vector<Neighbour> result;
    for (int down = -radius; down <= radius; ++down) {
        for (int right = -radius; right <= radius; ++right) {
            const int square = right * right + down * down;
            if (square > radius * radius + 1) continue;
            result.push_back({right, down, static_cast<std::ptrdiff_t>(down) * width + right,
                              std::sqrt(static_cast<float>(square))});
        }
    }
    return result;
}

struct Plane {
    float right;
    float down;
    float value;
    float support;
};

// Weighted sums of a fit; inverse depth is counted from the pixel's own, which keeps digits.
struct Sums {
    double w = 0, x = 0, y = 0, xx = kSlopePrior, xy = 0, yy = kSlopePrior, q = 0, qx = 0, qy = 0;

    void add(double weight, int dx, int dy, double dq) {
        const double wx = weight * dx, wy = weight * dy;
        w += weight;
        x += wx;
        y += wy;
        xx += wx * dx;
        xy += wx * dy;
        yy += wy * dy;
        q += weight * dq;
        qx += wx * dq;
        qy += wy * dq;
    }

    Plane solve(double own) const {
        Plane plane{0, 0, static_cast<float>(own), static_cast<float>(w)};
        if (w < kLeastSupport) return plane;
        const double m00 = xx - x * x / w, m01 = xy - x * y / w, m11 = yy - y * y / w;
        const double r0 = qx - x * q / w, r1 = qy - y * q / w, determinant = m00 * m11 - m01 * m01;
        if (!(determinant > 1e-6 * w * w)) return plane;
        const double a = (m11 * r0 - m01 * r1) / determinant, b = (m00 * r1 - m01 * r0) / determinant;
        plane.right = static_cast<float>(a);
        plane.down = static_cast<float>(b);
        plane.value = static_cast<float>(own + (q - a * x - b * y) / w);
        return plane;
    }
};

Plane fit_plane(const DepthView& view, std::ptrdiff_t pixel, const std::vector<Neighbour>& window, int radius,
                float steepest, float noise, float footprint_at_one) {
    const float depth = view.depth_m[pixel];
    if (!(depth > 0)) return {0, 0, 0, 0};
    const int row = static_cast<int>(pixel / view.width), column = static_cast<int>(pixel % view.width);
    const bool inside = row >= radius && row < view.height - radius && column >= radius && column < view.width - radius;
    const float footprint = depth * footprint_at_one;
    const float own = 1 / depth;
    Plane plane{0, 0, own, 0};
    for (int pass = 0; pass < 2; ++pass) {
        Sums sums;
        for (const Neighbour& next : window) {
            if (!inside) {
                const int r = row + next.down, c = column + next.right;
                if (r < 0 || r >= view.height || c < 0 || c >= view.width) continue;
            }
            const float other = view.depth_m[pixel + next.step];
            if (!(other > 0)) continue;
            float away, tolerance;
            if (pass == 0) {
                away = std::fabs(other - depth);
                tolerance = (steepest * next.distance_px * static_cast<float>(kReach) + 1) * footprint + noise;
            } else {
                const float predicted = plane.value + plane.right * static_cast<float>(next.right) + plane.down * static_cast<float>(next.down);
                away = std::fabs(other * predicted - 1) * other;  // of depth, to first order
                tolerance = 0.5f * steepest * footprint + noise;
            }
            if (!(away < tolerance)) continue;
            const float square = tolerance * tolerance;
            sums.add(square / (square + 4 * away * away), next.right, next.down, 1 / static_cast<double>(other) - own);
        }
        plane = sums.solve(own);
    }
    return plane;
}

// The lowest index of a piece stands for it.
std::int32_t root_of(std::vector<std::int32_t>& parent, std::int32_t i) {
    while (parent[i] != i) {
        parent[i] = parent[parent[i]];
        i = parent[i];
    }
    return i;
}

void join(std::vector<std::int32_t>& parent, std::int32_t i, std::int32_t j) {
    const std::int32_t a = root_of(parent, i), b = root_of(parent, j);
    if (a < b) parent[b] = a;
    if (b < a) parent[a] = b;
}

std::array<double, 3> point_of(const DepthView& view, std::size_t pixel) {
    const double z = view.depth_m[pixel];
    const double column = static_cast<double>(pixel % static_cast<std::size_t>(view.width)) + 0.5;
    const double row = static_cast<double>(pixel / static_cast<std::size_t>(view.width)) + 0.5;
    return {(column - view.center[0]) / view.focal[0] * z, (row - view.center[1]) / view.focal[1] * z, z};
}

}  // namespace

void fit_local_planes(const DepthView& view, const std::int64_t* pixels, std::size_t n, const PlaneOptions& options,
                      float* planes, float* support) {
    const std::vector<Neighbour> window = disc(options.radius, view.width);
    const float steepest = static_cast<float>(options.footprints), noise = static_cast<float>(kNoises * options.noise_m);
    const float footprint_at_one = static_cast<float>(1 / view.focal_mean());
    parallel_for((n + kChunk - 1) / kChunk, options.threads, [&](std::size_t chunk) {
        for (std::size_t i = chunk * kChunk; i < std::min(n, (chunk + 1) * kChunk); ++i) {
            const std::ptrdiff_t pixel = pixels ? static_cast<std::ptrdiff_t>(pixels[i]) : static_cast<std::ptrdiff_t>(i);
            const Plane plane = fit_plane(view, pixel, window, options.radius, steepest, noise, footprint_at_one);
            planes[3 * i] = plane.right;
            planes[3 * i + 1] = plane.down;
            planes[3 * i + 2] = plane.value;
            support[i] = plane.support;
        }
    });
}

void measure_gaps(const DepthView& view, const float* planes, int threads, float* right, float* down) {
    const float focal = static_cast<float>(view.focal_mean());
    const std::size_t width = static_cast<std::size_t>(view.width), height = static_cast<std::size_t>(view.height);
    const auto gap = [&](std::size_t i, std::size_t j, int slope) {
        if (!(view.depth_m[i] > 0 && view.depth_m[j] > 0)) return kNoSurface;
        const float *here = planes + 3 * i, *there = planes + 3 * j;
        const float at_there = std::fabs(here[2] + here[slope] - there[2]), at_here = std::fabs(there[2] - there[slope] - here[2]);
        // a step dq of inverse depth is one of depth² dq, and a footprint is depth / focal
        return std::max(at_there, at_here) * std::sqrt(view.depth_m[i] * view.depth_m[j]) * focal;
    };
    parallel_for(height, threads, [&](std::size_t row) {
        for (std::size_t column = 0; column < width; ++column) {
            const std::size_t i = row * width + column;
            right[i] = column + 1 < width ? gap(i, i + 1, 0) : kNoSurface;
            down[i] = row + 1 < height ? gap(i, i + width, 1) : kNoSurface;
        }
    });
}

std::int32_t join_pixels(const DepthView& view, const float* right, const float* down, const std::uint8_t* valid,
                         double limit, double noise_m, std::size_t least, std::int32_t* labels) {
    const std::size_t n = view.pixels(), width = static_cast<std::size_t>(view.width);
    std::vector<std::int32_t> parent(n);
    std::iota(parent.begin(), parent.end(), 0);
    const float noise = static_cast<float>(noise_m * view.focal_mean()), most = static_cast<float>(limit);
    const auto belongs = [&](std::size_t i) { return valid[i] && view.depth_m[i] > 0; };
    for (std::size_t i = 0; i < n; ++i) {
        if (!belongs(i)) continue;
        const float allowed = most + noise / view.depth_m[i];
        // the last column's gap to the right is no surface, and so is the last row's below
        if (right[i] < allowed && belongs(i + 1)) join(parent, static_cast<std::int32_t>(i), static_cast<std::int32_t>(i + 1));
        if (down[i] < allowed && belongs(i + width)) join(parent, static_cast<std::int32_t>(i), static_cast<std::int32_t>(i + width));
    }
    std::vector<std::int32_t> size(n, 0);
    for (std::size_t i = 0; i < n; ++i) {
        if (belongs(i)) ++size[root_of(parent, static_cast<std::int32_t>(i))];
    }
    std::int32_t count = 0;
    for (std::size_t i = 0; i < n; ++i) {
        labels[i] = 0;
        if (!belongs(i)) continue;
        const std::size_t root = static_cast<std::size_t>(root_of(parent, static_cast<std::int32_t>(i)));
        if (static_cast<std::size_t>(size[root]) < least) continue;
        labels[i] = root == i ? ++count : labels[root];  // the root is the first of its pixels
    }
    return count;
}

void classify_edges(const DepthView& view, const std::int32_t* labels, double footprints, double noise_m, int threads,
                    std::uint8_t* kinds) {
    const int width = view.width, height = view.height;
    const float slope = static_cast<float>(footprints / view.focal_mean()), noise = static_cast<float>(noise_m);
    parallel_for(static_cast<std::size_t>(height), threads, [&](std::size_t index) {
        const int row = static_cast<int>(index);
        for (int column = 0; column < width; ++column) {
            const std::ptrdiff_t i = static_cast<std::ptrdiff_t>(row) * width + column;
            kinds[i] = kInterior;
            if (labels[i] <= 0) continue;
            const float depth = view.depth_m[i], tolerance = slope * depth + noise;
            bool is_free = false, hidden = false, unknown = false;
            const auto look = [&](bool inside, std::ptrdiff_t j) {
                if (!inside) {
                    hidden = true;
                } else if (labels[j] != labels[i]) {
                    const float other = view.depth_m[j];
                    unknown |= !(other > 0);
                    is_free |= other > depth + tolerance;
                    hidden |= other > 0 && other < depth - tolerance;
                }
            };
            look(column > 0, i - 1);
            look(column + 1 < width, i + 1);
            look(row > 0, i - width);
            look(row + 1 < height, i + width);
            if (hidden) {
                kinds[i] = kHiddenEdge;
            } else if (is_free) {
                kinds[i] = kFreeEdge;
            } else if (unknown) {
                kinds[i] = kUnknownEdge;
            }
        }
    });
}

std::vector<double> sum_points(const DepthView& view, const std::int32_t* labels, std::size_t count,
                               std::vector<double>& first_m) {
    std::vector<double> sums(count * 10, 0.0);
    first_m.assign(count * 3, 0.0);
    for (std::size_t i = 0; i < view.pixels(); ++i) {
        if (labels[i] <= 0) continue;
        const std::size_t label = static_cast<std::size_t>(labels[i] - 1);
        double *s = &sums[label * 10], *first = &first_m[label * 3];
        const std::array<double, 3> point = point_of(view, i);
        if (s[0] == 0) std::copy(point.begin(), point.end(), first);
        const double x = point[0] - first[0], y = point[1] - first[1], z = point[2] - first[2];
        s[0] += 1;
        s[1] += x;
        s[2] += y;
        s[3] += z;
        s[4] += x * x;
        s[5] += x * y;
        s[6] += x * z;
        s[7] += y * y;
        s[8] += y * z;
        s[9] += z * z;
    }
    return sums;
}

std::vector<double> measure_extents(const DepthView& view, const std::int32_t* labels, std::size_t count,
                                    const double* axes, double least_cosine) {
    constexpr double inf = std::numeric_limits<double>::infinity();
    std::vector<double> low(count * 2, inf), high(count * 2, -inf), result(count * 3, 0.0);
    const double focal_square = view.focal[0] * view.focal[1];
    for (std::size_t i = 0; i < view.pixels(); ++i) {
        if (labels[i] <= 0) continue;
        const std::size_t label = static_cast<std::size_t>(labels[i] - 1);
        const std::array<double, 3> p = point_of(view, i);
        const double* axis = axes + 9 * label;
        for (std::size_t k = 0; k < 2; ++k) {
            const double along = axis[3 * k] * p[0] + axis[3 * k + 1] * p[1] + axis[3 * k + 2] * p[2];
            low[2 * label + k] = std::min(low[2 * label + k], along);
            high[2 * label + k] = std::max(high[2 * label + k], along);
        }
        // the ray to where z is 1 crosses an area of depth² / focal² / |normal · ray|
        const double slant = std::fabs(axis[6] * p[0] + axis[7] * p[1] + axis[8] * p[2]) / p[2];
        result[3 * label + 2] += p[2] * p[2] / focal_square / std::max(slant, least_cosine);
    }
    for (std::size_t label = 0; label < count; ++label) {
        for (std::size_t k = 0; k < 2; ++k) {
            if (high[2 * label + k] >= low[2 * label + k]) result[3 * label + k] = high[2 * label + k] - low[2 * label + k];
        }
    }
    return result;
}

}  // namespace usdfoliage
