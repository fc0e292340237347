// What placement and refinement share: places of the exemplar, counted random bits, differences of colours.

#pragma once

#include <cstdint>

#include "crown/texture_synthesis.h"

namespace usdfoliage {

struct Place {
    std::int32_t row, column;
    bool operator==(const Place& other) const { return row == other.row && column == other.column; }
};

// Random bits of a counter: C. Wellons' lowbias32.
inline std::uint32_t mix(std::uint32_t x) {
    x ^= x >> 16;
    x *= 0x7feb352du;
    x ^= x >> 15;
    x *= 0x846ca68bu;
    return x ^ (x >> 16);
}

inline std::uint32_t random_bits(std::uint32_t seed, std::uint32_t a, std::uint32_t b) { return mix(mix(mix(seed) ^ a) + b); }

// Sum of squared differences of n values, n a multiple of four.
inline std::int32_t squared_difference(const std::int16_t* a, const std::int16_t* b, std::int32_t n) {
    std::int32_t sum = 0;
    for (std::int32_t i = 0; i < n; ++i) {
        const auto d = static_cast<std::int16_t>(a[i] - b[i]);  // so that the compiler finds the multiply-add of 16 bits
        sum += static_cast<std::int32_t>(d) * d;
    }
    return sum;
}

inline bool is_valid(const Exemplar& e, Place p) {
    return p.row >= 0 && p.row < e.rows && p.column >= 0 && p.column < e.columns && e.valid[p.row * e.columns + p.column];
}

inline Place source_at(const Synthesis& s, std::int32_t pixel) { return {s.source[2 * pixel], s.source[2 * pixel + 1]}; }

}  // namespace usdfoliage
