// Points seen by a pinhole camera, many at once.

#pragma once

#include <cstddef>

namespace usdfoliage {

struct PinholeNumbers {
    double cam_from_world[12];  // 3 x 4, rows first
    double focal[2];            // x, y, in pixels
    double center[2];
};

// Where points are seen.
//
// @param points  n x 3, of the world
// @param places  n x 2 written: x and y in pixels, NaN behind the camera
// @param depths  n written, along the optical axis
void project_points(const PinholeNumbers& camera, const double* points, std::size_t n, int threads, double* places, double* depths);

// Where what is seen is.
//
// @param places  n x 2, in pixels
// @param depths  n, along the optical axis
// @param points  n x 3 written, of the world
void unproject_places(const PinholeNumbers& camera, const double* places, const double* depths, std::size_t n, int threads,
                      double* points);

}  // namespace usdfoliage
