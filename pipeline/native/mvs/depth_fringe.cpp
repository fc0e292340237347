#include "mvs/depth_fringe.h"

#include <algorithm>
#include <cmath>
#include <cstddef>

#include "parallel.h"

namespace usdfoliage {

namespace {

constexpr int kMinShare = 10;  // a part in so many of the square, that must lie behind

struct Sum {
    int count = 0;
    int color[3] = {0, 0, 0};

    void add(const std::uint8_t* srgb) {
        ++count;
        for (int i = 0; i < 3; ++i) color[i] += srgb[i];
    }

    float mean(int channel) const { return static_cast<float>(color[channel]) / static_cast<float>(count); }
};

bool is_fringe(const float* depth_m, const std::uint8_t* srgb, int width, int height, const FringeSettings& settings, int column,
               int row) {
    const std::size_t pixel = static_cast<std::size_t>(row) * width + static_cast<std::size_t>(column);
    const float own_m = depth_m[pixel];
    if (!(own_m > 0)) return false;
    const float nearest_m = own_m * (1 - settings.gap);
    const float farthest_m = own_m * (1 + settings.gap);
    Sum surface, behind;
    const int left = std::max(0, column - settings.fringe_px);
    const int right = std::min(width - 1, column + settings.fringe_px);
    const int top = std::max(0, row - settings.fringe_px);
    const int bottom = std::min(height - 1, row + settings.fringe_px);
    for (int y = top; y <= bottom; ++y) {
        const std::size_t line = static_cast<std::size_t>(y) * width;
        for (int x = left; x <= right; ++x) {
            const std::size_t other = line + static_cast<std::size_t>(x);
            const float its_m = depth_m[other];
            if (!(its_m > 0) || its_m > farthest_m) {
                behind.add(srgb + 3 * other);
            } else if (its_m >= nearest_m) {
                surface.add(srgb + 3 * other);
            }
        }
    }
    if (behind.count * kMinShare < (right - left + 1) * (bottom - top + 1)) return false;
    float contrast = 0, from_surface = 0, from_behind = 0;
    for (int i = 0; i < 3; ++i) {
        const float own = srgb[3 * pixel + static_cast<std::size_t>(i)];
        contrast += std::abs(surface.mean(i) - behind.mean(i));
        from_surface += std::abs(own - surface.mean(i));
        from_behind += std::abs(own - behind.mean(i));
    }
    return contrast >= settings.fringe_contrast && from_behind < settings.fringe_nearer * from_surface;
}

}  // namespace

void find_fringe(const float* depth_m, const std::uint8_t* srgb, int width, int height, const FringeSettings& settings, int threads,
                 std::uint8_t* fringe) {
    parallel_for(static_cast<std::size_t>(height), threads, [&](std::size_t row) {
        for (int column = 0; column < width; ++column) {
            fringe[row * static_cast<std::size_t>(width) + static_cast<std::size_t>(column)] =
                is_fringe(depth_m, srgb, width, height, settings, column, static_cast<int>(row)) ? 1 : 0;
        }
    });
}

}  // namespace usdfoliage
