// Catmull–Clark subdivision of polygon cages through OpenSubdiv.

#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

namespace usdfoliage {

// A polygon cage. Boundary vertices and edges are interpolated as by USD's "edgeAndCorner".
struct Cage {
    const double* points;  // n_points * 3
    std::size_t n_points;
    const std::int32_t* face_counts;  // vertices per face
    std::size_t n_faces;
    const std::int32_t* face_indices;  // sum of face_counts
    std::size_t n_indices;
    const std::int32_t* crease_edges;  // n_creases * 2, vertex indices of a cage edge
    const float* crease_sharpness;     // n_creases, 10 or more is infinitely sharp
    std::size_t n_creases;
    const std::int32_t* corner_vertices;  // n_corners
    const float* corner_sharpness;        // n_corners
    std::size_t n_corners;
};

struct RefinedMesh {
    std::vector<double> points;             // vertices * 3
    std::vector<double> normals;            // vertices * 3, unit; empty unless limit was asked for
    std::vector<std::int32_t> face_indices;  // quads * 4
};

// Refine a cage uniformly.
//
// @param levels  1 or more, every face becomes quads; 0 for a cage of quads, which stays as it is.
// @param limit   move the vertices of the last level to the limit surface and give its normals there.
// @throws std::invalid_argument where counts and indices do not fit, or OpenSubdiv refuses the topology.
RefinedMesh refine_catmull_clark(const Cage& cage, int levels, bool limit);

}  // namespace usdfoliage
