#include "forest/crown_choice.h"

#include <algorithm>
#include <cmath>
#include <unordered_map>

namespace usdfoliage {
namespace {

// Number of a square of a grid; those of far squares may be equal, which costs time alone.
std::uint64_t square_number(std::int64_t column, std::int64_t row) {
    return static_cast<std::uint64_t>(column) * 0x9E3779B97F4A7C15u + static_cast<std::uint64_t>(row);
}

}  // namespace

std::vector<std::int32_t> choose_crowns(const double* place_m, const double* radius_m, const std::int32_t* order,
                                        std::size_t n, double apart) {
    std::vector<std::int32_t> taken;
    if (n == 0) return taken;
    const double side_m = 2 * apart * *std::max_element(radius_m, radius_m + n);  // no two further apart meet
    std::unordered_map<std::uint64_t, std::vector<std::int32_t>> squares;
    for (std::size_t k = 0; k < n; ++k) {
        const std::int32_t own = order[k];
        const double x = place_m[2 * own], y = place_m[2 * own + 1];
        const auto column = static_cast<std::int64_t>(std::floor((x - place_m[0]) / side_m));
        const auto row = static_cast<std::int64_t>(std::floor((y - place_m[1]) / side_m));
        bool near = false;
        for (int square = 0; square < 9 && !near; ++square) {
            const auto found = squares.find(square_number(column + square % 3 - 1, row + square / 3 - 1));
            if (found == squares.end()) continue;
            for (const std::int32_t other : found->second) {
                const double across = place_m[2 * other] - x, along = place_m[2 * other + 1] - y;
                const double reach = apart * (radius_m[own] + radius_m[other]);
                near |= across * across + along * along < reach * reach;
            }
        }
        if (near) continue;
        taken.push_back(own);
        squares[square_number(column, row)].push_back(own);
    }
    return taken;
}

}  // namespace usdfoliage
