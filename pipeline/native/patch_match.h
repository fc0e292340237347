// Depth of a photograph from others of known pose: planes through every pixel, by PatchMatch.
//
// A plane is the inverse depth at its pixel and the slopes of inverse depth a pixel to the right and down; through it a
// pixel (x, y) of the reference is seen in a source at A (x, y, 1) + b w(x, y), homogeneous, w the inverse depth. That is
// the homography of equation 1 of Guo et al. 2020 without its pole at planes seen edge-on.

#pragma once

#include <cstddef>
#include <cstdint>

namespace usdfoliage {

struct GreyPicture {
    const float* values;  // height x width, 0 to 1
    int width, height;
};

// How the reference's pixels and inverse depths map into a source.
struct SourcePicture {
    GreyPicture picture;
    double linear[9];       // A, rows first: from (x, y, 1), pixel centres at halves
    double offset[3];       // b
    const float* planes;    // height x width x 3 of the source, or nullptr: what its depth says, for the coherence
    double back_linear[9];  // the same mapping from the source to the reference
    double back_offset[3];
};

struct PatchMatchOptions {
    int radius, step;                     // of the window, in pixels, and between its samples
    double color_sigma;                   // difference of brightness that halves a sample's weight about
    double nearest, farthest;             // inverse depths, the greater one first
    double steepest;                      // of a slope of inverse depth a pixel, over inverse depth a pixel of a plane at 45 degrees
    int best;                             // sources that count of each pixel's, those that match best
    int iterations;
    double coherence_weight;              // of a pixel of reprojection error
    double coherence_most;                // pixels of it that count at most
    double focal;                         // of the reference, in pixels
    std::uint64_t seed;
    int threads;
};

// Improve planes in place, and write what each costs: 0 a perfect match to 2, more without coherence; kUnmatched where
// nothing can be compared.
//
// @param valid   height x width, 0 where no depth is wanted; its planes become 0.
// @param planes  height x width x 3: slopes to the right and down, inverse depth; inverse depths that are not above 0
//                are guessed first.
// @param costs   height x width, written
void match_patches(const GreyPicture& reference, const std::uint8_t* valid, const SourcePicture* sources, std::size_t count,
                   const PatchMatchOptions& options, float* planes, float* costs);

constexpr float kUnmatched = 4.0f;

}  // namespace usdfoliage
