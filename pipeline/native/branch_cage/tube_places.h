// Points, directions and frames at many places along the axes of tubes.

#pragma once

#include <cstddef>
#include <cstdint>

#include "branch_cage/tube_axes.h"

namespace usdfoliage {

// Points (3 each) and radii at n places; beyond an end of a tube those of the end.
void find_axis(const TubeAxes& axes, const std::int64_t* tube, const double* arc, std::size_t n, double* points,
               double* radius, int threads);

// Unit chords (3 each) over the axes from reach before each of n places to reach after it.
void find_tangents(const TubeAxes& axes, const std::int64_t* tube, const double* arc, const double* reach, std::size_t n,
                   double* tangents, int threads);

// Two unit vectors (3 each) at each of n places, right-handed with the tangents there.
//
// @param reference  3 each, of the axes' points: unit normals that are carried along the tubes.
// @param tangents   3 each, unit.
void find_frames(const TubeAxes& axes, const double* reference, const std::int64_t* tube, const double* arc,
                 const double* tangents, std::size_t n, double* first, double* second, int threads);

// The place of a tube next to each of n points (3 each): points (3 each), arcs and radii there.
//
// @param at  the tube's segment where the search begins, in and out.
void find_nearest(const TubeAxes& axes, const std::int64_t* tube, const double* places, std::size_t n, int max_steps,
                  std::int64_t* at, double* points, double* arc, double* radius, int threads);

}  // namespace usdfoliage
