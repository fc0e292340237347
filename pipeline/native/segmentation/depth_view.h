// A depth map and the pinhole camera that saw it.

#pragma once

#include <cmath>
#include <cstddef>

namespace usdfoliage {

struct DepthView {
    const float* depth_m;  // rows of width, along the optical axis, 0 where there is none
    int width;
    int height;
    double focal[2];              // x, y, in pixels
    double center[2];             // x, y, in pixels
    const double* cam_from_world;  // 3 x 4, rows first

    std::size_t pixels() const { return static_cast<std::size_t>(width) * static_cast<std::size_t>(height); }

    // Pixels a metre at depth 1: a pixel's footprint is depth / focal_mean() wide.
    double focal_mean() const { return std::sqrt(focal[0] * focal[1]); }
};

// Where a point of a camera's axes is seen.
struct Sighting {
    std::ptrdiff_t pixel;  // -1 outside of the picture and behind the camera
    double depth_m;
};

// See a point through a 3 x 4 matrix, rows first, into the camera's axes.
inline Sighting see(const DepthView& view, const double* m, double x, double y, double z) {
    const double depth = m[8] * x + m[9] * y + m[10] * z + m[11];
    if (!(depth > 0)) return {-1, depth};
    const double u = (m[0] * x + m[1] * y + m[2] * z + m[3]) / depth * view.focal[0] + view.center[0];
    const double v = (m[4] * x + m[5] * y + m[6] * z + m[7]) / depth * view.focal[1] + view.center[1];
    if (!(u >= 0 && u < view.width && v >= 0 && v < view.height)) return {-1, depth};
    return {static_cast<std::ptrdiff_t>(v) * view.width + static_cast<std::ptrdiff_t>(u), depth};
}

}  // namespace usdfoliage
