// Moving the vertices of a closed mesh of quads so that its Catmull–Clark limit passes where it is to.

#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

namespace usdfoliage {

struct LimitAims {
    const double* aims;      // 3 each, where the limits are to be
    const double* tangents;  // 3 each, unit vector along which a vertex is not moved; 0 for none
    const double* swell;     // 2 each, growth of the radius per length along the tangent, ahead and behind
    const double* center;    // 3 each, the place of the axis that an aim belongs to
    const double* gain;      // share of what is missing that a vertex is moved by
    std::size_t n;
};

// Vertices (3 each) whose limits are at their aims, nearly.
//
// @param faces     4 each, of a closed mesh.
// @param rounds    how often the vertices are moved.
// @param farthest  of an aim's distance from its center: no vertex is moved by more.
std::vector<double> pull_limit(const std::int64_t* faces, std::size_t n_faces, const LimitAims& aims, int rounds,
                               double farthest, int threads);

}  // namespace usdfoliage
