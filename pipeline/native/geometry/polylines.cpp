#include "geometry/polylines.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "parallel.h"

namespace usdfoliage {
namespace {

constexpr std::size_t kBlock = 1024;  // points of one task
constexpr double kNoLength = 1e-300;  // square of a segment's length, at least

// fn(segment, share, square of the distance) for every segment of a polyline.
template <typename Fn>
void for_each_segment(const Polylines& lines, std::int32_t line, const double* place, const Fn& fn) {
    const std::int64_t first = lines.first[line], last = first + lines.counts[line] - 1;
    for (std::int64_t at = first; at < last; ++at) {
        const double* start = lines.points + 3 * at;
        double step[3], from[3], square = 0, along = 0;
        for (int k = 0; k < 3; ++k) {
            step[k] = start[3 + k] - start[k];
            from[k] = place[k] - start[k];
            square += step[k] * step[k];
            along += from[k] * step[k];
        }
        const double share = std::clamp(along / std::max(square, kNoLength), 0.0, 1.0);
        double away = 0;
        for (int k = 0; k < 3; ++k) {
            const double across = from[k] - share * step[k];
            away += across * across;
        }
        fn(at, share, away);
    }
}

}  // namespace

void nearest_on_lines(const Polylines& lines, const double* places, const std::int32_t* line, std::size_t n,
                      std::int64_t* segment, double* share, int threads) {
    parallel_blocks(n, kBlock, threads, [&](std::size_t k) {
        double nearest = std::numeric_limits<double>::infinity();
        segment[k] = lines.first[line[k]];
        share[k] = 0;
        for_each_segment(lines, line[k], places + 3 * k, [&](std::int64_t at, double along, double away) {
            if (!(away < nearest)) return;
            nearest = away;
            segment[k] = at;
            share[k] = along;
        });
    });
}

void beyond_lines(const Polylines& lines, const double* radius, const double* places, const std::int32_t* line,
                  std::size_t n, double* beyond, int threads) {
    parallel_blocks(n, kBlock, threads, [&](std::size_t k) {
        beyond[k] = std::numeric_limits<double>::infinity();
        for_each_segment(lines, line[k], places + 3 * k, [&](std::int64_t at, double along, double away) {
            const double reach = (1 - along) * radius[at] + along * radius[at + 1];
            beyond[k] = std::min(beyond[k], std::sqrt(away) - reach);
        });
    });
}

}  // namespace usdfoliage
