#include "geometry/grid_cut.h"

#include <algorithm>
#include <deque>
#include <limits>

namespace usdfoliage {
namespace {

// Where a node hangs in its tree: by one of its four arcs, on its terminal, as an orphan, or in no tree.
enum : std::int8_t { kTerminal = 4, kOrphan = 5, kFree = 6 };

// The arc opposite to left, right, up, down = 0, 1, 2, 3.
constexpr int opposite(int arc) { return arc ^ 1; }

class GridCut {
  public:
    GridCut(const std::int32_t* down, const std::int32_t* right, const std::int32_t* terminal, std::size_t rows,
            std::size_t columns)
        : rows_(static_cast<std::int32_t>(rows)),
          columns_(static_cast<std::int32_t>(columns)),
          capacity_(4 * rows * columns),
          terminal_(terminal, terminal + rows * columns),
          parent_(rows * columns, kFree),
          second_(rows * columns, 0),
          queued_(rows * columns, 0),
          stamp_(rows * columns, 0),
          distance_(rows * columns, 0) {
        const std::int32_t n = rows_ * columns_;
        for (std::int32_t i = 0; i < n; ++i) {
            capacity_[4 * i + 1] = right[i];
            capacity_[4 * neighbour(i, 1)] = right[i];
            capacity_[4 * i + 3] = down[i];
            capacity_[4 * neighbour(i, 3) + 2] = down[i];
        }
        for (std::int32_t i = 0; i < n; ++i) {
            if (terminal_[i] == 0) continue;
            second_[i] = terminal_[i] < 0;
            parent_[i] = kTerminal;
            distance_[i] = 1;
            activate(i);
        }
    }

    std::vector<std::uint8_t> solve() {
        for (std::int32_t i = next_active(); i >= 0; i = next_active()) {
            // A node stays the current one for as long as it finds paths.
            while (parent_[i] != kFree) {
                const int arc = grow(i);
                if (arc < 0) break;
                ++time_;
                augment(i, arc);
                adopt();
            }
        }
        std::vector<std::uint8_t> side(parent_.size());
        for (std::size_t i = 0; i < side.size(); ++i) side[i] = parent_[i] == kFree || second_[i];
        return side;
    }

  private:
    std::int32_t neighbour(std::int32_t i, int arc) const {
        switch (arc) {
            case 0: return i % columns_ ? i - 1 : i + columns_ - 1;
            case 1: return (i + 1) % columns_ ? i + 1 : i + 1 - columns_;
            case 2: return i >= columns_ ? i - columns_ : i + (rows_ - 1) * columns_;
            default: return i + columns_ < rows_ * columns_ ? i + columns_ : i - (rows_ - 1) * columns_;
        }
    }

    // What may still flow between a tree's node and its neighbour, away from the first end, towards the second.
    std::int32_t residual(bool of_second, std::int32_t i, std::int32_t j, int arc) const {
        return of_second ? capacity_[4 * j + opposite(arc)] : capacity_[4 * i + arc];
    }

    void activate(std::int32_t i) {
        if (queued_[i]) return;
        queued_[i] = 1;
        active_.push_back(i);
    }

    std::int32_t next_active() {
        while (!active_.empty()) {
            const std::int32_t i = active_.front();
            active_.pop_front();
            queued_[i] = 0;
            if (parent_[i] != kFree) return i;
        }
        return -1;
    }

    // Extend the tree of a node to its neighbours; the arc by which it touches the other tree, -1 where it does not.
    int grow(std::int32_t i) {
        for (int arc = 0; arc < 4; ++arc) {
            const std::int32_t j = neighbour(i, arc);
            if (residual(second_[i], i, j, arc) == 0) continue;
            if (parent_[j] == kFree) {
                second_[j] = second_[i];
                parent_[j] = static_cast<std::int8_t>(opposite(arc));
                stamp_[j] = stamp_[i];
                distance_[j] = distance_[i] + 1;
                activate(j);
            } else if (second_[j] != second_[i]) {
                return arc;
            } else if (stamp_[j] <= stamp_[i] && distance_[j] > distance_[i] + 1) {
                parent_[j] = static_cast<std::int8_t>(opposite(arc));  // a shorter way to the terminal
                stamp_[j] = stamp_[i];
                distance_[j] = distance_[i] + 1;
            }
        }
        return -1;
    }

    void augment(std::int32_t i, int arc) {
        std::int32_t j = neighbour(i, arc);
        if (second_[i]) {
            std::swap(i, j);
            arc = opposite(arc);
        }
        const std::int32_t flow = std::min({capacity_[4 * i + arc], bottleneck(i), bottleneck(j)});
        capacity_[4 * i + arc] -= flow;
        capacity_[4 * j + opposite(arc)] += flow;
        push(i, flow);
        push(j, flow);
    }

    std::int32_t bottleneck(std::int32_t i) const {
        std::int32_t narrowest = std::numeric_limits<std::int32_t>::max();
        for (; parent_[i] != kTerminal;) {
            const std::int32_t up = neighbour(i, parent_[i]);
            narrowest = std::min(narrowest, residual(second_[i], up, i, opposite(parent_[i])));
            i = up;
        }
        return std::min(narrowest, second_[i] ? -terminal_[i] : terminal_[i]);
    }

    void push(std::int32_t i, std::int32_t flow) {
        while (parent_[i] != kTerminal) {
            const int arc = parent_[i];
            const std::int32_t up = neighbour(i, arc);
            const std::int32_t along = second_[i] ? -flow : flow;
            capacity_[4 * up + opposite(arc)] -= along;
            capacity_[4 * i + arc] += along;
            if (residual(second_[i], up, i, opposite(arc)) == 0) orphan(i);
            i = up;
        }
        terminal_[i] += second_[i] ? flow : -flow;
        if (terminal_[i] == 0) orphan(i);
    }

    void orphan(std::int32_t i) {
        parent_[i] = kOrphan;
        orphans_.push_back(i);
    }

    // Nodes between a node and its terminal, 0 where the way ends at an orphan.
    std::int32_t rooted_distance(std::int32_t i) {
        std::int32_t steps = 0, at = i;
        for (;; ++steps) {
            if (stamp_[at] == time_) {
                steps += distance_[at];
                break;
            }
            if (parent_[at] == kTerminal) {
                stamp_[at] = time_;
                distance_[at] = 1;
                ++steps;
                break;
            }
            if (parent_[at] == kOrphan) return 0;
            at = neighbour(at, parent_[at]);
        }
        const std::int32_t distance = steps;
        for (at = i; stamp_[at] != time_; at = neighbour(at, parent_[at])) {
            stamp_[at] = time_;
            distance_[at] = steps--;
        }
        return distance;
    }

    // Find new parents for the nodes that a saturated arc cut off; let go those that have none.
    void adopt() {
        while (!orphans_.empty()) {
            const std::int32_t i = orphans_.front();
            orphans_.pop_front();
            int best_arc = -1;
            std::int32_t best = std::numeric_limits<std::int32_t>::max();
            for (int arc = 0; arc < 4; ++arc) {
                const std::int32_t j = neighbour(i, arc);
                if (parent_[j] == kFree || second_[j] != second_[i] || residual(second_[i], j, i, opposite(arc)) == 0) continue;
                const std::int32_t distance = rooted_distance(j);
                if (distance > 0 && distance < best) {
                    best = distance;
                    best_arc = arc;
                }
            }
            if (best_arc >= 0) {
                parent_[i] = static_cast<std::int8_t>(best_arc);
                stamp_[i] = time_;
                distance_[i] = best + 1;
                continue;
            }
            for (int arc = 0; arc < 4; ++arc) {
                const std::int32_t j = neighbour(i, arc);
                if (parent_[j] == kFree || second_[j] != second_[i]) continue;
                if (residual(second_[i], j, i, opposite(arc)) != 0) activate(j);
                if (parent_[j] == opposite(arc)) orphan(j);
            }
            parent_[i] = kFree;
        }
    }

    std::int32_t rows_, columns_;
    std::vector<std::int32_t> capacity_;  // 4 a node
    std::vector<std::int32_t> terminal_;
    std::vector<std::int8_t> parent_;
    std::vector<std::uint8_t> second_;  // which tree
    std::vector<std::uint8_t> queued_;
    std::vector<std::int32_t> stamp_, distance_;  // to the terminal, and when that was known
    std::deque<std::int32_t> active_, orphans_;
    std::int32_t time_ = 1;
};

}  // namespace

std::vector<std::uint8_t> cut_grid(const std::int32_t* down, const std::int32_t* right, const std::int32_t* terminal,
                                   std::size_t rows, std::size_t columns) {
    return GridCut(down, right, terminal, rows, columns).solve();
}

}  // namespace usdfoliage
