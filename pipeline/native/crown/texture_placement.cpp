#include <algorithm>
#include <cmath>
#include <cstdlib>

#include "geometry/grid_cut.h"
#include "parallel.h"
#include "crown/texture_places.h"

namespace usdfoliage {
namespace {

constexpr int kC = kTextureChannels;
constexpr std::size_t kLookedAround = 48;  // of the places on the grid that match best

// Sums over rectangles of a map.
class SummedArea {
  public:
    template <typename T>
    SummedArea(const T* values, std::int32_t rows, std::int32_t columns)
        : columns_(columns), sums_(static_cast<std::size_t>(rows + 1) * (columns + 1)) {
        for (std::int32_t y = 0; y < rows; ++y) {
            double along = 0;
            for (std::int32_t x = 0; x < columns; ++x) {
                along += values[y * columns + x];
                at(y + 1, x + 1) = at(y, x + 1) + along;
            }
        }
    }
    double sum(std::int32_t y0, std::int32_t x0, std::int32_t y1, std::int32_t x1) const {
        return at(y1, x1) - at(y0, x1) - at(y1, x0) + at(y0, x0);
    }

  private:
    double& at(std::int32_t y, std::int32_t x) { return sums_[static_cast<std::size_t>(y) * (columns_ + 1) + x]; }
    double at(std::int32_t y, std::int32_t x) const { return sums_[static_cast<std::size_t>(y) * (columns_ + 1) + x]; }
    std::int32_t columns_;
    std::vector<double> sums_;
};

struct Rectangle {
    std::int32_t row, column, rows, columns;
};

class Placement {
  public:
    Placement(const Exemplar& exemplar, const Synthesis& synthesis, const PlaceSettings& settings, int threads)
        : e_(exemplar),
          s_(synthesis),
          settings_(settings),
          threads_(threads),
          usage_(static_cast<std::size_t>(exemplar.rows) * exemplar.columns, 0.0f),
          valid_(exemplar.valid, exemplar.rows, exemplar.columns),
          variance_(variance()),
          whole_places_(find_candidates(settings.patch_px, settings.patch_px)) {
        for (std::int32_t i = 0; i < s_.rows * s_.columns; ++i) count(i, 1);
    }

    std::int32_t run() {
        if (whole_places_.empty()) return 0;
        std::int32_t placed = 0;
        for (const Rectangle& r : order()) placed += place(r);
        return placed;
    }

  private:
    // Mean over channels of the variance of what may be copied.
    double variance() const {
        double n = 0, sum[3] = {}, square[3] = {};
        for (std::int32_t i = 0; i < e_.rows * e_.columns; ++i) {
            if (!e_.valid[i]) continue;
            n += 1;
            for (int c = 0; c < 3; ++c) {
                const double v = e_.color[kC * i + c];
                sum[c] += v;
                square[c] += v * v;
            }
        }
        double total = 0;
        for (int c = 0; c < 3; ++c) total += square[c] / n - (sum[c] / n) * (sum[c] / n);
        return std::max(total / 3, 1.0);
    }

    void count(std::int32_t pixel, float times) {
        const Place p = source_at(s_, pixel);
        if (p.row >= 0) usage_[p.row * e_.columns + p.column] += times;
    }

    bool filled(std::int32_t pixel) const { return s_.source[2 * pixel] >= 0; }

    // Rectangles that cover the output, in the order in which they grow from what is filled already.
    std::vector<Rectangle> order() const {
        const std::int32_t patch = settings_.patch_px, step = patch - settings_.overlap_px;
        std::vector<std::uint8_t> start(static_cast<std::size_t>(s_.rows) * s_.columns);
        bool any = false;
        for (std::size_t i = 0; i < start.size(); ++i) any |= (start[i] = filled(static_cast<std::int32_t>(i)));
        if (!any) start[random_bits(settings_.seed, 1, 0) % start.size()] = 1;
        const std::vector<float> distance = distances(start);

        std::vector<std::pair<float, Rectangle>> cells;
        const auto shift_row = static_cast<std::int32_t>(random_bits(settings_.seed, 2, 0) % step);
        const auto shift_column = static_cast<std::int32_t>(random_bits(settings_.seed, 3, 0) % step);
        std::uint32_t index = 0;
        for (std::int32_t y = -shift_row - settings_.overlap_px; y < s_.rows; y += step) {
            for (std::int32_t x = -shift_column - settings_.overlap_px; x < s_.columns; x += step, ++index) {
                // Rows of patches would show: every patch is moved by up to a quarter of its overlap.
                const std::int32_t reach = settings_.overlap_px / 4, range = 2 * reach + 1;
                const std::int32_t top = y + static_cast<std::int32_t>(random_bits(settings_.seed, 4, index) % range) - reach;
                const std::int32_t left = x + static_cast<std::int32_t>(random_bits(settings_.seed, 5, index) % range) - reach;
                const std::int32_t y0 = std::max(top, 0), x0 = std::max(left, 0);
                const std::int32_t y1 = std::min(top + patch, s_.rows), x1 = std::min(left + patch, s_.columns);
                if (y0 >= y1 || x0 >= x1) continue;
                const float away = distance[(y0 + y1) / 2 * s_.columns + (x0 + x1) / 2];
                cells.push_back({away, {y0, x0, y1 - y0, x1 - x0}});
            }
        }
        std::stable_sort(cells.begin(), cells.end(), [](const auto& a, const auto& b) { return a.first < b.first; });
        std::vector<Rectangle> rectangles;
        for (const auto& cell : cells) rectangles.push_back(cell.second);
        return rectangles;
    }

    // Distance of every pixel from the start, by two sweeps of a chamfer.
    std::vector<float> distances(const std::vector<std::uint8_t>& start) const {
        constexpr float kFar = 1e9f, kDiagonal = 1.41421356f;
        std::vector<float> d(start.size());
        for (std::size_t i = 0; i < d.size(); ++i) d[i] = start[i] ? 0 : kFar;
        const auto relax = [&](std::int32_t y, std::int32_t x, std::int32_t dy, std::int32_t dx, float cost) {
            if (y + dy < 0 || y + dy >= s_.rows || x + dx < 0 || x + dx >= s_.columns) return;
            float& here = d[y * s_.columns + x];
            here = std::min(here, d[(y + dy) * s_.columns + x + dx] + cost);
        };
        for (std::int32_t y = 0; y < s_.rows; ++y) {
            for (std::int32_t x = 0; x < s_.columns; ++x) {
                relax(y, x, 0, -1, 1), relax(y, x, -1, 0, 1);
                relax(y, x, -1, -1, kDiagonal), relax(y, x, -1, 1, kDiagonal);
            }
        }
        for (std::int32_t y = s_.rows; y-- > 0;) {
            for (std::int32_t x = s_.columns; x-- > 0;) {
                relax(y, x, 0, 1, 1), relax(y, x, 1, 0, 1);
                relax(y, x, 1, 1, kDiagonal), relax(y, x, 1, -1, kDiagonal);
            }
        }
        return d;
    }

    std::vector<Place> find_candidates(std::int32_t rows, std::int32_t columns) const {
        std::vector<Place> places;
        for (std::int32_t y = 0; y + rows <= e_.rows; ++y) {
            for (std::int32_t x = 0; x + columns <= e_.columns; ++x) {
                if (valid_.sum(y, x, y + rows, x + columns) == rows * columns) places.push_back({y, x});
            }
        }
        return places;
    }

    // A run of pixels of a rectangle that are filled.
    struct Span {
        std::int32_t row, column, pixels;
    };

    std::vector<Span> filled_spans(const Rectangle& r) const {
        std::vector<Span> spans;
        for (std::int32_t y = 0; y < r.rows; ++y) {
            for (std::int32_t x = 0; x < r.columns;) {
                const std::int32_t start = x;
                while (x < r.columns && filled((r.row + y) * s_.columns + r.column + x)) ++x;
                if (x > start) spans.push_back({y, start, x - start});
                else ++x;
            }
        }
        return spans;
    }

    bool place(const Rectangle& r) {
        const std::vector<Span> spans = filled_spans(r);
        std::int32_t n_filled = 0;
        for (const Span& span : spans) n_filled += span.pixels;
        if (n_filled == r.rows * r.columns) return false;

        const std::vector<Choice> choices = choose(r, spans, n_filled);
        std::vector<Cut> cuts(choices.size());
        parallel_for(choices.size(), threads_, [&](std::size_t i) { cuts[i] = seam(r, choices[i].place); });
        double mean = 0;
        for (const Cut& cut : cuts) mean += cut.cost / static_cast<double>(cuts.size());
        const auto price = [&](std::size_t i) { return (cuts[i].cost + 0.01 * mean) * (1 + choices[i].usage); };
        std::size_t best = 0;
        for (std::size_t i = 1; i < cuts.size(); ++i) {
            if (price(i) < price(best)) best = i;
        }
        paste(r, choices[best].place, cuts[best].taken);
        return true;
    }

    struct Choice {
        Place place;
        double usage, price;
    };

    // How far from where they lie the filled pixels of a rectangle were copied.
    std::vector<Place> shifts_of(const Rectangle& r, const std::vector<Span>& spans) const {
        std::vector<Place> shifts;
        for (const Span& span : spans) {
            for (std::int32_t x = span.column; x < span.column + span.pixels; ++x) {
                const std::int32_t row = r.row + span.row, column = r.column + x, pixel = row * s_.columns + column;
                if (s_.known[pixel]) continue;
                const Place from = source_at(s_, pixel), shift{from.row - row, from.column - column};
                if (std::find(shifts.rbegin(), shifts.rend(), shift) == shifts.rend()) shifts.push_back(shift);
            }
        }
        return shifts;
    }

    // The step of a grid on which no more than max_places of so many places lie.
    std::int32_t step_of(std::size_t places) const {
        std::int32_t step = 1;
        while (places > static_cast<std::size_t>(settings_.max_places) * step * step) ++step;
        return step;
    }

    // The places that fit best into a rectangle, no two of them the same but for a pixel.
    std::vector<Choice> choose(const Rectangle& r, const std::vector<Span>& spans, std::int32_t n_filled) const {
        const bool whole = r.rows == settings_.patch_px && r.columns == settings_.patch_px;
        const std::vector<Place> of_part = whole ? std::vector<Place>{} : find_candidates(r.rows, r.columns);
        const std::vector<Place>& places = whole ? whole_places_ : of_part;
        const auto stamp = static_cast<std::uint32_t>(r.row * s_.columns + r.column);
        const auto threshold = static_cast<std::uint32_t>(settings_.candidate_share * 4294967295.0);
        const std::vector<Place> shifts = shifts_of(r, spans);
        const auto continues = [&](Place p) {
            return std::any_of(shifts.begin(), shifts.end(), [&](Place s) {
                return std::abs(p.row - r.row - s.row) <= 2 && std::abs(p.column - r.column - s.column) <= 2;
            });
        };
        const auto tried = [&](std::size_t i) {
            return random_bits(settings_.seed ^ stamp, 6, static_cast<std::uint32_t>(i)) <= threshold &&
                   !(continues(places[i]) && places.size() > 1);
        };
        const std::int32_t step = step_of(places.size());
        const auto shift_row = static_cast<std::int32_t>(random_bits(settings_.seed ^ stamp, 7, 0) % step);
        const auto shift_column = static_cast<std::int32_t>(random_bits(settings_.seed ^ stamp, 8, 0) % step);
        std::vector<Choice> choices;
        for (std::size_t i = 0; i < places.size(); ++i) {
            const bool on_grid = (places[i].row + shift_row) % step == 0 && (places[i].column + shift_column) % step == 0;
            if (on_grid && tried(i)) choices.push_back({places[i], 0, 0});
        }
        if (step > 1 && choices.empty()) {  // none of a few places may lie on the grid
            for (std::size_t i = 0; i < places.size(); ++i) {
                if (tried(i)) choices.push_back({places[i], 0, 0});
            }
        }
        const SummedArea usage(usage_.data(), e_.rows, e_.columns);
        const std::vector<float> near_map = usage_near(r);
        const SummedArea near(near_map.data(), e_.rows, e_.columns);
        const double area = static_cast<double>(r.rows) * r.columns;
        const auto set_price = [&](Choice& choice) {
            const Place p = choice.place;
            choice.usage = (settings_.usage_weight * usage.sum(p.row, p.column, p.row + r.rows, p.column + r.columns) +
                            settings_.near_weight * near.sum(p.row, p.column, p.row + r.rows, p.column + r.columns)) / area;
            std::int64_t sum = 0;
            for (const Span& span : spans) {
                sum += squared_difference(patch_color(p, span.row, span.column),
                                          s_.color + kC * ((r.row + span.row) * s_.columns + r.column + span.column),
                                          kC * span.pixels);
            }
            // A perfect match may be used again and again; where nothing matches yet, usage alone counts.
            constexpr double kFloor = 0.01;
            choice.price = (static_cast<double>(sum) / (3.0 * std::max(n_filled, 1) * variance_) + kFloor) * (1 + choice.usage);
        };
        const auto set_prices = [&](std::vector<Choice>& of) {
            constexpr std::size_t kChunk = 256;
            parallel_for((of.size() + kChunk - 1) / kChunk, threads_, [&](std::size_t chunk) {
                for (std::size_t i = chunk * kChunk; i < std::min(of.size(), (chunk + 1) * kChunk); ++i) set_price(of[i]);
            });
            std::stable_sort(of.begin(), of.end(), [](const Choice& a, const Choice& b) { return a.price < b.price; });
        };
        set_prices(choices);
        if (step > 1) {
            std::vector<std::uint8_t> around(static_cast<std::size_t>(e_.rows) * e_.columns);
            for (std::size_t i = 0; i < std::min<std::size_t>(choices.size(), kLookedAround); ++i) {
                const Place p = choices[i].place;
                for (std::int32_t y = std::max(p.row - step + 1, 0); y < std::min(p.row + step, e_.rows); ++y) {
                    for (std::int32_t x = std::max(p.column - step + 1, 0); x < std::min(p.column + step, e_.columns); ++x) {
                        around[y * e_.columns + x] = 1;
                    }
                }
            }
            choices.clear();  // those that were best are around themselves
            for (std::size_t i = 0; i < places.size(); ++i) {
                if (around[places[i].row * e_.columns + places[i].column] && tried(i)) choices.push_back({places[i], 0, 0});
            }
            set_prices(choices);
        }
        std::vector<Choice> best;
        const auto wanted = static_cast<std::size_t>(spans.empty() ? 1 : settings_.cuts);
        for (std::size_t i = 0; i < choices.size() && best.size() < wanted; ++i) {
            const auto same = [&](const Choice& other) {
                return std::abs(other.place.row - choices[i].place.row) <= 1 && std::abs(other.place.column - choices[i].place.column) <= 1;
            };
            if (std::none_of(best.begin(), best.end(), same)) best.push_back(choices[i]);
        }
        return best;
    }

    // How often each place of the exemplar is used within two patches of a rectangle.
    std::vector<float> usage_near(const Rectangle& r) const {
        std::vector<float> times(usage_.size());
        const std::int32_t reach = 2 * settings_.patch_px;
        for (std::int32_t y = std::max(r.row - reach, 0); y < std::min(r.row + r.rows + reach, s_.rows); ++y) {
            for (std::int32_t x = std::max(r.column - reach, 0); x < std::min(r.column + r.columns + reach, s_.columns); ++x) {
                const Place p = source_at(s_, y * s_.columns + x);
                if (p.row >= 0) times[p.row * e_.columns + p.column] += 1;
            }
        }
        return times;
    }

    void paste(const Rectangle& r, Place place, const std::vector<std::uint8_t>& taken) {
        for (std::int32_t y = 0, k = 0; y < r.rows; ++y) {
            for (std::int32_t x = 0; x < r.columns; ++x, ++k) {
                const std::int32_t pixel = (r.row + y) * s_.columns + r.column + x;
                if (!taken[k] || s_.known[pixel]) continue;
                count(pixel, -1);
                s_.source[2 * pixel] = place.row + y;
                s_.source[2 * pixel + 1] = place.column + x;
                count(pixel, 1);
                for (int c = 0; c < kC; ++c) s_.color[kC * pixel + c] = patch_color(place, y, x)[c];
            }
        }
    }

    const std::int16_t* patch_color(Place place, std::int32_t y, std::int32_t x) const {
        return e_.color + kC * ((place.row + y) * e_.columns + place.column + x);
    }

    struct Cut {
        std::vector<std::uint8_t> taken;  // 1 where a rectangle takes the patch
        double cost;
    };

    // What a rectangle takes of a patch: what is empty, and what a minimum cut gives it of the rest.
    Cut seam(const Rectangle& r, Place place) const {
        constexpr std::int32_t kEnd = 1 << 28;
        const std::size_t n = static_cast<std::size_t>(r.rows) * r.columns;
        std::vector<std::int32_t> down(n), right(n), terminal(n);
        for (std::int32_t y = 0, k = 0; y < r.rows; ++y) {
            for (std::int32_t x = 0; x < r.columns; ++x, ++k) {
                const std::int32_t row = r.row + y, column = r.column + x, pixel = row * s_.columns + column;
                const bool rim = (y == 0 && row > 0 && filled(pixel - s_.columns)) ||
                                 (x == 0 && column > 0 && filled(pixel - 1)) ||
                                 (y == r.rows - 1 && row < s_.rows - 1 && filled(pixel + s_.columns)) ||
                                 (x == r.columns - 1 && column < s_.columns - 1 && filled(pixel + 1));
                if (!filled(pixel)) terminal[k] = -kEnd;
                else if (s_.known[pixel] || rim) terminal[k] = kEnd;
                if (y + 1 < r.rows) down[k] = step_cost(r, place, y, x, 1, 0);
                if (x + 1 < r.columns) right[k] = step_cost(r, place, y, x, 0, 1);
            }
        }
        Cut cut{cut_grid(down.data(), right.data(), terminal.data(), static_cast<std::size_t>(r.rows),
                         static_cast<std::size_t>(r.columns)),
                0};
        for (std::int32_t y = 0, k = 0; y < r.rows; ++y) {
            for (std::int32_t x = 0; x < r.columns; ++x, ++k) {
                if (y + 1 < r.rows && cut.taken[k] != cut.taken[k + r.columns]) cut.cost += down[k];
                if (x + 1 < r.columns && cut.taken[k] != cut.taken[k + 1]) cut.cost += right[k];
            }
        }
        return cut;
    }

    std::int32_t step_cost(const Rectangle& r, Place place, std::int32_t y, std::int32_t x, std::int32_t dy,
                           std::int32_t dx) const {
        const std::int32_t pixel = (r.row + y) * s_.columns + r.column + x, next = pixel + dy * s_.columns + dx;
        if (!filled(pixel) && !filled(next)) return 0;
        const auto length = [](const std::int16_t* u, const std::int16_t* v) {
            return std::sqrt(static_cast<float>(squared_difference(u, v, kC)));
        };
        const std::int16_t *a = s_.color + kC * pixel, *a_next = s_.color + kC * next;
        const std::int16_t *b = patch_color(place, y, x), *b_next = patch_color(place, y + dy, x + dx);
        // Where only one of the two pixels overlaps, it speaks for the other.
        const bool both = filled(pixel) && filled(next);
        const float here = filled(pixel) ? length(a, b) : length(a_next, b_next);
        const float there = filled(next) ? length(a_next, b_next) : length(a, b);
        const float step_of_patch = length(b, b_next);
        const float step = both ? length(a, a_next) : step_of_patch;
        constexpr float kFloor = 50;  // of the gradients, in steps of colour; flat ground has no finer ones
        const float cost = (here + there) / (2 * (step + step_of_patch) + kFloor);
        return 1 + static_cast<std::int32_t>(cost * 10000);
    }

    const Exemplar& e_;
    const Synthesis& s_;
    const PlaceSettings& settings_;
    int threads_;
    std::vector<float> usage_;
    SummedArea valid_;
    double variance_;
    std::vector<Place> whole_places_;  // where a whole patch can be copied from
};

}  // namespace

std::int32_t place_patches(const Exemplar& exemplar, const Synthesis& synthesis, const PlaceSettings& settings,
                           int threads) {
    return Placement(exemplar, synthesis, settings, threads).run();
}

}  // namespace usdfoliage
