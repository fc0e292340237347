// How far the pieces of a mesh stand off each other.

#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

namespace usdfoliage {

struct PieceMesh {
    const double* points;         // P * 3, finite
    const std::int32_t* corners;  // T * 3, of triangles, counter-clockwise from outside
    const std::int32_t* piece;    // P, from 0 on: points of one triangle are of one piece
    std::size_t triangles;
};

struct PieceEdges {
    const std::int32_t* ends;    // E * 2, points, by piece
    const std::int64_t* first;   // Q + 1, where those of each piece begin
    const std::int32_t* pieces;  // Q, the pieces that are asked for
    std::size_t count;           // Q
};

// How far the ends of each piece's edges are from all other pieces: infinity where there is no other piece. What is nearer
// than `near_enough` need not be the smallest.
//
// Triangles are found in a tree of boxes that know when all of theirs are of one piece.
//
// @param through  whether it is 0 where an edge goes through a triangle of another piece
// @param threads  as parallel_for
// @return         count
std::vector<double> piece_gaps(const PieceMesh& mesh, const PieceEdges& asked, double near_enough, bool through,
                               int threads);

}  // namespace usdfoliage
