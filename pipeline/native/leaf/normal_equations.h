// The normal equations of a step that fits a leaf to points whose closest places are known.
//
// The unknowns are changes of the 21 parameters, a turn, a shift and the logarithm of the length.

#pragma once

#include <cstddef>

#include "leaf/closest.h"
#include "leaf/curves.h"
#include "leaf/jacobian.h"

namespace usdfoliage {

constexpr std::size_t kLeafTurn = kLeafNumbers, kLeafShift = kLeafTurn + 3, kLeafGrowth = kLeafShift + 3;
constexpr std::size_t kLeafUnknowns = kLeafGrowth + 1;

struct NormalEquations {
    double matrix[kLeafUnknowns][kLeafUnknowns];  // its lower triangle is enough
    double right[kLeafUnknowns];
};

// Add what counts of the offsets of points from their closest places.
//
// @param rates  by which the offset of each point is multiplied before it is squared; points with 0 are left out
void add_offsets(const CurveSlopes& slopes, const ClosestPlaces& places, const double* rates, NormalEquations& equations);

}  // namespace usdfoliage
