// A photograph that another one is matched with, and what its depth shows at a place.

#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>

namespace usdfoliage {

// A photograph that the reference is matched with.
//
// A pixel index (u, v, 1) of the reference with inverse depth w is seen at homography (u, v, 1) + epipole w, which is
// equation 1 of Guo et al. for the plane through it.
struct MatchSource {
    const std::uint8_t* gray;  // height x width
    const std::uint8_t* tint;  // height x width x 3, the photograph without the noise of single pixels
    const std::uint8_t* open;  // height x width, not 0 where nothing can be, such as the sky; or none
    const float* depth_m;      // height x width, 0 where there is none; or none
    int width;
    int height;
    double homography[9];          // of the plane at infinity, 3 x 3, rows first
    double epipole[3];
    double back_homography[9];     // the same from this photograph to the reference
    double back_epipole[3];
};

// Disagreement with a photograph's depth, in pixels of the reference.
static inline float disagreement_px(const MatchSource& source, double u, double v, int column, int row, float limit) {
    if (!(u > -0.5 && v > -0.5 && u < source.width - 0.5 && v < source.height - 0.5)) return limit;
    const int at = static_cast<int>(v + 0.5) * source.width + static_cast<int>(u + 0.5);
    const double depth = source.depth_m[at];
    if (!(depth > 0)) return limit;
    const double* h = source.back_homography;
    const double inverse = 1 / depth;
    const double z = h[6] * u + h[7] * v + h[8] + source.back_epipole[2] * inverse;
    if (!(z > 0)) return limit;
    const double x = (h[0] * u + h[1] * v + h[2] + source.back_epipole[0] * inverse) / z - column;
    const double y = (h[3] * u + h[4] * v + h[5] + source.back_epipole[1] * inverse) / z - row;
    return std::min(limit, static_cast<float>(std::sqrt(x * x + y * y)));
}

}  // namespace usdfoliage
