#include "mvs/plane_sweep.h"

#include <algorithm>
#include <cassert>
#include <cmath>
#include <cstdlib>
#include <utility>

#include "parallel.h"

namespace usdfoliage {

// Integers come out the same with wider registers, so these loops may use what the machine has.
#if defined(__GNUC__) && !defined(__clang__) && defined(__x86_64__) && defined(__linux__)
#define USDFOLIAGE_WIDE __attribute__((target_clones("avx2", "default")))
#else
#define USDFOLIAGE_WIDE
#endif

namespace {

constexpr std::int16_t kOutside = -1;
constexpr int kBlockRows = 16;
constexpr int kUnseen = 255;
constexpr std::size_t kGatheredPlanes = 32;  // written together, since the planes of a pixel lie side by side

// One row of a photograph seen through a homography, kOutside where it does not reach; columns [first, first + count).
void warp_row(const Brightness& other, const double* h, int row, int first, int count, double* u, double* v,
              std::int16_t* warped) {
    const double y = row;
    const double top_u = h[1] * y + h[2];
    const double top_v = h[4] * y + h[5];
    const double top_w = h[7] * y + h[8];
    for (int i = 0; i < count; ++i) {
        const double x = first + i;
        const double w = h[6] * x + top_w;
        const double inverse = w > 0 ? 1 / w : -1e300;
        u[i] = (h[0] * x + top_u) * inverse;
        v[i] = (h[3] * x + top_v) * inverse;
    }
    const double last_u = other.width - 1;
    const double last_v = other.height - 1;
    for (int i = 0; i < count; ++i) {
        if (!(u[i] >= 0 && v[i] >= 0 && u[i] < last_u && v[i] < last_v)) {
            warped[i] = kOutside;
            continue;
        }
        const int across = static_cast<int>(u[i] * 256);
        const int along = static_cast<int>(v[i] * 256);
        const int right = across & 255;
        const int down = along & 255;
        const std::int16_t* at = other.values + static_cast<std::ptrdiff_t>(along >> 8) * other.width + (across >> 8);
        const int above = (at[0] << 8) + (at[1] - at[0]) * right;  // below 2^22
        const int below = (at[other.width] << 8) + (at[other.width + 1] - at[other.width]) * right;
        warped[i] = static_cast<std::int16_t>((above + (((below - above) >> 8) * down) + 128) >> 8);
    }
}

inline std::int16_t compared(std::int16_t value, std::int16_t center, std::int16_t tolerance) {
    const auto difference = static_cast<std::int16_t>(value - center);
    return static_cast<std::int16_t>((difference > tolerance) - (difference < -tolerance));
}

// Add how one pixel of the window differs, for a row.
USDFOLIAGE_WIDE void add_differing(const std::int16_t* __restrict beside, const std::int16_t* __restrict center,
                   const std::int16_t* __restrict census, std::int16_t tolerance, int width,
                   std::int16_t* __restrict differing) {
    for (int x = 0; x < width; ++x) {
        const auto apart = static_cast<std::int16_t>(compared(beside[x], center[x], tolerance) - census[x]);
        differing[x] = static_cast<std::int16_t>(differing[x] + (apart < 0 ? -apart : apart));
    }
}

// Mean of the `best` lowest costs of each pixel that are seen; `costs`, a row after another, is sorted on the way.
USDFOLIAGE_WIDE void mean_of_lowest(std::vector<std::uint8_t>& costs, std::size_t others, std::size_t best, std::size_t line,
                    std::uint8_t* mean) {
    for (std::size_t pass = 0; pass < best; ++pass) {  // the lowest rises to the front, then the next one
        for (std::size_t i = others - 1; i > pass; --i) {
            std::uint8_t* __restrict low = &costs[(i - 1) * line];
            std::uint8_t* __restrict high = &costs[i * line];
            for (std::size_t x = 0; x < line; ++x) {
                const std::uint8_t smaller = std::min(low[x], high[x]);
                high[x] = std::max(low[x], high[x]);
                low[x] = smaller;
            }
        }
    }
    for (std::size_t x = 0; x < line; ++x) {
        int sum = 0;
        int count = 0;
        for (std::size_t i = 0; i < best; ++i) {
            const int value = costs[i * line + x];
            sum += value == kUnseen ? 0 : value;
            count += value != kUnseen;
        }
        mean[x] = static_cast<std::uint8_t>(count == 0 ? kHighestCost : (2 * sum + count) / (2 * count));
    }
}

}  // namespace

std::vector<std::uint8_t> sweep_cost(const Brightness& photo, const std::vector<Brightness>& others,
                                     const double* homographies, std::size_t planes, const SweepCostSettings& settings,
                                     int threads) {
    assert(settings.window_px >= 1 && planes >= 1 && !others.empty());
    const int width = photo.width;
    const int height = photo.height;
    const int pad = settings.window_px;
    const int padded = width + 2 * pad;
    const auto tolerance = static_cast<std::int16_t>(settings.tolerance_64ths);

    // The photograph with its border repeated, so that windows there need no care.
    std::vector<std::int16_t> own(static_cast<std::size_t>(height + 2 * pad) * padded);
    for (int row = 0; row < height + 2 * pad; ++row) {
        const std::int16_t* from = photo.values + static_cast<std::size_t>(std::clamp(row - pad, 0, height - 1)) * width;
        for (int column = 0; column < padded; ++column) {
            own[static_cast<std::size_t>(row) * padded + column] = from[std::clamp(column - pad, 0, width - 1)];
        }
    }
    std::vector<std::pair<int, int>> offsets;
    for (int dy = -pad; dy <= pad; ++dy) {
        for (int dx = -pad; dx <= pad; ++dx) {
            if (dx != 0 || dy != 0) offsets.emplace_back(dy, dx);
        }
    }
    const int scale = static_cast<int>(256.0 * kHighestCost / (2.0 * static_cast<double>(offsets.size())));
    const auto best = static_cast<std::size_t>(
        std::clamp(std::lround(settings.best_share * static_cast<double>(others.size())), 1L, static_cast<long>(others.size())));

    std::vector<std::uint8_t> cost(static_cast<std::size_t>(height) * width * planes, kHighestCost);
    const std::size_t blocks = static_cast<std::size_t>((height + kBlockRows - 1) / kBlockRows);
    parallel_for(blocks, threads, [&](std::size_t block) {
        const int top = static_cast<int>(block) * kBlockRows;
        const int rows = std::min(kBlockRows, height - top);
        const std::size_t line = static_cast<std::size_t>(width);

        // The census of the photograph does not depend on the plane.
        std::vector<std::int16_t> census(offsets.size() * rows * line);
        for (std::size_t k = 0; k < offsets.size(); ++k) {
            for (int row = 0; row < rows; ++row) {
                const std::int16_t* center = &own[static_cast<std::size_t>(top + row + pad) * padded + pad];
                const std::int16_t* beside = center + static_cast<std::ptrdiff_t>(offsets[k].first) * padded + offsets[k].second;
                std::int16_t* to = &census[(k * rows + row) * line];
                for (int x = 0; x < width; ++x) to[x] = compared(beside[x], center[x], tolerance);
            }
        }

        std::vector<std::int16_t> warped(static_cast<std::size_t>(rows + 2 * pad) * padded);
        std::vector<double> u(padded);
        std::vector<double> v(padded);
        std::vector<std::int16_t> differing(line);
        std::vector<std::uint8_t> each(others.size() * line);
        std::vector<std::uint8_t> gathered(static_cast<std::size_t>(kGatheredPlanes) * rows * line);
        std::vector<std::uint8_t> warped_costs(others.size() * rows * line);
        for (std::size_t plane = 0; plane < planes; ++plane) {
            for (std::size_t other = 0; other < others.size(); ++other) {
                const double* h = homographies + (other * planes + plane) * 9;
                for (int row = 0; row < rows + 2 * pad; ++row) {
                    warp_row(others[other], h, top + row - pad, -pad, padded, u.data(), v.data(),
                             &warped[static_cast<std::size_t>(row) * padded]);
                }
                for (int row = 0; row < rows; ++row) {
                    std::fill(differing.begin(), differing.end(), std::int16_t{0});
                    const std::int16_t* center = &warped[static_cast<std::size_t>(row + pad) * padded + pad];
                    for (std::size_t k = 0; k < offsets.size(); ++k) {
                        add_differing(center + static_cast<std::ptrdiff_t>(offsets[k].first) * padded + offsets[k].second,
                                      center, &census[(k * rows + row) * line], tolerance, width, differing.data());
                    }
                    std::uint8_t* to = &warped_costs[(other * rows + row) * line];
                    for (int x = 0; x < width; ++x) {
                        const int value = (differing[x] * scale + 128) >> 8;
                        to[x] = static_cast<std::uint8_t>(center[x] < 0 ? kUnseen : value);
                    }
                }
            }
            const std::size_t gather = plane % kGatheredPlanes;
            for (int row = 0; row < rows; ++row) {
                for (std::size_t other = 0; other < others.size(); ++other) {
                    std::copy_n(&warped_costs[(other * rows + row) * line], line, &each[other * line]);
                }
                mean_of_lowest(each, others.size(), best, line, &gathered[(gather * rows + row) * line]);
            }
            if (gather + 1 == kGatheredPlanes || plane + 1 == planes) {
                for (std::size_t pixel = 0; pixel < rows * line; ++pixel) {
                    std::uint8_t* to = &cost[(top * line + pixel) * planes + plane - gather];
                    for (std::size_t i = 0; i <= gather; ++i) to[i] = gathered[i * rows * line + pixel];
                }
            }
        }
    });
    return cost;
}

namespace {

// Add what one direction costs: along each line of pixels, the cheapest way to arrive on each plane.
void add_direction(const std::uint8_t* cost, std::size_t planes, const Brightness& photo, int dy, int dx,
                   const SemiglobalSettings& settings, int threads, std::uint16_t* total) {
    std::vector<std::pair<int, int>> starts;  // pixels whose predecessor is outside
    for (int row = 0; row < photo.height; ++row) {
        const bool whole_row = row - dy < 0 || row - dy >= photo.height;
        for (int column = 0; column < photo.width; ++column) {
            if (whole_row || column - dx < 0 || column - dx >= photo.width) starts.emplace_back(row, column);
        }
    }
    const auto small_step = static_cast<std::uint16_t>(settings.small_step_cost);

    parallel_for(starts.size(), threads, [&](std::size_t start) {
        // A border of high values on both ends spares the first and last plane a case of their own.
        constexpr std::uint16_t kHigh = 30000;
        std::vector<std::uint16_t> before(planes + 2, kHigh);
        std::vector<std::uint16_t> now(planes + 2, kHigh);
        std::uint16_t lowest = 0;
        int row = starts[start].first;
        int column = starts[start].second;
        std::int16_t last_value = 0;
        bool first = true;
        while (row >= 0 && row < photo.height && column >= 0 && column < photo.width) {
            const std::size_t pixel = static_cast<std::size_t>(row) * photo.width + column;
            const std::uint8_t* own = cost + pixel * planes;
            std::uint16_t* sum = total + pixel * planes;
            const std::int16_t value = photo.values[pixel];
            std::uint16_t next_lowest = kHigh;
            if (first) {
                for (std::size_t d = 0; d < planes; ++d) {
                    now[d + 1] = own[d];
                    next_lowest = std::min(next_lowest, now[d + 1]);
                }
            } else {
                const double difference = std::abs(value - last_value);
                const double large = settings.large_step_cost * settings.edge_64ths / (settings.edge_64ths + difference);
                const auto jump = static_cast<std::uint16_t>(lowest + std::max(settings.small_step_cost + 1, static_cast<int>(large)));
                const std::uint16_t* from = before.data();
                std::uint16_t* to = now.data() + 1;
                for (std::size_t d = 0; d < planes; ++d) {
                    const auto step = static_cast<std::uint16_t>(std::min(from[d], from[d + 2]) + small_step);
                    const std::uint16_t cheapest = std::min(std::min(from[d + 1], step), jump);
                    to[d] = static_cast<std::uint16_t>(own[d] + cheapest - lowest);
                    next_lowest = std::min(next_lowest, to[d]);
                }
            }
            for (std::size_t d = 0; d < planes; ++d) sum[d] = static_cast<std::uint16_t>(sum[d] + now[d + 1]);
            std::swap(before, now);
            lowest = next_lowest;
            last_value = value;
            first = false;
            row += dy;
            column += dx;
        }
    });
}

}  // namespace

PlanePicks pick_planes(const std::uint8_t* cost, std::size_t planes, const Brightness& photo,
                       const SemiglobalSettings& settings, int threads) {
    assert(planes >= 1 && settings.small_step_cost < settings.large_step_cost && settings.large_step_cost < 8000);
    const std::size_t pixels = static_cast<std::size_t>(photo.height) * photo.width;
    std::vector<std::uint16_t> total(pixels * planes, 0);
    constexpr int kDirections[8][2] = {{0, 1}, {0, -1}, {1, 0}, {-1, 0}, {1, 1}, {1, -1}, {-1, 1}, {-1, -1}};
    for (const auto& direction : kDirections) {
        add_direction(cost, planes, photo, direction[0], direction[1], settings, threads, total.data());
    }

    PlanePicks picks{std::vector<float>(pixels), std::vector<float>(pixels)};
    parallel_for(static_cast<std::size_t>(photo.height), threads, [&](std::size_t row) {
        for (std::size_t pixel = row * photo.width; pixel < (row + 1) * photo.width; ++pixel) {
            const std::uint16_t* sum = total.data() + pixel * planes;
            const std::size_t best = static_cast<std::size_t>(std::min_element(sum, sum + planes) - sum);
            float between = 0;
            if (best > 0 && best + 1 < planes) {
                const float below = sum[best - 1];
                const float above = sum[best + 1];
                const float bend = below - 2 * static_cast<float>(sum[best]) + above;
                if (bend > 0) between = 0.5f * (below - above) / bend;
            }
            std::uint16_t second = 65535;
            for (std::size_t d = 0; d < planes; ++d) {
                if (d + 2 < best || d > best + 2) second = std::min(second, sum[d]);
            }
            picks.plane[pixel] = static_cast<float>(best) + between;
            picks.uniqueness[pixel] = second > 0 ? 1 - static_cast<float>(sum[best]) / static_cast<float>(second) : 0;
        }
    });
    return picks;
}

}  // namespace usdfoliage
