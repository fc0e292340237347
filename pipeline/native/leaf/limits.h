// What the 21 numbers of a leaf may be while it is fitted: ranges, and the order of its silhouette.

#pragma once

#include "leaf/curves.h"

namespace usdfoliage {

// Lowest and highest of each number, in leaf space, in the order of LeafCurves.
struct LeafLimits {
    double low[kLeafNumbers], high[kLeafNumbers];
};

// @param half_width  half the width of the leaf's points, in lengths of the leaf.
LeafLimits leaf_limits(double half_width);

// Whether the axis' two points, and the silhouette's three, follow each other from base to apex (v rises); else the
// leaf folds back over itself.
//
// @param leaf  21 numbers.
bool silhouette_in_order(const double* leaf);

}  // namespace usdfoliage
