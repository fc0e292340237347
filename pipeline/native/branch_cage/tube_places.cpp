#include "branch_cage/tube_places.h"

#include "parallel.h"
#include "branch_cage/tube_frames.h"

namespace usdfoliage {
namespace {

constexpr std::size_t kBlock = 4096;  // places of one task

void put(const TubeVector& vector, double* out) { std::copy(vector.begin(), vector.end(), out); }

}  // namespace

void find_axis(const TubeAxes& axes, const std::int64_t* tube, const double* arc, std::size_t n, double* points,
               double* radius, int threads) {
    parallel_blocks(n, kBlock, threads, [&](std::size_t k) {
        const TubePlace place = tube_axis(axes, tube[k], arc[k]);
        put(place.point, points + 3 * k);
        radius[k] = place.radius;
    });
}

void find_tangents(const TubeAxes& axes, const std::int64_t* tube, const double* arc, const double* reach, std::size_t n,
                   double* tangents, int threads) {
    parallel_blocks(n, kBlock, threads, [&](std::size_t k) { put(tube_tangent(axes, tube[k], arc[k], reach[k]), tangents + 3 * k); });
}

void find_frames(const TubeAxes& axes, const double* reference, const std::int64_t* tube, const double* arc,
                 const double* tangents, std::size_t n, double* first, double* second, int threads) {
    parallel_blocks(n, kBlock, threads, [&](std::size_t k) {
        const std::int64_t at = tube_segment(axes, tube[k], arc[k]);
        const TubeVector tangent = vector_at(tangents, static_cast<std::int64_t>(k));
        TubeVector normal;
        carry_normal(axes.direction + 3 * at, tangent.data(), reference + 3 * at, normal.data());
        put(normal, first + 3 * k);
        put(cross(tangent, normal), second + 3 * k);
    });
}

void find_nearest(const TubeAxes& axes, const std::int64_t* tube, const double* places, std::size_t n, int max_steps,
                  std::int64_t* at, double* points, double* arc, double* radius, int threads) {
    parallel_blocks(n, kBlock, threads, [&](std::size_t k) {
        const TubeVector place = vector_at(places, static_cast<std::int64_t>(k));
        const TubePlace near = tube_nearest(axes, tube[k], place, max_steps, at[k]);
        put(near.point, points + 3 * k);
        arc[k] = near.arc;
        radius[k] = near.radius;
    });
}

}  // namespace usdfoliage
