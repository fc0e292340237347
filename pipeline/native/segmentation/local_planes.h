// Planes around the pixels of a depth map, the pieces of surface that they make up, and where these end.

#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "segmentation/depth_view.h"

namespace usdfoliage {

struct PlaneSettings {
    int radius_px;      // of the window
    double steepest;    // how steep a surface may be at first, in footprints of depth a pixel; half of it is the last tolerance
    double noise_m;     // standard deviation of the depth
};

// The plane around each of n pixels: inverse depth, which is linear in the pixel's place, by two robust fits.
//
// The first fit takes the neighbours that a steep surface through the pixel could reach, the second those near the
// first plane.
//
// @param pixels   n indices of pixels; nullptr for all of them, n of them in order.
// @param threads  at most so many, 0: one per core.
// @param planes   n x 3 written: slopes of inverse depth to the right and down, a pixel, and its value at the pixel; the
//                 pixel's own value without slopes where too few neighbours lie near; zeros without depth.
// @param support  n written: the sum of the weights, each at most 1, of the last fit; 0 without depth.
void fit_local_planes(const DepthView& view, const std::int64_t* pixels, std::size_t n, const PlaneSettings& settings,
                      int threads, float* planes, float* support);

// Normals of planes around pixels: unit, in the world, towards the camera; 0 where there is no plane.
//
// A plane n X = 1 in the camera's axes has inverse depth n (x, y, 1) along the ray (x, y, 1).
//
// @param planes   n x 3, as fit_local_planes writes them
// @param pixels   n indices of pixels; nullptr for all of them
// @param normals  n x 3 written
void plane_normals(const DepthView& view, const float* planes, const std::int64_t* pixels, std::size_t n, int threads,
                   float* normals);

// Gap without a surface on one side.
constexpr float kNoSurface = 1e30f;

// How far the planes of neighbours part at either pixel, in footprints of a pixel: height x width each.
//
// @param right  written: between a pixel and the next to the right; kNoSurface where one has no depth, and at the end.
// @param down   written: the same for the next below.
void measure_gaps(const DepthView& view, const float* planes, int threads, float* right, float* down);

// Connected pieces: pixels joined where their gap is below limit + noise_m / footprint.
//
// @param valid       height x width, 0 where a pixel belongs to none; pixels without depth never do.
// @param min_pixels  smaller pieces are dropped.
// @param labels      height x width written: 0 for none, others numbered in the order of their first pixels.
// @return            the number of pieces.
std::int32_t join_pixels(const DepthView& view, const float* right, const float* down, const std::uint8_t* valid,
                         double limit, double noise_m, std::size_t min_pixels, std::int32_t* labels);

// Kinds of pixels of a piece.
enum EdgeKind : std::uint8_t { kInterior = 0, kFreeEdge = 1, kHiddenEdge = 2, kUnknownEdge = 3 };

// What kind each labelled pixel is, by the depth of those of its four neighbours that are not of its own label.
//
// Hidden where one of them is nearer by more than footprints + noise_m, or the picture ends; else free where one is
// farther by as much; else unknown where one has no depth; else interior, and so are pixels without a label. Labels of
// pixels without depth count as none.
//
// @param labels  height x width, 0 for none
// @param pixels  n indices of pixels; nullptr for all of them
// @param kinds   n written
void classify_edges(const DepthView& view, const std::int32_t* labels, const std::int64_t* pixels, std::size_t n,
                    double footprints, double noise_m, int threads, std::uint8_t* kinds);

// Where what pixels show ends: half way between a pixel at a free edge and the first that shows what is behind.
//
// The centre of the last pixel that shows a surface lies inside of it; where depth is missing beside edges, by much.
//
// @param labels     height x width, as for classify_edges
// @param planes     n x 3, around the pixels
// @param pixels     n indices of pixels
// @param kinds      n, by classify_edges; all but kFreeEdge stay at the pixel's centre
// @param max_steps  pixels without depth that are passed to see what is behind
// @param places     n x 2 written: x and y in pixels
// @param depths     n written, on the plane around the pixel
void place_edges(const DepthView& view, const std::int32_t* labels, const float* planes, const std::int64_t* pixels,
                 const std::uint8_t* kinds, std::size_t n, int max_steps, int threads, double* places, double* depths);

// Sums over the points of each of count labels, in the camera's axes: 10 numbers a label.
//
// @param first_m  count x 3 written: the first point of each label
// @return         the number of pixels, then the sums of x, y, z, xx, xy, xz, yy, yz, zz about the label's first point
std::vector<double> sum_points(const DepthView& view, const std::int32_t* labels, std::size_t count, std::vector<double>& first_m);

// Extents of each label along its own axes, and its area.
//
// @param axes  count x 9: rows the axes, the last the normal.
// @return      count x 3: extents along the first and second axis, area with every pixel lying on a plane of this normal,
//              seen at no less than min_cosine.
std::vector<double> measure_extents(const DepthView& view, const std::int32_t* labels, std::size_t count,
                                    const double* axes, double min_cosine);

}  // namespace usdfoliage
