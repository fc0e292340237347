// Places of a leaf's surface that are near to folding over, seen from above.

#pragma once

#include <vector>

#include "leaf/curves.h"
#include "leaf/jacobian.h"

namespace usdfoliage {

struct NearFold {
    double u, v;
    double scale;  // area elements are times this compared with what they should be
    double lack;   // how much the element is smaller than that
};

// Those among some places spread over both halves where the area element is too small for the leaf's width.
std::vector<NearFold> find_near_folds(const double* parameters);

// Derivatives of the scaled area element by the parameters, with the scale kept as it is.
//
// @param slopes_of_area  21, written
void write_area_slopes(const LeafCurves& curves, const CurveSlopes& slopes, const NearFold& near, double* slopes_of_area);

}  // namespace usdfoliage
