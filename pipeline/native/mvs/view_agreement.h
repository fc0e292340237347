// How far the depths of several photographs agree.

#pragma once

#include <cstdint>
#include <vector>

#include "mvs/match_source.h"

namespace usdfoliage {

struct AgreementSettings {
    float agree_px;     // between a pixel and where it comes back to from another photograph
    float agree_share;  // between depths, of the depth
};

// Photographs whose depth agrees with a photograph's own, and those that see through it.
//
// @param depth_m  height x width of the reference, 0 where there is none.
// @param threads  at most so many, 0: one per core.
// @param counts   height x width x 2 written: photographs that agree; photographs that see something behind, or nothing.
void count_agreeing(const float* depth_m, int width, int height, const std::vector<MatchSource>& sources,
                    const AgreementSettings& settings, int threads, std::uint8_t* counts);

// The planes of a photograph as another one sees them, each at the pixel where it is seen: the best of those that meet.
//
// @param planes    height x width x 3 of the photograph.
// @param cost      height x width, of them; those above max_cost are left out.
// @param to        the other photograph: its size, and the warp from the photograph to it.
// @param pixel_from_ray        3 x 3, pixel indices of the photograph from rays.
// @param other_pixel_from_ray  the same of the other.
// @param turn      3 x 4, the other's camera axes from the photograph's: rotation and translation.
// @param seen      height x width x 3 of the other, those it holds are kept where they cost less.
// @param seen_cost height x width of the other.
void show_planes(const float* planes, const float* cost, int width, int height, float max_cost, const MatchSource& to,
                 const double* pixel_from_ray, const double* other_pixel_from_ray, const double* turn, float* seen,
                 float* seen_cost);

}  // namespace usdfoliage
