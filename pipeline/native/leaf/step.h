// The best leaf for points of known (u, v): Levenberg-Marquardt on the 21 parameters with the analytic Jacobian.
//
// Points of one v enter through moments alone, so that a step costs the same for any number of points.
//
// Source: Chaurasia and Beardsley, Editable Parametric Dense Foliage from 3D Capture, equations 9 and 11.

#pragma once

#include <vector>

#include "leaf/curves.h"

namespace usdfoliage {

// A point of a leaf at one v is linear in what hangs on u: Q, A - Q, D and the three heights of curves.h.
constexpr int kTerms = 6;

// Sums over the points of a scanline: weight times term times term, times coordinate.
struct LineMoments {
    Along along;
    double weight;
    double terms[kTerms][kTerms];
    double right[3][kTerms];
    double square[3];
};

LineMoments empty_moments(double v);

void add_point(double weight, const Across& across, const double* point, LineMoments* line);

// Mean of weighted squares of the distances, and the pulls.
double fit_cost(const std::vector<LineMoments>& lines, const double* start, double prior, const double* leaf);

// How far the points of one leaf lie from those of the other at the same (u, v): root mean square.
double mean_change(const std::vector<LineMoments>& lines, const double* before, const double* after);

// Improve a leaf until it is the best within bounds that keep it from folding: the axis rises, the silhouette's points
// keep their order and their side.
//
// @param start       what is pulled towards, and where the pull is all there is
// @param half_width  of the enclosing ellipse
// @param leaf        21 numbers, changed
void minimise(const std::vector<LineMoments>& lines, const double* start, double prior, double half_width, double* leaf);

}  // namespace usdfoliage
