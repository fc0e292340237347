// The points of a leaf on scanlines across its axis: their (u, v), and how far each half of a scanline is to be believed.
//
// Source: Chaurasia and Beardsley, Editable Parametric Dense Foliage from 3D Capture, sections 5 and 5.1.

#pragma once

#include <cstddef>
#include <vector>

#include "leaf/curves.h"

namespace usdfoliage {

// An ellipse around (0, 1/2) in leaf space.
struct LeafEllipse {
    double half_width, half_length;
};

// One scanline, right half and left half.
struct Scanline {
    double v;
    double points[2];  // how many are kept
    double reach[2];   // distance of the silhouette from the axis, 0 where there are no points; x_s of eq. 10
    double room[2];    // distance of the ellipse from the axis, not below the reach; x_s + x_e
    double weight[2];  // eq. 10
    double full[2];    // the distance where u is 1
};

// Where a point lies; not on the leaf where line is below 0.
struct Mapped {
    double u, v;
    int line;  // number of the scanline
};

inline double scanline_place(std::size_t j, std::size_t lines) {
    return (static_cast<double>(j) + 0.5) / static_cast<double>(lines);
}

// How far the right silhouette of these curves stands off the axis at v.
double half_width_at(const double* leaf, const LeafCurves& curves, double v);

// Give points their (u, v) by the axis of a leaf.
//
// A point belongs to the scanline that its foot on the axis is nearest to, which is the strip of half the distance between
// scanlines on either side. u is the distance from the axis as a share of the farthest one on that half of the scanline,
// compared along the strip by the silhouette of the leaf as it is, and as much farther as the farthest of so many points
// evenly spread falls short of the silhouette. Where one half reaches a smaller share of the ellipse
// than the other one, something may hide its silhouette, and it is taken to reach so much farther.
//
// The paper takes the farthest distance of all scanlines for u = 1, by which leaves come out as broad at their ends as in the
// middle; their surfaces are half as far again from the truth.
//
// @param points     n * 3, in leaf space
// @param use        n, points of weight 0 are mapped but do not count
// @param mapped     n; v is where the search for the foot begins
// @param scanlines  written
void map_points(const double* leaf, const LeafEllipse& ellipse, const double* points, const std::vector<unsigned char>& kept,
                std::vector<Mapped>* mapped, std::vector<Scanline>* scanlines);

}  // namespace usdfoliage
