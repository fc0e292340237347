// Depth beside an edge that is of the background and has got the depth of what stands before it.
//
// A matching window at the background beside a twig sees the twig, and matches best where the twig does. The pixel's colour
// shows it: it is that of what lies farther, or has no depth, around it, rather than that of what has its depth.

#pragma once

#include <cstdint>

namespace usdfoliage {

struct FringeSettings {
    int fringe_px;          // radius of the square in which colours are compared
    float gap;              // share of the depth by which other surfaces lie farther
    float fringe_contrast;  // of 765: sum of the differences between the mean colours, below which they are no evidence
    float fringe_nearer;    // share of the distance to the own surface's mean colour, within which it is the background's
};

// Which pixels are such a fringe.
//
// @param depth_m  height x width, 0 where there is none.
// @param srgb     height x width x 3.
// @param threads  at most so many, 0: one per core.
// @param fringe   height x width written: 1 for a pixel with depth whose colour is that of what lies behind, else 0.
void find_fringe(const float* depth_m, const std::uint8_t* srgb, int width, int height, const FringeSettings& settings, int threads,
                 std::uint8_t* fringe);

}  // namespace usdfoliage
