// Fit leaves of 21 parameters to points by their closest places, under a prior: robust Levenberg-Marquardt, batched.
//
// A fit has 28 unknowns: the parameters, a turn, a shift and the logarithm of the length. Its objective is
//
//     sum_i w_i rho_c(|r_i|^2) / 2 + (x - mean)' precision (x - mean) / 2 + fold sum_j max(0, margin - a_j)^2 / 2
//
// with Geman and McClure's rho_c(q) = c^2 q / (c^2 + q). The residual r of a point of the interior is its distance from
// the tangent plane at its closest place, or where that is on the silhouette its offset from the silhouette's tangent; that
// of a point of the edge is its offset from the tangent of the closest place of the silhouette. r is measured in the noise
// of the leaf. x are the 21 parameters and the logarithm of the length, a_j area elements seen from above. Our own idea.

#pragma once

#include <cstddef>
#include <cstdint>

namespace usdfoliage {

constexpr std::size_t kPriorNumbers = 22;  // the parameters of a leaf and the logarithm of its length

// Points of leaves, leaf after leaf.
struct SurfacePoints {
    const double* points;          // 3 a point
    const std::uint8_t* edge;      // whether the leaf ends there
    const double* weights;         // of points
    const std::int64_t* offsets;   // leaves + 1
    const double* noise;           // of leaves, standard deviation of their points
};

// Normal distributions of what a leaf looks like.
struct SurfacePriors {
    const double* means;       // priors * 22
    const double* precisions;  // priors * 22 * 22
};

struct SurfaceFitSettings {
    int iterations;
    double first_cutoff, cutoff;  // c of rho at the first and in the last third of the iterations, in noises
    double edge_noise;                 // noise of points of the edge in that of the interior
    double fold_weight;
};

// Where fits begin and what they become.
struct SurfaceFits {
    const std::int64_t* leaf;   // whose points
    const std::int64_t* prior;  // which prior
    double* parameters;         // 21
    double* axes;               // 9: matrix with the leaf's x, y and z in the columns
    double* bases;              // 3
    double* lengths;
    double* costs;              // 3: of the points, of the prior, of folds; written
};

// Improve n fits in place.
void fit_leaf_surfaces(const SurfacePoints& points, const SurfacePriors& priors, const SurfaceFitSettings& settings,
                       const SurfaceFits& fits, std::size_t n, int threads);

}  // namespace usdfoliage
