// Which faces of a mesh of quads cross each other near its forks.

#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

namespace usdfoliage {

// Pairs of faces that cross, as two triangles each along their first diagonal; those that share a vertex do not count, nor
// do triangles that only touch or lie in one plane.
//
// @param points      3 each.
// @param faces       4 each.
// @param fork_faces  faces near each fork, one fork after another.
// @param fork_first  n_forks + 1, where each fork's begin.
// @return            two places in fork_faces for each pair, the lower first; each pair of faces once.
std::vector<std::int64_t> find_fork_crossings(const double* points, const std::int64_t* faces, const std::int64_t* fork_faces,
                                              const std::int64_t* fork_first, std::size_t n_forks, int threads);

}  // namespace usdfoliage
