#include <algorithm>
#include <array>
#include <limits>

#include "parallel.h"
#include "crown/texture_places.h"

namespace usdfoliage {
namespace {

constexpr int kC = kTextureChannels;

class Refinement {
  public:
    Refinement(const Exemplar& exemplar, const Synthesis& synthesis, const RefineSettings& settings, int threads)
        : e_(exemplar), s_(synthesis), settings_(settings), threads_(threads), next_(synthesis.source, synthesis.source + 2 * synthesis.rows * synthesis.columns) {}

    void run() {
        for (std::int32_t phase = 0; phase < 4; ++phase) {
            // Diagonal neighbours first, so that no direction of scan shows.
            const std::int32_t row = phase == 1 || phase == 2, column = phase == 1 || phase == 3;
            const auto rows = static_cast<std::size_t>((s_.rows - row + 1) / 2);
            parallel_for(rows, threads_, [&](std::size_t k) {
                const auto y = static_cast<std::int32_t>(2 * k) + row;
                for (std::int32_t x = column; x < s_.columns; x += 2) search(y, x, static_cast<std::uint32_t>(phase));
            });
            parallel_for(rows, threads_, [&](std::size_t k) {
                const auto y = static_cast<std::int32_t>(2 * k) + row;
                for (std::int32_t x = column; x < s_.columns; x += 2) commit(y * s_.columns + x);
            });
        }
    }

  private:
    void commit(std::int32_t pixel) {
        s_.source[2 * pixel] = next_[2 * pixel];
        s_.source[2 * pixel + 1] = next_[2 * pixel + 1];
        if (s_.known[pixel]) return;
        const std::int32_t from = next_[2 * pixel] * e_.columns + next_[2 * pixel + 1];
        for (int c = 0; c < kC; ++c) s_.color[kC * pixel + c] = e_.color[kC * from + c];
    }

    // Whether a whole neighbourhood is one verbatim copy, of which nothing can become better.
    bool settled(std::int32_t y, std::int32_t x, Place here) const {
        const std::int32_t radius = settings_.radius;
        for (std::int32_t v = std::max(y - radius, 0); v <= std::min(y + radius, s_.rows - 1); ++v) {
            for (std::int32_t u = std::max(x - radius, 0); u <= std::min(x + radius, s_.columns - 1); ++u) {
                const std::int32_t pixel = v * s_.columns + u;
                if (s_.known[pixel] || !(source_at(s_, pixel) == Place{here.row + v - y, here.column + u - x})) return false;
            }
        }
        return true;
    }

    // Squared difference of the neighbourhoods of an output pixel and a place, given up beyond the best so far.
    std::int64_t cost(std::int32_t y, std::int32_t x, Place p, std::int64_t best) const {
        // What lies outside the output or outside the exemplar is not compared, and the mean of the rest stands for it.
        const std::int32_t radius = settings_.radius;
        const std::int32_t top = std::max({-radius, -y, -p.row});
        const std::int32_t bottom = std::min({radius, s_.rows - 1 - y, e_.rows - 1 - p.row});
        const std::int32_t left = std::max({-radius, -x, -p.column});
        const std::int32_t right = std::min({radius, s_.columns - 1 - x, e_.columns - 1 - p.column});
        const std::int64_t whole = (2 * radius + 1) * (2 * radius + 1);
        const std::int64_t compared = (bottom - top + 1) * (right - left + 1);
        std::int64_t sum = 0;
        for (std::int32_t v = top; v <= bottom; ++v) {
            sum += squared_difference(s_.color + kC * ((y + v) * s_.columns + x + left),
                                      e_.color + kC * ((p.row + v) * e_.columns + p.column + left), kC * (right - left + 1));
            if (sum * whole >= best * compared) return best;
        }
        sum = sum * whole / compared;
        if (settings_.guide_weight == 0) return sum;
        return std::min(best, sum + settings_.guide_weight * static_cast<std::int64_t>(squared_difference(
                                        s_.guide + kC * (y * s_.columns + x), e_.guide + kC * (p.row * e_.columns + p.column), kC)));
    }

    void search(std::int32_t y, std::int32_t x, std::uint32_t phase) {
        const std::int32_t pixel = y * s_.columns + x;
        if (s_.known[pixel] == 2) return;
        Place best = source_at(s_, pixel);
        if (settled(y, x, best)) return;
        std::int64_t lowest = cost(y, x, best, std::numeric_limits<std::int32_t>::max());

        std::array<Place, 64> seen;
        std::size_t n_seen = 0;
        seen[n_seen++] = best;
        const auto consider = [&](Place p, std::int64_t numerator, std::int64_t denominator) {
            if (!is_valid(e_, p)) return;
            for (std::size_t i = 0; i < n_seen; ++i) {
                if (seen[i] == p) return;
            }
            if (n_seen < seen.size()) seen[n_seen++] = p;
            const std::int64_t limit = lowest * denominator / numerator;
            const std::int64_t found = cost(y, x, p, limit);
            if (found < limit) {
                lowest = found;
                best = p;
            }
        };
        for (const std::int32_t reach : {1, 2, 4}) {
            for (std::int32_t dy = -1; dy <= 1; ++dy) {
                for (std::int32_t dx = -1; dx <= 1; ++dx) {
                    const std::int32_t v = y + reach * dy, u = x + reach * dx;
                    if (v < 0 || v >= s_.rows || u < 0 || u >= s_.columns) continue;
                    const Place other = source_at(s_, v * s_.columns + u);
                    consider({other.row - reach * dy, other.column - reach * dx}, 1, 1);
                }
            }
        }
        for (std::int32_t k = 0; k < settings_.random_tries; ++k) {
            const std::uint32_t bits = random_bits(settings_.seed, static_cast<std::uint32_t>(pixel), 4 * static_cast<std::uint32_t>(k) + phase);
            const std::int32_t reach = std::max(e_.rows, e_.columns) >> k;
            if (reach == 0) break;
            const std::int32_t range = 2 * reach + 1;
            const auto dy = static_cast<std::int32_t>((bits & 0xffff) * static_cast<std::uint32_t>(range) >> 16) - reach;
            const auto dx = static_cast<std::int32_t>((bits >> 16) * static_cast<std::uint32_t>(range) >> 16) - reach;
            consider({best.row + dy, best.column + dx}, 9, 8);  // what continues no neighbour must be clearly better
        }
        next_[2 * pixel] = best.row;
        next_[2 * pixel + 1] = best.column;
    }

    const Exemplar& e_;
    const Synthesis& s_;
    const RefineSettings& settings_;
    int threads_;
    std::vector<std::int32_t> next_;
};

}  // namespace

void refine_sources(const Exemplar& exemplar, const Synthesis& synthesis, const RefineSettings& settings, int threads) {
    Refinement(exemplar, synthesis, settings, threads).run();
}

}  // namespace usdfoliage
