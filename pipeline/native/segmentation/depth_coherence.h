// One view's depth from several: what others confirm is averaged, what they deny goes, what they all see is filled in.

#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "segmentation/depth_view.h"

namespace usdfoliage {

struct FuseSettings {
    double footprints;  // depths agree up to so many footprints of a pixel
    double noise_m;     // and so much more
    int min_own;        // depths, its own with them, that confirm a pixel's own
    int min_others;     // depths that stand in for one that is not confirmed, or for none
};

// What became of a pixel.
enum FusedKind : std::uint8_t {
    kNoDepth = 0,    // there was none, and is none
    kAlone = 1,      // no other view could have seen it: left as it was
    kConfirmed = 2,  // averaged with those that agree
    kReplaced = 3,   // another depth that others agree on
    kFilled = 4,     // the same, where there was none
    kRemoved = 5,    // others look through it, and agree on nothing
};

// The depth of `view` from its own and from others'.
//
// The others' points are put into the view's pixels, the nearest of each view into a pixel. Another view could have seen
// a point if it has depth where it sees the point, and that is not nearer.
//
// @param threads  at most so many, 0: one per core.
// @param depth_m  height x width written, 0 for none.
// @param kinds    height x width written, FusedKind.
void fuse_depth(const DepthView& view, const std::vector<DepthView>& others, const FuseSettings& settings, int threads, float* depth_m,
                std::uint8_t* kinds);

}  // namespace usdfoliage
