#include "segmentation/local_planes.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numeric>

#include "parallel.h"

namespace usdfoliage {

namespace {

constexpr std::size_t kBlock = 128;     // pixels worked on side by side
constexpr std::size_t kChunk = 8192;    // pixels that a thread takes at once
constexpr double kOneSided = 0.5;       // of the sum of the directions to other pixels, at which a pixel has an outer side
constexpr float kMinSupport = 4;      // neighbours that a plane needs
constexpr float kReach = 0.75f;         // of the first tolerance: a surface this part of the steepest slope off counts
constexpr float kNoises = 3;            // standard deviations that count as near
constexpr float kSlopePrior = 1e-3f;    // holds the slope of neighbours in a line
constexpr float kMinSpread = 1e-6f;   // of the neighbours over the window, that determines a slope

struct Neighbour {
    float right;
    float down;
    std::ptrdiff_t step;  // to its index
    float distance_px;
};

std::vector<Neighbour> disc(int radius, std::ptrdiff_t stride) {
    std::vector<Neighbour> result;
    for (int down = -radius; down <= radius; ++down) {
        for (int right = -radius; right <= radius; ++right) {
            const int square = right * right + down * down;
            if (square > radius * radius + 1) continue;
            result.push_back({static_cast<float>(right), static_cast<float>(down), down * stride + right,
                              std::sqrt(static_cast<float>(square))});
        }
    }
    return result;
}

// Depth and its inverse with a border of none, so that no window leaves them.
struct Padded {
    std::vector<float> depth;
    std::vector<float> inverse;
    std::ptrdiff_t stride;
    int border;

    std::ptrdiff_t index(int row, int column) const { return (row + border) * stride + column + border; }
};

Padded pad(const DepthView& view, int border, int threads) {
    Padded padded{{}, {}, static_cast<std::ptrdiff_t>(view.width) + 2 * border, border};
    const std::size_t size = static_cast<std::size_t>(padded.stride) * static_cast<std::size_t>(view.height + 2 * border);
    padded.depth.assign(size, 0.0f);
    padded.inverse.assign(size, 0.0f);
    parallel_for(static_cast<std::size_t>(view.height), threads, [&](std::size_t row) {
        const float* from = view.depth_m + row * static_cast<std::size_t>(view.width);
        const std::ptrdiff_t to = padded.index(static_cast<int>(row), 0);
        for (int column = 0; column < view.width; ++column) {
            const bool known = from[column] > 0;
            padded.depth[static_cast<std::size_t>(to + column)] = known ? from[column] : 0.0f;
            padded.inverse[static_cast<std::size_t>(to + column)] = known ? 1 / from[column] : 0.0f;
        }
    });
    return padded;
}

// The fits of some pixels at once, in lanes: plain loops over arrays that the compiler turns into vector instructions.
struct Lanes {
    float depth[kBlock], own[kBlock], footprint[kBlock];
    float right[kBlock], down[kBlock], value[kBlock];  // the plane
    // weighted sums; inverse depth is counted from the pixel's own, which keeps digits
    float w[kBlock], x[kBlock], y[kBlock], xx[kBlock], xy[kBlock], yy[kBlock], q[kBlock], qx[kBlock], qy[kBlock];
    float near_depth[kBlock], near_inverse[kBlock];
};

void clear_sums(Lanes& lanes) {
    for (float* sum : {lanes.w, lanes.x, lanes.y, lanes.xy, lanes.q, lanes.qx, lanes.qy}) std::fill(sum, sum + kBlock, 0.0f);
    for (float* sum : {lanes.xx, lanes.yy}) std::fill(sum, sum + kBlock, kSlopePrior);
}

template <bool first>
void add_neighbour(Lanes& lanes, const Neighbour& next, const float* depths, const float* inverses, float steepest, float noise) {
    const float dx = next.right, dy = next.down, reach = first ? steepest * next.distance_px * kReach + 1 : 0.5f * steepest;
    for (std::size_t k = 0; k < kBlock; ++k) {
        const float other = depths[k], predicted = lanes.value[k] + lanes.right[k] * dx + lanes.down[k] * dy;
        // of depth: in the first pass exact, later to first order
        const float away = first ? std::fabs(other - lanes.depth[k]) : std::fabs(other * predicted - 1) * other;
        const float tolerance = reach * lanes.footprint[k] + noise, square = tolerance * tolerance;
        // times the condition, since a choice would be a jump
        const float weight = square / (square + 4 * away * away) * static_cast<float>((away < tolerance) & (other > 0));
        const float wx = weight * dx, wy = weight * dy, dq = inverses[k] - lanes.own[k];
        lanes.w[k] += weight;
        lanes.x[k] += wx;
        lanes.y[k] += wy;
        lanes.xx[k] += wx * dx;
        lanes.xy[k] += wx * dy;
        lanes.yy[k] += wy * dy;
        lanes.q[k] += weight * dq;
        lanes.qx[k] += wx * dq;
        lanes.qy[k] += wy * dq;
    }
}

void solve(Lanes& lanes) {
    for (std::size_t k = 0; k < kBlock; ++k) {
        const float w = lanes.w[k], some = w > 0 ? w : 1.0f, x = lanes.x[k] / some, y = lanes.y[k] / some, q = lanes.q[k] / some;
        const float m00 = lanes.xx[k] - lanes.x[k] * x, m01 = lanes.xy[k] - lanes.x[k] * y, m11 = lanes.yy[k] - lanes.y[k] * y;
        const float r0 = lanes.qx[k] - lanes.x[k] * q, r1 = lanes.qy[k] - lanes.y[k] * q, determinant = m00 * m11 - m01 * m01;
        const bool good = (w >= kMinSupport) & (determinant > kMinSpread * w * w);
        const float divisor = good ? determinant : 1.0f;
        const float a = (m11 * r0 - m01 * r1) / divisor, b = (m00 * r1 - m01 * r0) / divisor;
        lanes.right[k] = good ? a : 0.0f;
        lanes.down[k] = good ? b : 0.0f;
        lanes.value[k] = lanes.own[k] + (good ? q - a * x - b * y : 0.0f);
    }
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

void fit_local_planes(const DepthView& view, const std::int64_t* pixels, std::size_t n, const PlaneSettings& settings,
                      int threads, float* planes, float* support) {
    const Padded padded = pad(view, settings.radius_px, threads);
    const std::vector<Neighbour> window = disc(settings.radius_px, padded.stride);
    const float steepest = static_cast<float>(settings.steepest), noise = static_cast<float>(kNoises * settings.noise_m);
    const float footprint_at_one = static_cast<float>(1 / view.focal_mean());
    parallel_for((n + kBlock - 1) / kBlock, threads, [&](std::size_t block) {
        const std::size_t start = block * kBlock, used = std::min(n - start, kBlock);
        std::ptrdiff_t at[kBlock];
        bool any = false, in_a_row = used == kBlock;
        for (std::size_t k = 0; k < kBlock; ++k) {
            const std::size_t i = start + std::min(k, used - 1);  // unused lanes repeat the last pixel
            const std::size_t pixel = pixels ? static_cast<std::size_t>(pixels[i]) : i, width = static_cast<std::size_t>(view.width);
            at[k] = padded.index(static_cast<int>(pixel / width), static_cast<int>(pixel % width));
            any |= padded.depth[static_cast<std::size_t>(at[k])] > 0;
            in_a_row &= at[k] == at[0] + static_cast<std::ptrdiff_t>(k);
        }
        if (!any) {
            std::fill(planes + 3 * start, planes + 3 * (start + used), 0.0f);
            std::fill(support + start, support + start + used, 0.0f);
            return;
        }
        Lanes lanes;
        for (std::size_t k = 0; k < kBlock; ++k) {
            lanes.depth[k] = padded.depth[static_cast<std::size_t>(at[k])];
            lanes.value[k] = lanes.own[k] = padded.inverse[static_cast<std::size_t>(at[k])];
            lanes.footprint[k] = lanes.depth[k] * footprint_at_one;
            lanes.right[k] = lanes.down[k] = 0;
        }
        const auto fit = [&](auto add) {
            clear_sums(lanes);
            for (const Neighbour& next : window) {
                if (in_a_row) {
                    add(lanes, next, padded.depth.data() + at[0] + next.step, padded.inverse.data() + at[0] + next.step, steepest, noise);
                    continue;
                }
                for (std::size_t k = 0; k < kBlock; ++k) {
                    lanes.near_depth[k] = padded.depth[static_cast<std::size_t>(at[k] + next.step)];
                    lanes.near_inverse[k] = padded.inverse[static_cast<std::size_t>(at[k] + next.step)];
                }
                add(lanes, next, lanes.near_depth, lanes.near_inverse, steepest, noise);
            }
            solve(lanes);
        };
        fit(&add_neighbour<true>);
        fit(&add_neighbour<false>);
        for (std::size_t k = 0; k < used; ++k) {
            const std::size_t i = start + k;
            const bool known = lanes.depth[k] > 0;
            planes[3 * i] = known ? lanes.right[k] : 0.0f;
            planes[3 * i + 1] = known ? lanes.down[k] : 0.0f;
            planes[3 * i + 2] = known ? lanes.value[k] : 0.0f;
            support[i] = known ? lanes.w[k] : 0.0f;
        }
    });
}

void plane_normals(const DepthView& view, const float* planes, const std::int64_t* pixels, std::size_t n, int threads,
                   float* normals) {
    const std::size_t width = static_cast<std::size_t>(view.width);
    const double* m = view.cam_from_world;
    parallel_for((n + kChunk - 1) / kChunk, threads, [&](std::size_t chunk) {
        for (std::size_t i = chunk * kChunk; i < std::min(n, (chunk + 1) * kChunk); ++i) {
            const std::size_t pixel = pixels ? static_cast<std::size_t>(pixels[i]) : i;
            const double column = static_cast<double>(pixel % width) + 0.5, row = static_cast<double>(pixel / width) + 0.5;
            const double right = planes[3 * i], down = planes[3 * i + 1], own = planes[3 * i + 2];
            const double x = right * view.focal[0], y = down * view.focal[1];
            const double z = own - right * (column - view.center[0]) - down * (row - view.center[1]);
            const double norm = std::sqrt(x * x + y * y + z * z), rate = norm > 0 ? -1 / norm : 0;
            for (std::size_t c = 0; c < 3; ++c)
                normals[3 * i + c] = static_cast<float>(rate * (m[c] * x + m[4 + c] * y + m[8 + c] * z));
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
                         double limit, double noise_m, std::size_t min_pixels, std::int32_t* labels) {
    const std::size_t n = view.pixels(), width = static_cast<std::size_t>(view.width);
    std::vector<std::int32_t> parent(n);
    std::iota(parent.begin(), parent.end(), 0);
    const float noise = static_cast<float>(noise_m * view.focal_mean()), max_gap = static_cast<float>(limit);
    const auto belongs = [&](std::size_t i) { return valid[i] && view.depth_m[i] > 0; };
    for (std::size_t i = 0; i < n; ++i) {
        if (!belongs(i)) continue;
        const float allowed = max_gap + noise / view.depth_m[i];
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
        if (static_cast<std::size_t>(size[root]) < min_pixels) continue;
        labels[i] = root == i ? ++count : labels[root];  // the root is the first of its pixels
    }
    return count;
}

namespace {

// Labels of pixels without depth count as none.
EdgeKind edge_kind(const DepthView& view, const std::int32_t* labels, float slope, float noise, std::size_t pixel) {
    const std::ptrdiff_t i = static_cast<std::ptrdiff_t>(pixel), width = view.width;
    const std::ptrdiff_t row = i / width, column = i % width;
    const float depth = view.depth_m[i], tolerance = slope * depth + noise;
    if (labels[i] <= 0 || !(depth > 0)) return kInterior;
    bool is_free = false, hidden = false, unknown = false;
    const auto look = [&](bool inside, std::ptrdiff_t j) {
        if (!inside) {
            hidden = true;
            return;
        }
        const float other = view.depth_m[j];
        if (labels[j] == labels[i] && other > 0) return;
        unknown |= !(other > 0);
        is_free |= other > depth + tolerance;
        hidden |= other > 0 && other < depth - tolerance;
    };
    look(column > 0, i - 1);
    look(column + 1 < width, i + 1);
    look(row > 0, i - width);
    look(row + 1 < view.height, i + width);
    return hidden ? kHiddenEdge : is_free ? kFreeEdge : unknown ? kUnknownEdge : kInterior;
}

}  // namespace

void classify_edges(const DepthView& view, const std::int32_t* labels, const std::int64_t* pixels, std::size_t n,
                    double footprints, double noise_m, int threads, std::uint8_t* kinds) {
    const float slope = static_cast<float>(footprints / view.focal_mean()), noise = static_cast<float>(noise_m);
    parallel_for((n + kChunk - 1) / kChunk, threads, [&](std::size_t chunk) {
        for (std::size_t i = chunk * kChunk; i < std::min(n, (chunk + 1) * kChunk); ++i)
            kinds[i] = edge_kind(view, labels, slope, noise, pixels ? static_cast<std::size_t>(pixels[i]) : i);
    });
}

void place_edges(const DepthView& view, const std::int32_t* labels, const float* planes, const std::int64_t* pixels,
                 const std::uint8_t* kinds, std::size_t n, int max_steps, int threads, double* places, double* depths) {
    const std::ptrdiff_t width = view.width, height = view.height;
    const auto own = [&](std::ptrdiff_t pixel, std::ptrdiff_t column, std::ptrdiff_t row) {
        const std::ptrdiff_t j = row * width + column;
        return labels[j] == labels[pixel] && view.depth_m[j] > 0;
    };
    const auto inside = [&](std::ptrdiff_t column, std::ptrdiff_t row) {
        return column >= 0 && row >= 0 && column < width && row < height;
    };
    parallel_for((n + kChunk - 1) / kChunk, threads, [&](std::size_t chunk) {
        for (std::size_t i = chunk * kChunk; i < std::min(n, (chunk + 1) * kChunk); ++i) {
            const std::ptrdiff_t pixel = pixels[i], column = pixel % width, row = pixel / width;
            double right = 0, down = 0;
            if (kinds[i] == kFreeEdge) {
                for (std::ptrdiff_t dy = -1; dy <= 1; ++dy) {
                    for (std::ptrdiff_t dx = -1; dx <= 1; ++dx) {
                        if ((dx == 0 && dy == 0) || !inside(column + dx, row + dy) || own(pixel, column + dx, row + dy)) continue;
                        const double share = dx != 0 && dy != 0 ? std::sqrt(0.5) : 1.0;
                        right += share * static_cast<double>(dx);
                        down += share * static_cast<double>(dy);
                    }
                }
                const double norm = std::hypot(right, down);
                if (norm > kOneSided) {
                    int steps = 1;
                    for (; steps < max_steps; ++steps) {
                        const std::ptrdiff_t x = column + std::lround(steps * right / norm), y = row + std::lround(steps * down / norm);
                        if (!inside(x, y) || (view.depth_m[y * width + x] > 0 && !own(pixel, x, y))) break;
                    }
                    right *= 0.5 * steps / norm;
                    down *= 0.5 * steps / norm;
                } else {
                    right = down = 0;
                }
            }
            places[2 * i] = static_cast<double>(column) + 0.5 + right;
            places[2 * i + 1] = static_cast<double>(row) + 0.5 + down;
            const double depth = view.depth_m[pixel], tilt = right * planes[3 * i] + down * planes[3 * i + 1];
            const double inverse = 1 / depth + tilt;
            depths[i] = inverse > 0 ? 1 / inverse : depth;
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
                                    const double* axes, double min_cosine) {
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
        result[3 * label + 2] += p[2] * p[2] / focal_square / std::max(slant, min_cosine);
    }
    for (std::size_t label = 0; label < count; ++label) {
        for (std::size_t k = 0; k < 2; ++k) {
            if (high[2 * label + k] >= low[2 * label + k]) result[3 * label + k] = high[2 * label + k] - low[2 * label + k];
        }
    }
    return result;
}

}  // namespace usdfoliage
