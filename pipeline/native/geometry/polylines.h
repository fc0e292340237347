// Where polylines are nearest to points, each point with a polyline of its own.

#pragma once

#include <cstddef>
#include <cstdint>

namespace usdfoliage {

// Polylines, one after another; each has two points or more.
struct Polylines {
    const double* points;        // 3 each
    const std::int32_t* first;   // point of each polyline
    const std::int32_t* counts;  // points of each polyline
};

// The place of a polyline that is nearest to each of n points (3 each): the first point of its segment, and the share of
// that, from 0 to 1. Of places that are equally near the first.
//
// @param line  n, the polyline of each point
void nearest_on_lines(const Polylines& lines, const double* places, const std::int32_t* line, std::size_t n,
                      std::int64_t* segment, double* share, int threads);

// How far each of n points (3 each) is outside the hull of a polyline, whose radius at a place is linear between points:
// the least distance to a place of a segment less the radius there, the place being the nearest one of that segment.
//
// @param radius  of each point of the polylines
// @param line    n, the polyline of each point
void beyond_lines(const Polylines& lines, const double* radius, const double* places, const std::int32_t* line,
                  std::size_t n, double* beyond, int threads);

}  // namespace usdfoliage
