// The matching window of PatchMatch stereo: how well a photograph fits through a homography.

#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <vector>

#include "mvs/patch_match.h"

namespace usdfoliage {

constexpr int kLanes = 8;          // sums of their own, so that wide registers give the same bits
typedef float Lanes __attribute__((vector_size(32)));
typedef std::int32_t IntLanes __attribute__((vector_size(32)));
constexpr int kColorLevels = 766;  // sums of the differences of red, green and blue

// Brightness with the three pixels right, below and both beside it in one word, so that a look between pixels is one read.
class PackedPicture {
public:
    PackedPicture(const std::uint8_t* gray, int width, int height)
        : words_(static_cast<std::size_t>(width) * height), width_(width), height_(height) {
        for (int row = 0; row < height; ++row) {
            const std::uint8_t* above = gray + static_cast<std::size_t>(row) * width;
            const std::uint8_t* below = gray + static_cast<std::size_t>(std::min(row + 1, height - 1)) * width;
            std::int32_t* to = &words_[static_cast<std::size_t>(row) * width];
            for (int column = 0; column < width; ++column) {
                const int right = std::min(column + 1, width - 1);
                const std::uint32_t word = static_cast<std::uint32_t>(above[column]) | static_cast<std::uint32_t>(above[right]) << 8 |
                                           static_cast<std::uint32_t>(below[column]) << 16 | static_cast<std::uint32_t>(below[right]) << 24;
                to[column] = static_cast<std::int32_t>(word);
            }
        }
    }

    const std::int32_t* words() const { return words_.data(); }
    int width() const { return width_; }
    int height() const { return height_; }

private:
    std::vector<std::int32_t> words_;
    int width_;
    int height_;
};

// Which pixels a window has, and how they weigh.
struct WindowPattern {
    WindowPattern(const int* offsets, std::size_t samples, const PatchMatchSettings& settings)
        : count(static_cast<int>((samples + kLanes - 1) / kLanes) * kLanes),
          noise_square(settings.noise * settings.noise),
          brightness_weight(settings.brightness_weight),
          brightness_rate(1 / settings.brightness_scale),
          tint_weight(settings.tint_weight),
          tint_rate(1 / settings.tint_scale) {
        for (int k = 0; k < count; ++k) {
            const bool used = k < static_cast<int>(samples);
            columns[k] = used ? offsets[2 * k] : 0;
            rows[k] = used ? offsets[2 * k + 1] : 0;
            right[k] = static_cast<float>(columns[k]);
            down[k] = static_cast<float>(rows[k]);
            const float distance = std::sqrt(right[k] * right[k] + down[k] * down[k]);
            nearness[k] = used ? std::exp(-distance / settings.distance_scale_px) : 0;
            reach_px = std::max(reach_px, std::max(std::abs(right[k]), std::abs(down[k])));
        }
        for (int k = 0; k < kColorLevels; ++k) likeness[k] = std::exp(-static_cast<float>(k) / settings.color_scale);
    }

    int count;  // a multiple of kLanes
    float noise_square;
    float brightness_weight;
    float brightness_rate;
    float tint_weight;
    float tint_rate;
    float reach_px = 0;
    int columns[kMaxSamples];
    int rows[kMaxSamples];
    alignas(32) float right[kMaxSamples];
    alignas(32) float down[kMaxSamples];
    float nearness[kMaxSamples];
    float likeness[kColorLevels];
};

// A pixel's window in its own photograph.
struct Window {
    alignas(32) float weight[kMaxSamples];    // sum 1
    alignas(32) float weighted[kMaxSamples];  // weight times brightness without the mean
    float variance;
    float mean;
};

inline void cut_window(const WindowPattern& pattern, const std::uint8_t* srgb, int width, int height, int column, int row,
                       Window& window) {
    const std::uint8_t* center = srgb + (static_cast<std::size_t>(row) * width + column) * 3;
    float gray[kMaxSamples];
    float sum = 0;
    float mean = 0;
    for (int k = 0; k < pattern.count; ++k) {
        const int x = std::clamp(column + pattern.columns[k], 0, width - 1);
        const int y = std::clamp(row + pattern.rows[k], 0, height - 1);
        const std::uint8_t* at = srgb + (static_cast<std::size_t>(y) * width + x) * 3;
        const int apart = std::abs(at[0] - center[0]) + std::abs(at[1] - center[1]) + std::abs(at[2] - center[2]);
        gray[k] = 0.299f * static_cast<float>(at[0]) + 0.587f * static_cast<float>(at[1]) + 0.114f * static_cast<float>(at[2]);
        window.weight[k] = pattern.nearness[k] * pattern.likeness[apart];
        sum += window.weight[k];
        mean += window.weight[k] * gray[k];
    }
    const float inverse = 1 / sum;
    mean *= inverse;
    window.variance = 0;
    window.mean = mean;
    for (int k = 0; k < pattern.count; ++k) {
        const float off = gray[k] - mean;
        window.weight[k] *= inverse;
        window.weighted[k] = window.weight[k] * off;
        window.variance += window.weighted[k] * off;
    }
}

// Where up to kLanes photographs see a window, to first order about its middle: over so few pixels the rest is below a
// tenth of a pixel at any slant.
struct WindowPlaces {
    Lanes u, v;              // pixel index of the middle
    Lanes u_right, u_down;   // change of it, a pixel to the right and down
    Lanes v_right, v_down;
    Lanes depth;             // above 0 where all of the window is well before the camera
};

// How unlike a window and a photograph are; kWorstCost where not all of it is seen.
//
// One minus their weighted correlation, which is blind to the mean of either, and for that what their mean brightness and
// the tint of their middles differ by: it distinguishes a twig from the wall behind it,
// which has no more texture than noise.
inline float window_cost(const WindowPattern& pattern, const Window& window, const PackedPicture& picture,
                         const WindowPlaces& places, std::size_t lane, const std::uint8_t* own_tint,
                         const std::uint8_t* tint) {
    const float u0 = places.u[lane];
    const float v0 = places.v[lane];
    const float u_right = places.u_right[lane];
    const float u_down = places.u_down[lane];
    const float v_right = places.v_right[lane];
    const float v_down = places.v_down[lane];
    const float last_u = static_cast<float>(picture.width() - 1);
    const float last_v = static_cast<float>(picture.height() - 1);
    if (!(places.depth[lane] > 0)) return kWorstCost;
    const float reach_u = pattern.reach_px * (std::abs(u_right) + std::abs(u_down));
    const float reach_v = pattern.reach_px * (std::abs(v_right) + std::abs(v_down));
    if (!(u0 >= reach_u && v0 >= reach_v && u0 + reach_u <= last_u && v0 + reach_v <= last_v)) return kWorstCost;

    const std::int32_t* words = picture.words();
    const std::int32_t stride = picture.width();
    Lanes sums = {}, squares = {}, products = {};
    for (int k = 0; k < pattern.count; k += kLanes) {
        const Lanes r = *reinterpret_cast<const Lanes*>(pattern.right + k);
        const Lanes d = *reinterpret_cast<const Lanes*>(pattern.down + k);
        const Lanes u = u0 + u_right * r + u_down * d;
        const Lanes v = v0 + v_right * r + v_down * d;
        const IntLanes left = __builtin_convertvector(u, IntLanes);
        const IntLanes top = __builtin_convertvector(v, IntLanes);
        const Lanes across = u - __builtin_convertvector(left, Lanes);
        const Lanes along = v - __builtin_convertvector(top, Lanes);
        const IntLanes at = top * stride + left;
        const IntLanes word = {words[at[0]], words[at[1]], words[at[2]], words[at[3]],
                               words[at[4]], words[at[5]], words[at[6]], words[at[7]]};
        const Lanes a = __builtin_convertvector(word & 255, Lanes);
        const Lanes b = __builtin_convertvector((word >> 8) & 255, Lanes);
        const Lanes c = __builtin_convertvector((word >> 16) & 255, Lanes);
        const Lanes e = __builtin_convertvector((word >> 24) & 255, Lanes);
        const Lanes above = a + (b - a) * across;
        const Lanes below = c + (e - c) * across;
        const Lanes value = above + (below - above) * along;
        const Lanes weighted = *reinterpret_cast<const Lanes*>(window.weight + k) * value;
        sums += weighted;
        squares += weighted * value;
        products += *reinterpret_cast<const Lanes*>(window.weighted + k) * value;
    }
    sums += __builtin_shufflevector(sums, sums, 4, 5, 6, 7, 0, 1, 2, 3);
    squares += __builtin_shufflevector(squares, squares, 4, 5, 6, 7, 0, 1, 2, 3);
    products += __builtin_shufflevector(products, products, 4, 5, 6, 7, 0, 1, 2, 3);
    sums += __builtin_shufflevector(sums, sums, 2, 3, 0, 1, 6, 7, 4, 5);
    squares += __builtin_shufflevector(squares, squares, 2, 3, 0, 1, 6, 7, 4, 5);
    products += __builtin_shufflevector(products, products, 2, 3, 0, 1, 6, 7, 4, 5);
    sums += __builtin_shufflevector(sums, sums, 1, 0, 3, 2, 5, 4, 7, 6);
    squares += __builtin_shufflevector(squares, squares, 1, 0, 3, 2, 5, 4, 7, 6);
    products += __builtin_shufflevector(products, products, 1, 0, 3, 2, 5, 4, 7, 6);
    const float variance = std::max(0.0f, squares[0] - sums[0] * sums[0]);
    const float both = (window.variance + pattern.noise_square) * (variance + pattern.noise_square);
    const float brighter = std::min(1.0f, std::abs(sums[0] - window.mean) * pattern.brightness_rate);
    const std::uint8_t* there = tint + 3 * (static_cast<int>(v0 + 0.5f) * stride + static_cast<int>(u0 + 0.5f));
    const int apart = std::abs(there[0] - own_tint[0]) + std::abs(there[1] - own_tint[1]) + std::abs(there[2] - own_tint[2]);
    const float tinted = std::min(1.0f, static_cast<float>(apart) * pattern.tint_rate);
    return 1 - products[0] / std::sqrt(both) + pattern.brightness_weight * brighter + pattern.tint_weight * tinted;
}

}  // namespace usdfoliage
