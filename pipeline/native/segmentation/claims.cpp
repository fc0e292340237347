#include "segmentation/claims.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "parallel.h"

namespace usdfoliage {

namespace {

constexpr int kBandRows = 16;         // of the picture, that a thread takes at once
constexpr std::size_t kChunk = 4096;  // points
constexpr double kBarely = 1e-9;      // outside of a triangle that still counts, against cracks between two

struct Corner {
    double x, y, depth;  // depth not above 0 behind the camera
};

struct Rows {
    int first, last;
};

// The rows of pixel centres between two heights.
Rows rows_between(double low, double high, int count) {
    return {static_cast<int>(std::max(0.0, std::ceil(std::max(low, -1.0) - 0.5))),
            static_cast<int>(std::min(count - 1.0, std::floor(std::min(high, count + 1.0) - 0.5)))};
}

double cosine_to_axis(const double* cam_from_world, const double* a, const double* b, const double* c) {
    double p[3], q[3];
    for (int k = 0; k < 3; ++k) {
        p[k] = b[k] - a[k];
        q[k] = c[k] - a[k];
    }
    const double n[3] = {p[1] * q[2] - p[2] * q[1], p[2] * q[0] - p[0] * q[2], p[0] * q[1] - p[1] * q[0]};
    const double length = std::sqrt(n[0] * n[0] + n[1] * n[1] + n[2] * n[2]);
    if (!(length > 0)) return 0;
    return std::fabs(cam_from_world[8] * n[0] + cam_from_world[9] * n[1] + cam_from_world[10] * n[2]) / length;
}

}  // namespace

void claim_pixels(const LeafGrids& grids, const DepthView& view, const Tolerance& tolerance, double min_cosine, int threads,
                  std::int32_t* labels) {
    const std::size_t per_leaf = static_cast<std::size_t>(grids.rows) * static_cast<std::size_t>(grids.columns);
    std::vector<Corner> corners(grids.count * per_leaf);
    std::vector<Rows> extents(grids.count);
    parallel_for(grids.count, threads, [&](std::size_t leaf) {
        const double* m = view.cam_from_world;
        double low = std::numeric_limits<double>::infinity(), high = -low;
        for (std::size_t k = leaf * per_leaf; k < (leaf + 1) * per_leaf; ++k) {
            const double* p = grids.points_m + 3 * k;
            const double depth = m[8] * p[0] + m[9] * p[1] + m[10] * p[2] + m[11];
            if (!(depth > 0)) {
                corners[k] = {0, 0, 0};
                continue;
            }
            corners[k] = {(m[0] * p[0] + m[1] * p[1] + m[2] * p[2] + m[3]) / depth * view.focal[0] + view.center[0],
                          (m[4] * p[0] + m[5] * p[1] + m[6] * p[2] + m[7]) / depth * view.focal[1] + view.center[1], depth};
            low = std::min(low, corners[k].y);
            high = std::max(high, corners[k].y);
        }
        extents[leaf] = low <= high ? rows_between(low, high, view.height) : Rows{0, -1};
    });

    const double footprint_at_one = tolerance.footprints / view.focal_mean();
    const std::size_t bands = (static_cast<std::size_t>(view.height) + kBandRows - 1) / kBandRows;
    parallel_for(bands, threads, [&](std::size_t band) {
        const int top = static_cast<int>(band) * kBandRows, bottom = std::min(view.height, top + kBandRows) - 1;
        const std::size_t width = static_cast<std::size_t>(view.width), start = static_cast<std::size_t>(top) * width;
        std::vector<float> lowest(static_cast<std::size_t>(bottom - top + 1) * width, std::numeric_limits<float>::infinity());
        std::fill(labels + start, labels + start + lowest.size(), 0);

        const auto draw = [&](std::size_t leaf, std::size_t ia, std::size_t ib, std::size_t ic) {
            const Corner *all = &corners[leaf * per_leaf], &a = all[ia], &b = all[ib], &c = all[ic];
            if (!(a.depth > 0 && b.depth > 0 && c.depth > 0)) return;
            const double area = (b.x - a.x) * (c.y - a.y) - (c.x - a.x) * (b.y - a.y);
            if (!(std::fabs(area) > kBarely)) return;
            const Rows down = rows_between(std::min({a.y, b.y, c.y}), std::max({a.y, b.y, c.y}), view.height);
            const Rows across = rows_between(std::min({a.x, b.x, c.x}), std::max({a.x, b.x, c.x}), view.width);
            const int first = std::max(down.first, top), last = std::min(down.last, bottom);
            if (first > last || across.first > across.last) return;
            const double* points = grids.points_m + 3 * leaf * per_leaf;
            const double cosine = std::max(
                min_cosine, cosine_to_axis(view.cam_from_world, points + 3 * ia, points + 3 * ib, points + 3 * ic));
            for (int row = first; row <= last; ++row) {
                for (int column = across.first; column <= across.last; ++column) {
                    const double x = column + 0.5, y = row + 0.5;
                    const double wa = ((b.x - x) * (c.y - y) - (c.x - x) * (b.y - y)) / area;
                    const double wb = ((c.x - x) * (a.y - y) - (a.x - x) * (c.y - y)) / area;
                    const double wc = 1 - wa - wb;
                    if (wa < -kBarely || wb < -kBarely || wc < -kBarely) continue;
                    const std::size_t i = static_cast<std::size_t>(row) * width + static_cast<std::size_t>(column);
                    const double seen = view.depth_m[i];
                    if (!(seen > 0)) continue;
                    const double depth = 1 / (wa / a.depth + wb / b.depth + wc / c.depth);
                    const double allowed = tolerance.noise_m + footprint_at_one * seen;
                    const double away = std::fabs(depth - seen) * cosine;
                    if (away > allowed) continue;
                    const double cost = away + allowed * (wa * grids.penalty[ia] + wb * grids.penalty[ib] + wc * grids.penalty[ic]);
                    float& best = lowest[i - start];
                    if (static_cast<float>(cost) < best) {
                        best = static_cast<float>(cost);
                        labels[i] = static_cast<std::int32_t>(leaf) + 1;
                    }
                }
            }
        };
        const std::size_t columns = static_cast<std::size_t>(grids.columns);
        for (std::size_t leaf = 0; leaf < grids.count; ++leaf) {
            if (extents[leaf].first > bottom || extents[leaf].last < top) continue;
            for (std::size_t r = 0; r + 1 < static_cast<std::size_t>(grids.rows); ++r) {
                for (std::size_t c = 0; c + 1 < columns; ++c) {
                    const std::size_t k = r * columns + c;
                    draw(leaf, k, k + 1, k + columns + 1);
                    draw(leaf, k, k + columns + 1, k + columns);
                }
            }
        }
    });
}

void classify_points(const double* points_m, std::size_t n, const DepthView& view, const Tolerance& tolerance, int threads,
                     std::uint8_t* states) {
    const double footprint_at_one = tolerance.footprints / view.focal_mean();
    parallel_for((n + kChunk - 1) / kChunk, threads, [&](std::size_t chunk) {
        for (std::size_t i = chunk * kChunk; i < std::min(n, (chunk + 1) * kChunk); ++i) {
            states[i] = kUnseen;
            const Sighting sighting = see(view, view.cam_from_world, points_m[3 * i], points_m[3 * i + 1], points_m[3 * i + 2]);
            if (sighting.pixel < 0) continue;
            const double seen = view.depth_m[sighting.pixel];
            if (!(seen > 0)) continue;
            const double allowed = tolerance.noise_m + footprint_at_one * sighting.depth_m;
            states[i] = seen > sighting.depth_m + allowed ? kThrough : seen < sighting.depth_m - allowed ? kBehind : kOn;
        }
    });
}

std::vector<std::int64_t> count_labels(const DepthView& view, const std::int32_t* labels, std::size_t count) {
    std::vector<std::int64_t> counts(count, 0);
    for (std::size_t i = 0; i < view.pixels(); ++i) {
        if (labels[i] > 0 && view.depth_m[i] > 0) ++counts[static_cast<std::size_t>(labels[i] - 1)];
    }
    return counts;
}

PickedPixels pick_pixels(const DepthView& view, const std::int32_t* labels, const std::int64_t* total, const std::int64_t* kept,
                         const std::int64_t* offsets, std::int64_t* seen) {
    PickedPixels picked;
    for (std::size_t i = 0; i < view.pixels(); ++i) {
        if (labels[i] <= 0 || !(view.depth_m[i] > 0)) continue;
        const std::size_t leaf = static_cast<std::size_t>(labels[i] - 1);
        const std::int64_t rank = seen[leaf]++;
        const std::int64_t before = rank * kept[leaf] / total[leaf];
        if ((rank + 1) * kept[leaf] / total[leaf] == before) continue;
        picked.pixel.push_back(static_cast<std::int64_t>(i));
        picked.place.push_back(offsets[leaf] + before);
    }
    return picked;
}

}  // namespace usdfoliage
