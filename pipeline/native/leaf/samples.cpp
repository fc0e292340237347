#include "leaf/samples.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numeric>

#include "parallel.h"

namespace usdfoliage {
namespace {

constexpr int kBits = 6;              // of the curve, an axis
constexpr std::size_t kNeighbor = 4;  // whose distance decides whether a point lies apart

bool is_finite(const double* point) {
    return std::isfinite(point[0]) && std::isfinite(point[1]) && std::isfinite(point[2]);
}

// At most so many of the indices, at even steps.
std::vector<std::int64_t> thin(const std::vector<std::int64_t>& indices, std::int64_t max_count) {
    const std::int64_t count = static_cast<std::int64_t>(indices.size()), kept = std::min(count, max_count);
    std::vector<std::int64_t> result;
    result.reserve(static_cast<std::size_t>(kept));
    for (std::int64_t rank = 0, before = -1; rank < count; ++rank) {
        const std::int64_t now = rank * kept / count;
        if (now != before) result.push_back(indices[static_cast<std::size_t>(rank)]);
        before = now;
    }
    return result;
}

// The indices along Morton's curve through the box of their points.
void order_by_curve(const double* points, std::vector<std::int64_t>& indices) {
    double low[3], extent = std::numeric_limits<double>::min();
    for (int axis = 0; axis < 3; ++axis) {
        low[axis] = std::numeric_limits<double>::infinity();
        double high = -low[axis];
        for (const std::int64_t i : indices) {
            low[axis] = std::min(low[axis], points[3 * i + axis]);
            high = std::max(high, points[3 * i + axis]);
        }
        extent = std::max(extent, high - low[axis]);
    }
    std::vector<std::pair<std::uint32_t, std::int64_t>> coded(indices.size());
    for (std::size_t k = 0; k < indices.size(); ++k) {
        std::uint32_t code = 0;
        for (int axis = 0; axis < 3; ++axis) {
            const double place = (points[3 * indices[k] + axis] - low[axis]) / extent;
            const auto cell = static_cast<std::uint32_t>(place * ((1 << kBits) - 1));
            for (int bit = 0; bit < kBits; ++bit) code |= ((cell >> bit) & 1u) << (3 * bit + axis);
        }
        coded[k] = {code, indices[k]};
    }
    std::stable_sort(coded.begin(), coded.end(), [](const auto& a, const auto& b) { return a.first < b.first; });
    for (std::size_t k = 0; k < indices.size(); ++k) indices[k] = coded[k].second;
}

// Which points have their fourth neighbour far beyond the median distance.
void distinguish(const double* points, const std::int64_t* indices, std::size_t count, double factor, std::uint8_t* apart) {
    std::fill(apart, apart + count, std::uint8_t{0});
    if (count <= kNeighbor) return;
    std::vector<double> x(count), y(count), z(count), square(count), distance(count);
    for (std::size_t i = 0; i < count; ++i) {
        const double* point = points + 3 * indices[i];
        x[i] = point[0];
        y[i] = point[1];
        z[i] = point[2];
    }
    for (std::size_t i = 0; i < count; ++i) {
        for (std::size_t k = 0; k < count; ++k) {
            const double a = x[k] - x[i], b = y[k] - y[i], c = z[k] - z[i];
            square[k] = a * a + b * b + c * c;
        }
        std::array<double, kNeighbor + 1> closest;  // with the point itself
        closest.fill(std::numeric_limits<double>::infinity());
        for (const double each : square) {
            if (!(each < closest[kNeighbor])) continue;
            std::size_t place = kNeighbor;
            for (; place > 0 && each < closest[place - 1]; --place) closest[place] = closest[place - 1];
            closest[place] = each;
        }
        distance[i] = std::sqrt(closest[kNeighbor]);
    }
    std::vector<double> ordered = distance;
    const auto middle = ordered.begin() + static_cast<std::ptrdiff_t>(count / 2);
    std::nth_element(ordered.begin(), middle, ordered.end());
    double median = *middle;
    if (count % 2 == 0) median = (median + *std::max_element(ordered.begin(), middle)) / 2;
    for (std::size_t i = 0; i < count; ++i) apart[i] = distance[i] > factor * median;
}

}  // namespace

SampledPoints sample_leaf_points(const LeafCloud& cloud, const SampleSettings& settings, int threads) {
    SampledPoints sampled;
    sampled.offsets.assign(cloud.leaves + 1, 0);
    parallel_for(cloud.leaves, threads, [&](std::size_t leaf) {
        std::int64_t inside = 0, outside = 0;
        for (std::int64_t i = cloud.offsets[leaf]; i < cloud.offsets[leaf + 1]; ++i) {
            if (is_finite(cloud.points + 3 * i)) ++(cloud.edge[i] ? outside : inside);
        }
        sampled.offsets[leaf + 1] = std::min(inside, settings.interior) + std::min(outside, settings.edge);
    });
    std::partial_sum(sampled.offsets.begin(), sampled.offsets.end(), sampled.offsets.begin());
    sampled.index.resize(static_cast<std::size_t>(sampled.offsets.back()));
    sampled.apart.resize(sampled.index.size());

    parallel_for(cloud.leaves, threads, [&](std::size_t leaf) {
        std::array<std::vector<std::int64_t>, 2> kinds;  // of the interior, of the edge
        for (std::int64_t i = cloud.offsets[leaf]; i < cloud.offsets[leaf + 1]; ++i) {
            if (is_finite(cloud.points + 3 * i)) kinds[cloud.edge[i] ? 1 : 0].push_back(i);
        }
        std::vector<std::int64_t> order = thin(kinds[1], settings.before_spread * settings.edge);
        const std::vector<std::int64_t> inside = thin(kinds[0], settings.before_spread * settings.interior);
        order.insert(order.end(), inside.begin(), inside.end());
        order_by_curve(cloud.points, order);

        // Either kind is thinned along the curve; how many are left is known.
        const std::array<std::int64_t, 2> max_points = {settings.interior, settings.edge};
        std::array<std::int64_t, 2> count = {0, 0}, rank = {0, 0}, before = {-1, -1};
        for (const std::int64_t i : order) ++count[cloud.edge[i] ? 1 : 0];
        const std::size_t first = static_cast<std::size_t>(sampled.offsets[leaf]);
        std::size_t next = first;
        for (const std::int64_t i : order) {
            const std::size_t kind = cloud.edge[i] ? 1 : 0;
            const std::int64_t now = rank[kind]++ * std::min(count[kind], max_points[kind]) / count[kind];
            if (now != before[kind]) sampled.index[next++] = i;
            before[kind] = now;
        }
        distinguish(cloud.points, sampled.index.data() + first, next - first, settings.apart, sampled.apart.data() + first);
    });
    return sampled;
}

}  // namespace usdfoliage
