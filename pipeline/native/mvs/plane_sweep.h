// Dense matching over planes of equal depth: how well other photographs fit there, and the smoothest depth that fits.

#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

namespace usdfoliage {

// Highest matching cost; also what a pixel gets that no other photograph sees.
constexpr int kHighestCost = 127;

// A photograph's brightness.
struct Brightness {
    const std::int16_t* values;  // rows of width, in [0, 16320]
    int width;
    int height;
};

struct SweepCostSettings {
    int window_px;        // radius of the census window
    int tolerance_64ths;  // differences of brightness up to here are none; of 16320
    double best_share;    // of the photographs, so many with the lowest cost count at each pixel; at least one
};

// Census cost of every pixel of a photograph on every plane.
//
// In the window around a pixel each compared pixel is darker than, equal to or brighter than the centre; the cost counts
// how far the warped photograph differs in that, as in Zabih and Woodfill, Non-parametric local transforms, 1994, with
// the third state against noise.
//
// @param homographies  others x planes x 9 numbers, rows first: pixel indices of the other photograph (x, y, 1) from
//                      those of this one.
// @return              height x width x planes costs in [0, kHighestCost].
std::vector<std::uint8_t> sweep_cost(const Brightness& photo, const std::vector<Brightness>& others,
                                     const double* homographies, std::size_t planes, const SweepCostSettings& settings,
                                     int threads);

struct SemiglobalSettings {
    int small_step_cost;  // for one plane between neighbours
    int large_step_cost;  // for more, where the photograph is even
    double edge_64ths;    // difference of brightness that halves the large cost; of 16320
};

struct PlanePicks {
    std::vector<float> plane;       // height x width, between planes by a parabola
    std::vector<float> uniqueness;  // height x width, in [0, 1]: 0 where planes far from the best cost as little
};

// The plane of each pixel with the lowest cost summed over eight directions.
//
// H. Hirschmüller, Stereo processing by semiglobal matching and mutual information, 2008, equations 13 and 14.
//
// @param cost  height x width x planes, as sweep_cost gives them.
PlanePicks pick_planes(const std::uint8_t* cost, std::size_t planes, const Brightness& photo,
                       const SemiglobalSettings& settings, int threads);

}  // namespace usdfoliage
