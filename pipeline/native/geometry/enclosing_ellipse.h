// The smallest ellipse around points of a plane.
//
// Source: L. G. Khachiyan, Rounding of polytopes in the real number model of computation, 1996, with the first weights of
// P. Kumar and E. A. Yildirim, Minimum-volume enclosing ellipsoids and core sets, 2005, and the steps away from points of
// M. J. Todd and E. A. Yildirim, On Khachiyan's algorithm for the computation of minimum-volume enclosing ellipsoids, 2007.

#pragma once

#include <cstddef>
#include <vector>

namespace usdfoliage {

// Half axes are 0 where the points do not span one; the centre is not a number where there is no point.
struct Ellipse {
    double center[2];
    double half[2];  // the longer one first
    double angle;    // of the longer one from +x, in radians, above -pi / 2 up to pi / 2
};

// Corners of the convex hull, counter-clockwise, without points on its sides; of points on a line the two ends.
//
// @param points  n * 2
// @return        coordinates of the corners, 2 each
std::vector<double> convex_hull(const double* points, std::size_t n);

// @param points     n * 2
// @param tolerance  the ellipse's area is at most about this share larger than the smallest
Ellipse enclosing_ellipse(const double* points, std::size_t n, double tolerance);

// Ellipses of many sets.
//
// @param points   sets one after the other, 2 numbers a point
// @param offsets  sets + 1, where each set begins, in points
// @param centers  sets * 2, written
// @param halves   sets * 2, written
// @param angles   sets, written
// @param threads  at most this many, 0 for one per core; the result does not depend on it
void enclosing_ellipses(const double* points, const long long* offsets, std::size_t sets, double tolerance, double* centers,
                        double* halves, double* angles, int threads);

}  // namespace usdfoliage
