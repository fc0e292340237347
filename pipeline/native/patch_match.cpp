#include "patch_match.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

#include "parallel.h"
#include "vector_clones.h"

namespace usdfoliage {
namespace {

constexpr int kMostSources = 16;
constexpr int kLanes = 8;              // samples side by side
constexpr int kMostSamples = 256;      // of a window
constexpr int kRows = 8;               // that a thread takes at once
constexpr float kFlat = 1e-5f;         // variance of brightness below which a window has no texture
constexpr float kNoMatch = 2.0f;       // cost in a source that does not show the window
constexpr double kLeastInverse = 1e-12;

struct Plane {
    float right, down, value;
};

// Numbers that depend on seed, place and use alone: the splitmix64 finaliser.
struct Dice {
    std::uint64_t state;
    double next() {
        state += 0x9e3779b97f4a7c15ULL;
        std::uint64_t z = state;
        z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9ULL;
        z = (z ^ (z >> 27)) * 0x94d049bb133111ebULL;
        return static_cast<double>((z ^ (z >> 31)) >> 11) * 0x1.0p-53;
    }
    double within(double low, double high) { return low + (high - low) * next(); }
};

struct Offset {
    int right, down;
};

// What of a window does not depend on the plane.
struct Window {
    int padded;  // samples, with some of no weight at the pixel itself to fill the lanes
    float weights[kMostSamples], values[kMostSamples], right[kMostSamples], down[kMostSamples];
    float sum, mean, variance;
};

// A window as a source shows it.
struct Seen {
    float values[kMostSamples];
};

// Look a window's samples up in a source; false where it does not show them all.
USDFOLIAGE_VECTOR_CLONES
bool see_window(const Window& window, const float* start, const float* right, const float* down, const GreyPicture& picture,
                Seen& seen) {
    float u[kMostSamples], v[kMostSamples];
    const float end_u = static_cast<float>(picture.width - 1), end_v = static_cast<float>(picture.height - 1);
    int inside[kLanes];
    std::fill(inside, inside + kLanes, 1);
    for (int k = 0; k < window.padded; k += kLanes) {
        for (int lane = 0; lane < kLanes; ++lane) {
            const int n = k + lane;
            const float z = start[2] + right[2] * window.right[n] + down[2] * window.down[n], rate = 1 / z;
            u[n] = (start[0] + right[0] * window.right[n] + down[0] * window.down[n]) * rate - 0.5f;
            v[n] = (start[1] + right[1] * window.right[n] + down[1] * window.down[n]) * rate - 0.5f;
            inside[lane] &= (z > 0) & (u[n] >= 0) & (v[n] >= 0) & (u[n] < end_u) & (v[n] < end_v);
        }
    }
    for (const int each : inside)
        if (!each) return false;
    for (int k = 0; k < window.padded; ++k) {
        const int i = static_cast<int>(u[k]), j = static_cast<int>(v[k]);
        const float p = u[k] - static_cast<float>(i), q = v[k] - static_cast<float>(j);
        const float* corner = picture.values + j * picture.width + i;
        const float above = corner[0] + p * (corner[1] - corner[0]);
        const float below = corner[picture.width] + p * (corner[picture.width + 1] - corner[picture.width]);
        seen.values[k] = above + q * (below - above);
    }
    return true;
}

// One less the weighed correlation of two windows: 0 to 2; as bad as can be without texture.
USDFOLIAGE_VECTOR_CLONES
float correlate(const Window& window, const Seen& seen) {
    float mean[kLanes] = {}, square[kLanes] = {}, product[kLanes] = {};
    for (int k = 0; k < window.padded; k += kLanes) {
        for (int lane = 0; lane < kLanes; ++lane) {
            const float value = seen.values[k + lane], weighed = window.weights[k + lane] * value;
            mean[lane] += weighed;
            square[lane] += weighed * value;
            product[lane] += weighed * window.values[k + lane];
        }
    }
    float m = 0, s = 0, c = 0;
    for (int lane = 0; lane < kLanes; ++lane) {
        m += mean[lane];
        s += square[lane];
        c += product[lane];
    }
    m /= window.sum;
    const float variance = s / window.sum - m * m, common = c / window.sum - m * window.mean;
    if (!(variance > kFlat && window.variance > kFlat)) return kNoMatch;
    return std::clamp(1 - common / std::sqrt(variance * window.variance), 0.0f, kNoMatch);
}

class Matcher {
   public:
    Matcher(const GreyPicture& reference, const std::uint8_t* valid, const SourcePicture* sources, std::size_t count,
            const PatchMatchOptions& options, float* planes, float* costs)
        : reference_(reference), valid_(valid), sources_(sources), count_(std::min<std::size_t>(count, kMostSources)),
          options_(options), planes_(reinterpret_cast<Plane*>(planes)), costs_(costs) {
        for (int down = -options.radius; down <= options.radius; down += options.step)
            for (int right = -options.radius; right <= options.radius; right += options.step)
                if (window_.size() < kMostSamples) window_.push_back({right, down});
    }

    void run() {
        rows([&](int row) {
            for (int column = 0; column < reference_.width; ++column) begin(column, row);
        });
        for (int iteration = 0; iteration < options_.iterations; ++iteration) {
            // Red and black by turns: each asks only pixels of the other colour, which stay as they are meanwhile.
            for (int color = 0; color < 2; ++color) {
                rows([&](int row) {
                    for (int column = (row + color) % 2; column < reference_.width; column += 2) improve(column, row, iteration);
                });
            }
        }
    }

   private:
    template <typename Fn>
    void rows(const Fn& fn) {
        const std::size_t bands = (static_cast<std::size_t>(reference_.height) + kRows - 1) / kRows;
        parallel_for(bands, options_.threads, [&](std::size_t band) {
            const int first = static_cast<int>(band) * kRows;
            for (int row = first; row < std::min(reference_.height, first + kRows); ++row) fn(row);
        });
    }

    std::size_t index(int column, int row) const {
        return static_cast<std::size_t>(row) * static_cast<std::size_t>(reference_.width) + static_cast<std::size_t>(column);
    }

    Dice dice(std::size_t pixel, int use) const {
        Dice dice{options_.seed ^ (static_cast<std::uint64_t>(pixel) * 0xd1342543de82ef95ULL) ^
                  (static_cast<std::uint64_t>(use) * 0xaf251af3b0f025b5ULL)};
        dice.next();
        return dice;
    }

    // A surface at 45 degrees changes its inverse depth so much a pixel.
    double slope_unit(double value) const { return value / options_.focal; }

    bool allowed(const Plane& plane) const {
        if (!(plane.value >= options_.farthest && plane.value <= options_.nearest)) return false;
        const double most = options_.steepest * slope_unit(plane.value);
        return std::fabs(plane.right) <= most && std::fabs(plane.down) <= most;
    }

    Plane guess(Dice& dice) const {
        const double value = dice.within(options_.farthest, options_.nearest), most = slope_unit(value);
        return {static_cast<float>(dice.within(-most, most)), static_cast<float>(dice.within(-most, most)),
                static_cast<float>(value)};
    }

    void begin(int column, int row) {
        const std::size_t pixel = index(column, row);
        if (valid_ && !valid_[pixel]) {
            planes_[pixel] = {0, 0, 0};
            costs_[pixel] = kUnmatched;
            return;
        }
        Dice chance = dice(pixel, 0);
        if (!allowed(planes_[pixel])) planes_[pixel] = guess(chance);
        Window window;
        look(column, row, window);
        costs_[pixel] = cost(column, row, window, planes_[pixel]);
    }

    void look(int column, int row, Window& window) const {
        const float own = reference_.values[index(column, row)];
        const float color_rate = static_cast<float>(1 / (2 * options_.color_sigma * options_.color_sigma));
        const float place_rate = 1 / static_cast<float>(2 * options_.radius * options_.radius);
        int count = 0;
        float sum = 0, mean = 0, square = 0;
        for (const Offset& offset : window_) {
            const int x = column + offset.right, y = row + offset.down;
            if (x < 0 || y < 0 || x >= reference_.width || y >= reference_.height) continue;
            const float value = reference_.values[index(x, y)], apart = value - own;
            const float away = static_cast<float>(offset.right * offset.right + offset.down * offset.down);
            const float weight = std::exp(-apart * apart * color_rate - away * place_rate);
            const int k = count++;
            window.weights[k] = weight;
            window.values[k] = value;
            window.right[k] = static_cast<float>(offset.right);
            window.down[k] = static_cast<float>(offset.down);
            sum += weight;
            mean += weight * value;
            square += weight * value * value;
        }
        for (; count % kLanes; ++count) window.weights[count] = window.values[count] = window.right[count] = window.down[count] = 0;
        window.padded = count;
        window.sum = sum;
        window.mean = mean / sum;
        window.variance = square / sum - window.mean * window.mean;
    }

    // One less the correlation of the windows: 0 to 2.
    float source_cost(int column, int row, const Window& window, const Plane& plane, const SourcePicture& source) const {
        const double x = column + 0.5, y = row + 0.5;
        double at[3], by_right[3], by_down[3];
        for (int c = 0; c < 3; ++c) {
            const double* a = source.linear + 3 * c;
            at[c] = a[0] * x + a[1] * y + a[2] + source.offset[c] * plane.value;
            by_right[c] = a[0] + source.offset[c] * plane.right;
            by_down[c] = a[1] + source.offset[c] * plane.down;
        }
        const float start[3] = {static_cast<float>(at[0]), static_cast<float>(at[1]), static_cast<float>(at[2])};
        const float right[3] = {static_cast<float>(by_right[0]), static_cast<float>(by_right[1]), static_cast<float>(by_right[2])};
        const float down[3] = {static_cast<float>(by_down[0]), static_cast<float>(by_down[1]), static_cast<float>(by_down[2])};
        Seen seen;
        if (!see_window(window, start, right, down, source.picture, seen)) return kNoMatch;
        return correlate(window, seen);
    }

    // Pixels between a place and where it comes back to through the source's own depth there, equation 3.
    float reprojection(int column, int row, const Plane& plane, const SourcePicture& source) const {
        const float most = static_cast<float>(options_.coherence_most);
        const double x = column + 0.5, y = row + 0.5;
        double there[3], back[3];
        for (int c = 0; c < 3; ++c) {
            const double* a = source.linear + 3 * c;
            there[c] = a[0] * x + a[1] * y + a[2] + source.offset[c] * plane.value;
        }
        if (!(there[2] > 0)) return most;
        const double u = there[0] / there[2], v = there[1] / there[2];
        if (!(u >= 0 && v >= 0 && u < source.picture.width && v < source.picture.height)) return most;
        const std::ptrdiff_t pixel = static_cast<std::ptrdiff_t>(v) * source.picture.width + static_cast<std::ptrdiff_t>(u);
        const float* other = source.planes + 3 * pixel;
        if (!(other[2] > 0)) return most;
        const double beside = u - std::floor(u) - 0.5, below = v - std::floor(v) - 0.5;
        const double inverse = std::max(kLeastInverse, other[2] + other[0] * beside + other[1] * below);
        for (int c = 0; c < 3; ++c) {
            const double* a = source.back_linear + 3 * c;
            back[c] = a[0] * u + a[1] * v + a[2] + source.back_offset[c] * inverse;
        }
        if (!(back[2] > 0)) return most;
        return std::min(most, static_cast<float>(std::hypot(back[0] / back[2] - x, back[1] / back[2] - y)));
    }

    float cost(int column, int row, const Window& window, const Plane& plane) const {
        std::array<float, kMostSources> each;
        for (std::size_t k = 0; k < count_; ++k) {
            each[k] = source_cost(column, row, window, plane, sources_[k]);
            if (sources_[k].planes)
                each[k] += static_cast<float>(options_.coherence_weight) * reprojection(column, row, plane, sources_[k]);
        }
        const std::size_t best = std::min<std::size_t>(static_cast<std::size_t>(options_.best), count_);
        std::partial_sort(each.begin(), each.begin() + static_cast<std::ptrdiff_t>(best), each.begin() + static_cast<std::ptrdiff_t>(count_));
        float sum = 0;
        for (std::size_t k = 0; k < best; ++k) sum += each[k];
        return best ? sum / static_cast<float>(best) : kUnmatched;
    }

    void improve(int column, int row, int iteration) {
        const std::size_t pixel = index(column, row);
        if (valid_ && !valid_[pixel]) return;
        Window window;
        look(column, row, window);
        Plane plane = planes_[pixel];
        float least = costs_[pixel];
        const auto attempt = [&](const Plane& other) {
            if (!allowed(other)) return;
            const float now = cost(column, row, window, other);
            if (now < least) {
                least = now;
                plane = other;
            }
        };
        // The best of near and of far pixels to every side.
        static constexpr Offset kSides[4] = {{1, 0}, {-1, 0}, {0, 1}, {0, -1}};
        for (const Offset& side : kSides) {
            for (const bool far : {false, true}) {
                std::size_t found = pixel;
                float its_cost = kUnmatched;
                Offset from{0, 0};
                const auto ask = [&](int right, int down) {
                    const int x = column + right, y = row + down;
                    if (x < 0 || y < 0 || x >= reference_.width || y >= reference_.height) return;
                    const std::size_t other = index(x, y);
                    if (costs_[other] >= its_cost || !(planes_[other].value > 0)) return;
                    found = other;
                    its_cost = costs_[other];
                    from = {right, down};
                };
                if (far) {
                    for (int away = 3; away <= 15; away += 4) ask(side.right * away, side.down * away);
                } else {
                    ask(side.right, side.down);
                    ask(2 * side.right + side.down, 2 * side.down + side.right);
                    ask(2 * side.right - side.down, 2 * side.down - side.right);
                }
                if (found == pixel) continue;
                const Plane& other = planes_[found];
                const Plane moved{other.right, other.down,
                                  other.value - other.right * static_cast<float>(from.right) - other.down * static_cast<float>(from.down)};
                attempt(moved);
            }
        }
        // Changes that become finer with every iteration.
        Dice chance = dice(pixel, iteration + 1);
        const double scale = std::pow(0.5, iteration);
        const auto changed = [&](double by_value, double by_slope) {
            const double unit = slope_unit(plane.value);
            return Plane{static_cast<float>(plane.right + chance.within(-1, 1) * by_slope * unit),
                         static_cast<float>(plane.down + chance.within(-1, 1) * by_slope * unit),
                         static_cast<float>(plane.value * (1 + chance.within(-1, 1) * by_value))};
        };
        attempt(guess(chance));
        attempt(changed(0.05 * scale, 0));
        attempt(changed(0, scale));
        attempt(changed(0.01 * scale, 0.3 * scale));
        attempt(changed(0.002 * scale, 0.1 * scale));
        planes_[pixel] = plane;
        costs_[pixel] = least;
    }

    const GreyPicture& reference_;
    const std::uint8_t* valid_;
    const SourcePicture* sources_;
    std::size_t count_;
    const PatchMatchOptions& options_;
    Plane* planes_;
    float* costs_;
    std::vector<Offset> window_;
};

}  // namespace

void match_patches(const GreyPicture& reference, const std::uint8_t* valid, const SourcePicture* sources, std::size_t count,
                   const PatchMatchOptions& options, float* planes, float* costs) {
    Matcher(reference, valid, sources, count, options, planes, costs).run();
}

}  // namespace usdfoliage
