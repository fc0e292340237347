// Boxes of a tree over what is in pieces, which know when all that is in them is of one piece.

#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>

namespace usdfoliage {

constexpr std::int32_t kMixed = -1;  // the piece of a box that has several

using Point = std::array<double, 3>;

struct PieceBox {
    Point low, high;
    std::size_t begin, end;
    std::size_t far_half;  // the near one comes right behind its parent; 0 of a leaf
    std::int32_t piece;    // of all that is in it, or kMixed
};

inline double square_from(const PieceBox& box, const Point& p) {
    double square = 0;
    for (std::size_t c = 0; c < 3; ++c) {
        const double out = std::max({box.low[c] - p[c], p[c] - box.high[c], 0.0});
        square += out * out;
    }
    return square;
}

}  // namespace usdfoliage
