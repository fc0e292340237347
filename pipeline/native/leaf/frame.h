// Where a leaf lies: from its points to leaf space.
//
// Source: Chaurasia and Beardsley, Editable Parametric Dense Foliage from 3D Capture, sections 5 and 5.1. Leaving points
// out is our own.

#pragma once

#include <cstddef>
#include <vector>

namespace usdfoliage {

enum LeafOutcome : int { kFitted = 0, kTooFewPoints = 1, kNotFinite = 2, kDegenerate = 3 };

struct LeafFrameSettings {
    std::size_t min_points;
    bool robust;       // leave out points that stand off the surface, and isolated ones
    double isolation;  // a point whose fourth neighbour is this many times farther than the median is isolated
};

// Leaf space in the points' frame, and the ellipse around the points in it: around (0, 1/2, 0).
struct LeafFrame {
    double base[3];
    double axes[3][3];  // unit vectors x, y, z
    double length;
    double half_width, half_length;  // of the ellipse, in leaf lengths
};

// @param points   n * 3
// @param normals  n * 3, towards the cameras; only their sum counts
// @param kept     n, written: 0 for the points that were left out
LeafOutcome leaf_frame(const double* points, const double* normals, std::size_t n, const LeafFrameSettings& settings,
                       LeafFrame* frame, std::vector<unsigned char>* kept);

}  // namespace usdfoliage
