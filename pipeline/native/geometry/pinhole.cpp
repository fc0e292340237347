#include "geometry/pinhole.h"

#include <algorithm>
#include <limits>

#include "parallel.h"

namespace usdfoliage {
namespace {

constexpr std::size_t kChunk = 8192;  // points that a thread takes at once

template <typename Fn>
void for_each(std::size_t n, int threads, const Fn& fn) {
    parallel_for((n + kChunk - 1) / kChunk, threads, [&](std::size_t chunk) {
        for (std::size_t i = chunk * kChunk; i < std::min(n, (chunk + 1) * kChunk); ++i) fn(i);
    });
}

}  // namespace

void project_points(const PinholeNumbers& camera, const double* points, std::size_t n, int threads, double* places, double* depths) {
    const double* m = camera.cam_from_world;
    constexpr double nowhere = std::numeric_limits<double>::quiet_NaN();
    for_each(n, threads, [&](std::size_t i) {
        const double *p = points + 3 * i, depth = m[8] * p[0] + m[9] * p[1] + m[10] * p[2] + m[11];
        const double x = m[0] * p[0] + m[1] * p[1] + m[2] * p[2] + m[3], y = m[4] * p[0] + m[5] * p[1] + m[6] * p[2] + m[7];
        depths[i] = depth;
        places[2 * i] = depth > 0 ? x / depth * camera.focal[0] + camera.center[0] : nowhere;
        places[2 * i + 1] = depth > 0 ? y / depth * camera.focal[1] + camera.center[1] : nowhere;
    });
}

void unproject_places(const PinholeNumbers& camera, const double* places, const double* depths, std::size_t n, int threads,
                      double* points) {
    const double* m = camera.cam_from_world;
    for_each(n, threads, [&](std::size_t i) {
        const double x = (places[2 * i] - camera.center[0]) / camera.focal[0] * depths[i] - m[3];
        const double y = (places[2 * i + 1] - camera.center[1]) / camera.focal[1] * depths[i] - m[7];
        const double z = depths[i] - m[11];
        for (std::size_t c = 0; c < 3; ++c) points[3 * i + c] = m[c] * x + m[4 + c] * y + m[8 + c] * z;
    });
}

}  // namespace usdfoliage
