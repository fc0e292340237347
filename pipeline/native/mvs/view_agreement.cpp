#include "mvs/view_agreement.h"

#include <cmath>

#include "parallel.h"

namespace usdfoliage {

void count_agreeing(const float* depth_m, int width, int height, const std::vector<MatchSource>& sources,
                    const AgreementSettings& settings, int threads, std::uint8_t* counts) {
    parallel_for(static_cast<std::size_t>(height), threads, [&](std::size_t line) {
        const int row = static_cast<int>(line);
        for (int column = 0; column < width; ++column) {
            const std::size_t pixel = line * static_cast<std::size_t>(width) + column;
            std::uint8_t* to = counts + 2 * pixel;
            to[0] = to[1] = 0;
            if (!(depth_m[pixel] > 0)) continue;
            const double inverse = 1 / static_cast<double>(depth_m[pixel]);
            for (const MatchSource& source : sources) {
                const double* h = source.homography;
                double seen[3];
                for (int i = 0; i < 3; ++i) {
                    seen[i] = h[3 * i] * column + h[3 * i + 1] * row + h[3 * i + 2] + source.epipole[i] * inverse;
                }
                if (!(seen[2] > 0)) continue;
                const double u = seen[0] / seen[2];
                const double v = seen[1] / seen[2];
                if (!(u > -0.5 && v > -0.5 && u < source.width - 0.5 && v < source.height - 0.5)) continue;
                const int at = static_cast<int>(v + 0.5) * source.width + static_cast<int>(u + 0.5);
                if (source.open != nullptr && source.open[at] != 0) {
                    ++to[1];
                    continue;
                }
                const double found_m = source.depth_m[at];
                if (!(found_m > 0)) continue;
                const double expected_m = seen[2] * depth_m[pixel];
                if (found_m > expected_m * (1 + 2 * settings.agree_share)) ++to[1];
                if (!(std::abs(found_m - expected_m) <= settings.agree_share * expected_m)) continue;
                if (disagreement_px(source, u, v, column, row, 1e9f) <= settings.agree_px) ++to[0];
            }
        }
    });
}

void show_planes(const float* planes, const float* cost, int width, int height, float max_cost, const MatchSource& to,
                 const double* pixel_from_ray, const double* other_pixel_from_ray, const double* turn, float* seen,
                 float* seen_cost) {
    const double focal[2] = {pixel_from_ray[0], pixel_from_ray[4]};
    const double center[2] = {pixel_from_ray[2], pixel_from_ray[5]};
    const double other_focal[2] = {other_pixel_from_ray[0], other_pixel_from_ray[4]};
    const double other_center[2] = {other_pixel_from_ray[2], other_pixel_from_ray[5]};
    for (int row = 0; row < height; ++row) {
        for (int column = 0; column < width; ++column) {
            const std::size_t pixel = static_cast<std::size_t>(row) * width + static_cast<std::size_t>(column);
            const float* plane = planes + 3 * pixel;
            if (!(plane[0] > 0) || cost[pixel] > max_cost) continue;
            const double* h = to.homography;
            double at[3];
            for (int i = 0; i < 3; ++i) at[i] = h[3 * i] * column + h[3 * i + 1] * row + h[3 * i + 2] + to.epipole[i] * plane[0];
            if (!(at[2] > 0)) continue;
            const double u = at[0] / at[2];
            const double v = at[1] / at[2];
            if (!(u > -0.5 && v > -0.5 && u < to.width - 0.5 && v < to.height - 0.5)) continue;
            const int x = static_cast<int>(u + 0.5);
            const int y = static_cast<int>(v + 0.5);
            const std::size_t other = static_cast<std::size_t>(y) * to.width + static_cast<std::size_t>(x);
            if (cost[pixel] >= seen_cost[other]) continue;
            // The plane n X = 1 in the photograph's camera axes, then in the other's: inverse depth is n times the ray.
            double n[3];
            n[0] = plane[1] * focal[0];
            n[1] = plane[2] * focal[1];
            n[2] = plane[0] - n[0] * (column - center[0]) / focal[0] - n[1] * (row - center[1]) / focal[1];
            double m[3];
            double shift = 1;
            for (int i = 0; i < 3; ++i) {
                m[i] = turn[4 * i] * n[0] + turn[4 * i + 1] * n[1] + turn[4 * i + 2] * n[2];
                shift += m[i] * turn[4 * i + 3];
            }
            if (!(shift > 1e-6)) continue;
            for (double& each : m) each /= shift;
            const double inverse = m[0] * (x - other_center[0]) / other_focal[0] + m[1] * (y - other_center[1]) / other_focal[1] + m[2];
            if (!(inverse > 0)) continue;
            seen_cost[other] = cost[pixel];
            seen[3 * other] = static_cast<float>(inverse);
            seen[3 * other + 1] = static_cast<float>(m[0] / other_focal[0]);
            seen[3 * other + 2] = static_cast<float>(m[1] / other_focal[1]);
        }
    }
}

}  // namespace usdfoliage
