// Fit leaves to their points: UV mapping and Levenberg-Marquardt in turns, many leaves at once.
//
// Source: Chaurasia and Beardsley, Editable Parametric Dense Foliage from 3D Capture, sections 5 and 5.1.

#pragma once

#include <cstddef>

#include "leaf/frame.h"

namespace usdfoliage {

enum class Robustness : int { kNone = 0, kHuber = 1, kTukey = 2 };

struct LeafFitSettings {
    std::size_t min_points;  // leaves of fewer are not fitted
    double isolation;        // points whose neighbours are this many times farther than the median are left out, unless kNone
    std::size_t scanlines;  // at most
    int max_iterations;
    double tolerance;  // root mean square change of the surface, in leaf lengths, that ends the iterations
    Robustness robustness;
    double prior;  // pull towards the enclosing ellipse, a share of what all points pull
};

// What to write of each leaf.
struct LeafFits {
    double* parameters;  // n * 21
    double* ellipses;    // n * 21: the leaves that the fits began with
    double* bases;       // n * 3
    double* axes;        // n * 9: unit vectors x, y, z of leaf space
    double* lengths;     // n
    double* residuals;   // n, root mean square distance of all points from the surface
    double* coverages;   // n, the share of the leaf's width that points reach
    int* iterations;     // n
    int* outcomes;       // n, LeafOutcome; where it is not kFitted nothing else is written
};

// @param points   leaves one after the other, 3 numbers a point
// @param normals  the same, towards the cameras
// @param offsets  leaves + 1, where each leaf begins, in points
// @param threads  at most this many, 0 for one per core; the result does not depend on it
void fit_leaves(const double* points, const double* normals, const long long* offsets, std::size_t leaves,
                const LeafFitSettings& settings, const LeafFits& fits, int threads);

// Scanlines for this many points: enough of them for a few points on either half of a line.
std::size_t scanline_count(std::size_t points, std::size_t max_lines);

// Flat leaves whose silhouette follows the ellipse around (0, 1/2, 0) with these half widths.
void ellipse_leaf(double half_width, double* leaf);

}  // namespace usdfoliage
