// The six columns of a ring that branches leave through: who has which sector, and how wide.

#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "branch_cage/hole_places.h"

namespace usdfoliage {

using Columns6 = std::array<double, kCageSides>;

struct BlockColumns {
    Columns6 middle;
    Columns6 ends;
    std::vector<int> sectors;  // of each member
};

// Whether a ring that these members (indices of wants) leave through has a sector for another.
bool has_room(const std::vector<HoleWant>& wants, const std::vector<std::size_t>& members, std::size_t want,
              double min_column);

// Angles of the six columns, and the sector of each member; members get azimuths on the same turn.
//
// Each sector ends at its branch's edges, or half-way to a neighbour that has the next sector; what is left of the circle
// is shared by the other columns. Of the six numberings the one nearest to the phase is taken, NaN for any.
BlockColumns arrange_columns(std::vector<HoleWant>& wants, const std::vector<std::size_t>& members, double phase,
                             double min_column);

double mean_turn(const Columns6& angles);
Columns6 even_columns(double phase);

}  // namespace usdfoliage
