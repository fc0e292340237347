// Leaves evaluated at many (u, v): points, tangents, normals, area elements.

#pragma once

#include <cstddef>

namespace usdfoliage {

// A wave along the silhouettes, the same for all leaves but for the phase.
struct LeafJitter {
    double amplitude, frequency;  // leaf lengths; cycles from base to apex
    const double* waves;          // n_waves * 2: cycles a unit, weight; used without a map
    std::size_t n_waves;
    const double* map;  // n_map numbers from -1 to 1, one cycle; may be null
    std::size_t n_map;
    const double* phases;  // one a leaf; may be null
};

// What to write, each n * p * 3 but areas, n * p; null for what nobody asked for.
template <typename Real>
struct LeafSamples {
    Real *points, *tangents_u, *tangents_v;
    Real* normals;  // unit; at base and apex the limit; +z where there is none
    Real* areas;    // length of the cross product of the tangents
};

// Evaluate n leaves at p places each.
//
// @param leaves      n * 21
// @param uv          n * p * 2, or p * 2 that all leaves share; places that follow each other at one v cost less
// @param placements  n * 12, rows of 3 x 4 matrices for column vectors; null to stay in leaf space
// @param threads     at most this many, 0 for one per core; the result does not depend on it
template <typename Real>
void leaf_samples(const double* leaves, std::size_t n, const double* uv, std::size_t p, bool shared_uv,
                  const LeafJitter& jitter, const double* placements, const LeafSamples<Real>& samples, int threads);

}  // namespace usdfoliage
