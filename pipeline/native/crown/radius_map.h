// Distance from the origin to a surface in every direction of a cubemap.

#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

namespace usdfoliage {

// Radius and triangle seen along each texel's direction, from the origin.
struct RadiusMap {
    std::vector<double> radius;          // 6 * size * size; 0 where no triangle is met
    std::vector<std::int32_t> triangle;  // the triangle met last, -1 where none
};

// Intersect the ray of every texel with every triangle and keep the farthest hit.
//
// Every ray starts at the origin, so that a triangle covers on a cube face the polygon of its perspective image: it is
// clipped against the face's plane, its image is rasterised and the ray-plane intersection is exact.
//
// @param points     n_points * 3
// @param triangles  n_triangles * 3 indices
// @param size       texels a side, at least 2, layout of OpenEXR's cubemaps (edge to edge)
// @param threads    at most this many; the result does not depend on it
RadiusMap radius_map(const double* points, std::size_t n_points, const std::int32_t* triangles, std::size_t n_triangles,
                     int size, int threads);

}  // namespace usdfoliage
