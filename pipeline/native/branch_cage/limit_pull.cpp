#include "branch_cage/limit_pull.h"

#include <algorithm>
#include <cmath>

#include "parallel.h"

namespace usdfoliage {
namespace {

constexpr std::size_t kBlock = 4096;  // vertices that one task moves

// For each vertex its neighbours over edges, each once for both faces of the edge, then its opposites in its faces.
struct Stencils {
    std::vector<std::int64_t> first;  // n + 1, in faces
    std::vector<std::int32_t> edge, opposite;
};

Stencils limit_stencils(const std::int64_t* faces, std::size_t n_faces, std::size_t n) {
    Stencils stencils;
    stencils.first.assign(n + 1, 0);
    for (std::size_t k = 0; k < 4 * n_faces; ++k) ++stencils.first[static_cast<std::size_t>(faces[k]) + 1];
    for (std::size_t k = 0; k < n; ++k) stencils.first[k + 1] += stencils.first[k];
    stencils.edge.resize(4 * n_faces);
    stencils.opposite.resize(4 * n_faces);
    std::vector<std::int64_t> at(stencils.first.begin(), stencils.first.end() - 1);
    for (std::size_t face = 0; face < n_faces; ++face)
        for (std::size_t k = 0; k < 4; ++k) {
            const std::int64_t* corners = faces + 4 * face;
            const auto place = static_cast<std::size_t>(at[static_cast<std::size_t>(corners[k])]++);
            // In a closed mesh each edge comes once in either direction, so the next corner of each face is enough.
            stencils.edge[place] = static_cast<std::int32_t>(corners[(k + 1) % 4]);
            stencils.opposite[place] = static_cast<std::int32_t>(corners[(k + 2) % 4]);
        }
    return stencils;
}

}  // namespace

std::vector<double> pull_limit(const std::int64_t* faces, std::size_t n_faces, const LimitAims& aims, int rounds,
                               double farthest, int threads) {
    const Stencils stencils = limit_stencils(faces, n_faces, aims.n);
    std::vector<double> points(aims.aims, aims.aims + 3 * aims.n), next(3 * aims.n);
    const auto move = [&](std::size_t v) {
        const double *aim = aims.aims + 3 * v, *center = aims.center + 3 * v, *tangent = aims.tangents + 3 * v;
        const double valence = static_cast<double>(stencils.first[v + 1] - stencils.first[v]);
        double off[3], radial[3], moved[3];
        for (int axis = 0; axis < 3; ++axis) off[axis] = valence * valence * points[3 * v + axis];
        for (std::int64_t k = stencils.first[v]; k < stencils.first[v + 1]; ++k) {
            const double *edge = &points[3 * static_cast<std::size_t>(stencils.edge[k])],
                         *opposite = &points[3 * static_cast<std::size_t>(stencils.opposite[k])];
            for (int axis = 0; axis < 3; ++axis) off[axis] += 4 * edge[axis] + opposite[axis];
        }
        double along = 0;
        const double weight = std::max(valence * (valence + 5), 1.0);
        for (int axis = 0; axis < 3; ++axis) {
            off[axis] = off[axis] / weight - center[axis];
            radial[axis] = aim[axis] - center[axis];
            along += off[axis] * tangent[axis];
        }
        const double grown = std::clamp(1 + aims.swell[2 * v + (along > 0 ? 0 : 1)] * along, 0.5, 2.0);
        double size = 0, reach = 0;
        for (int axis = 0; axis < 3; ++axis) {
            const double missing = radial[axis] * grown - (off[axis] - along * tangent[axis]);
            moved[axis] = points[3 * v + axis] + aims.gain[v] * missing - aim[axis];
            size += moved[axis] * moved[axis];
            reach += radial[axis] * radial[axis];
        }
        // Where rows are very uneven in a bend, what is off is not what to move by: then rather round the bend off.
        const double share = std::min(1.0, farthest * std::sqrt(reach) / std::max(std::sqrt(size), 1e-300));
        for (int axis = 0; axis < 3; ++axis) next[3 * v + axis] = aim[axis] + moved[axis] * share;
    };
    for (int round = 0; round < rounds; ++round) {
        parallel_for((aims.n + kBlock - 1) / kBlock, threads, [&](std::size_t block) {
            for (std::size_t v = block * kBlock; v < std::min(aims.n, (block + 1) * kBlock); ++v) move(v);
        });
        points.swap(next);
    }
    return points;
}

}  // namespace usdfoliage
