// Depth and normals of a photograph by PatchMatch stereo with slanted planes.
//
// Every pixel has a plane, kept as the inverse depth over the picture, which is linear there: its value at the pixel and
// its slopes to the right and down. Planes spread over a checkerboard, so that each half of it reads only the other, and
// random numbers are a function of seed, pixel and iteration: the result is the same for any number of threads.

#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "mvs/match_source.h"

namespace usdfoliage {

constexpr int kMaxSamples = 64;   // of a matching window
constexpr int kMaxSources = 16;   // photographs that one is matched with
constexpr float kWorstCost = 3.0f;  // of what a photograph does not see

// The photograph that gets depth.
struct MatchReference {
    const std::uint8_t* srgb;  // height x width x 3
    const std::uint8_t* tint;  // height x width x 3, the photograph without the noise of single pixels
    const std::uint8_t* mask;  // height x width, 0 where no depth is wanted; or none
    const float* segment_planes;  // height x width x 3, as planes: that of each pixel's segment, 0 for none; or none
    const float* proposals;  // layers x height x width x 3, planes that other photographs suggest, 0 for none
    int proposal_layers;
    int width;
    int height;
    double pixel_from_ray[9];  // 3 x 3, rows first, of pixel indices
};

struct PatchMatchSettings {
    int iterations;            // each visits every pixel once
    int best_sources;          // photographs with the lowest cost that count at each pixel
    float nearest_inverse;     // largest inverse depth
    float farthest_inverse;    // smallest inverse depth, above 0
    float color_scale;         // sum of the differences of red, green and blue that weighs 1 / e in a window
    float distance_scale_px;   // distance that weighs 1 / e
    float noise;               // of 255: standard deviation of brightness below which a window has no texture
    float brightness_weight;   // cost of mean brightness that differs by brightness_scale or more
    float brightness_scale;    // of 255
    float tint_weight;         // cost of tint that differs by tint_scale or more
    float tint_scale;          // of 765: sum of the differences of red, green and blue
    float geometric_weight;    // cost of a pixel of disagreement with the depth of another photograph
    float geometric_limit_px;  // disagreement beyond it costs no more
    float open_weight;         // cost of every photograph that sees nothing where the plane is
    float segment_weight;      // cost of depth that differs from that of the segment's plane, equation 2
    float segment_limit_px;    // by so much movement in the photograph that moves most, or more
    float segment_texture;     // standard deviation of brightness in a window that halves this cost
    float step;                // first perturbation, as a share of the range of inverse depth
    float max_slant;          // tangent between the line of sight and the normal
    std::uint64_t seed;        // of the random planes
};

// Improve the planes of a photograph.
//
// The cost is one minus the correlation of the window under the homographies of the plane, weighted by likeness in colour
// and distance (M. Bleyer et al., PatchMatch stereo, 2011), and differences of brightness and tint, the mean over the best
// photographs, with what leaving the segment's plane and being seen through costs; planes spread in the diffuse
// checkerboard of Q. Xu and W. Tao, Multi-scale geometric consistency guided multi-view stereo, 2019.
//
// @param offsets  samples x 2, right and down, of the window's pixels.
// @param threads  at most so many, 0: one per core.
// @param planes   height x width x 3, inverse depth (0: start at random), its slope to the right and down, per pixel.
// @param cost     height x width written; kWorstCost and more: no match.
void match_planes(const MatchReference& reference, const std::vector<MatchSource>& sources, const int* offsets,
                  std::size_t samples, const PatchMatchSettings& settings, int threads, float* planes, float* cost);

}  // namespace usdfoliage
