// Which pixels show which leaf, and how points lie to what a view sees.

#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "segmentation/depth_view.h"

namespace usdfoliage {

// How far apart two surfaces may be and count as one: footprints of a pixel, and noise_m more.
struct Tolerance {
    double footprints;
    double noise_m;
};

// Leaves drawn as grids of triangles: n x rows x columns points of the world, in metres.
struct LeafGrids {
    const double* points_m;
    std::size_t count;
    int rows;
    int columns;
    const float* penalty;  // rows x columns, in tolerances, added to the distance so that places off the leaf come last
};

// The leaf whose surface is nearest to what the view sees along each pixel's ray, within the tolerance.
//
// Distances along the ray count as often as the surface's normal allows, cosines below min_cosine as that.
//
// @param labels  height x width written: 0 for none, k for the leaf k - 1.
void claim_pixels(const LeafGrids& grids, const DepthView& view, const Tolerance& tolerance, double min_cosine, int threads,
                  std::int32_t* labels);

// How a point lies to the surface that a view sees there.
enum PointState : std::uint8_t {
    kUnseen = 0,   // outside of the picture, or without depth
    kOn = 1,       // on the surface
    kThrough = 2,  // before it: the view looks through the point
    kBehind = 3,   // behind it
};

// @param points_m  n points of the world, 3 coordinates each.
// @param states    n written, PointState.
void classify_points(const double* points_m, std::size_t n, const DepthView& view, const Tolerance& tolerance, int threads,
                     std::uint8_t* states);

// Where the pixels of a picture go among the points of all leaves.
struct PickedPixels {
    std::vector<std::int64_t> pixel;  // in order
    std::vector<std::int64_t> place;  // among the points
};

// How many pixels with depth each of count labels has.
//
// @param labels  height x width, 0 for none, k for the leaf k - 1; none above count.
std::vector<std::int64_t> count_labels(const DepthView& view, const std::int32_t* labels, std::size_t count);

// Pick evenly, over all views in turn, kept[k] of the total[k] pixels with depth of leaf k.
//
// @param labels   height x width, 0 for none, k for the leaf k - 1.
// @param offsets  the place of each leaf's first point.
// @param seen     a leaf's pixels in the views before; brought up to date.
PickedPixels pick_pixels(const DepthView& view, const std::int32_t* labels, const std::int64_t* total, const std::int64_t* kept,
                         const std::int64_t* offsets, std::int64_t* seen);

}  // namespace usdfoliage
