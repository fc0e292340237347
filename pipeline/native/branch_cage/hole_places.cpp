#include "branch_cage/hole_places.h"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "branch_cage/hole_columns.h"

namespace usdfoliage {
namespace {

// A stretch of a tube that holes share, or, without members, one that has no room for any.
struct Block {
    double low, high;
    std::vector<std::size_t> members;
};

// The best place so far: its cost, its block or none for a new one, its middle and how much the hole is pressed.
struct Place {
    double cost = 0;
    std::ptrdiff_t block = -1;
    double middle = 0;
    double press = 0;
    bool found = false;

    void better(double new_cost, std::ptrdiff_t new_block, double new_middle, double new_press) {
        if (!found || new_cost < cost) *this = {new_cost, new_block, new_middle, new_press, true};
    }
};

class Placer {
  public:
    Placer(const HoleTubes& tubes, std::vector<HoleWant> wants, const HoleSettings& settings)
        : tubes_(tubes),
          wants_(std::move(wants)),
          settings_(settings),
          gone_(tubes.gone, tubes.gone + tubes.n_tubes) {}

    HolePlacement place() {
        for (std::size_t tube = 0; tube < tubes_.n_tubes; ++tube) place_along(tube);
        return std::move(result_);
    }

  private:
    // Places along one tube, in the order of its wants.
    void place_along(std::size_t tube) {
        std::vector<std::size_t> own(static_cast<std::size_t>(tubes_.want_first[tube + 1] - tubes_.want_first[tube]));
        std::iota(own.begin(), own.end(), static_cast<std::size_t>(tubes_.want_first[tube]));
        if (gone_[tube]) {
            for (const std::size_t want : own) gone_[static_cast<std::size_t>(tubes_.want_tube[want])] = 1;
            own.clear();
        }
        std::vector<Block> blocks;
        if (!own.empty())
            for (std::int64_t k = tubes_.steep_first[tube]; k < tubes_.steep_first[tube + 1]; ++k)
                blocks.push_back({tubes_.steep[2 * k], tubes_.steep[2 * k + 1], {}});
        for (const std::size_t want : own) {
            const double gap = 0.25 * wants_[want].parent_radius;
            if (!place_one(want, blocks, tubes_.start[tube] + gap, tubes_.end[tube] - gap, gap)) {
                result_.homeless.push_back(static_cast<std::int64_t>(want));
                gone_[static_cast<std::size_t>(tubes_.want_tube[want])] = 1;
            }
        }
        blocks.erase(std::remove_if(blocks.begin(), blocks.end(), [](const Block& block) { return block.members.empty(); }),
                     blocks.end());
        double phase = tubes_.phase[tube];
        std::vector<BlockColumns> arranged;
        for (const Block& block : blocks) {
            arranged.push_back(arrange_columns(wants_, block.members, phase, settings_.min_column_rad));
            phase = mean_turn(arranged.back().middle);
            add_block(tube, block, arranged.back());
        }
        add_turns(tube, blocks, arranged);
    }

    // Put a hole into the nearest block that has a sector for it, or into a new one where there is room.
    //
    // Blocks are in order along the tube, do not overlap, and stay so.
    bool place_one(std::size_t number, std::vector<Block>& blocks, double low, double high, double gap) {
        HoleWant& want = wants_[number];
        Place best;
        for (const double press : {1.0, 0.75, 0.5, settings_.tightest}) {
            const double half = press * want.half_block;
            for (std::size_t k = 0; k <= blocks.size(); ++k) {  // the free stretch before each block, and the last
                const double floor = k ? blocks[k - 1].high : low - gap;
                const double roof = k < blocks.size() ? blocks[k].low : high + gap;
                if (roof - floor < 2 * (half + gap)) continue;
                const double middle = std::min(std::max(want.arc, floor + gap + half), roof - gap - half);
                best.better(std::abs(middle - want.arc), -1, middle, press);
            }
            for (std::size_t k = 0; k < blocks.size(); ++k) join(number, blocks, k, low, high, gap, press, best);
            // Rather a little out of place than a hole pressed flat.
            if (best.found && best.cost <= 2 * want.half_block + 2 * want.parent_radius) break;
        }
        if (!best.found) return false;
        want.arc = best.middle;
        const double half = best.press * want.half_block;
        want.half_along *= best.press;
        if (best.press < 1) want.half_across *= std::sqrt(best.press);
        auto chosen = blocks.begin() + best.block;
        if (best.block < 0) {
            const Block made{want.arc - half, want.arc + half, {}};
            const auto after = std::upper_bound(blocks.begin(), blocks.end(), made,
                                                [](const Block& a, const Block& b) { return a.low < b.low; });
            chosen = blocks.insert(after, made);
        }
        chosen->low = std::min(chosen->low, want.arc - half);
        chosen->high = std::max(chosen->high, want.arc + half);
        chosen->members.push_back(number);
        return true;
    }

    // What it costs to take the hole into a block. A block may grow towards it, but stays about as long as its longest.
    void join(std::size_t number, const std::vector<Block>& blocks, std::size_t k, double low, double high, double gap,
              double press, Place& best) const {
        const HoleWant& want = wants_[number];
        const Block& block = blocks[k];
        const double half = press * want.half_block, max_extent = 1.6 * std::max(block.high - block.low, 2 * half);
        const double away = std::max(block.low - want.arc, want.arc - block.high) - max_extent;
        if ((best.found && away > best.cost) || !has_room(wants_, block.members, number, settings_.min_column_rad)) return;
        const double floor = k ? std::max(low, blocks[k - 1].high + gap) : low;
        const double roof = k + 1 < blocks.size() ? std::min(high, blocks[k + 1].low - gap) : high;
        const double grow_low = std::max(floor, block.high - max_extent), grow_high = std::min(roof, block.low + max_extent);
        if (grow_high - grow_low < 2 * half) return;
        double middle = std::min(std::max(want.arc, grow_low + half), grow_high - half);
        if (std::max(block.high, middle + half) - std::min(block.low, middle - half) > max_extent * (1 + 1e-9)) {
            if (block.high - block.low < 2 * half) return;
            middle = std::min(std::max(want.arc, block.low + half), block.high - half);
        }
        // Rings that a thick branch has already bent are no good place for another.
        double thickest = 0;
        for (const std::size_t member : block.members) thickest = std::max(thickest, wants_[member].half_across);
        best.better(std::abs(middle - want.arc) + thickest, static_cast<std::ptrdiff_t>(k), middle, press);
    }

    void add_block(std::size_t tube, const Block& block, const BlockColumns& columns) {
        const auto number = static_cast<std::int64_t>(result_.block_tube.size());
        result_.block_tube.push_back(static_cast<std::int64_t>(tube));
        for (const double arc : {block.low, (block.low + block.high) / 2, block.high}) result_.block_arcs.push_back(arc);
        for (std::size_t k = 0; k < block.members.size(); ++k) {
            const HoleWant& want = wants_[block.members[k]];
            result_.want.push_back(static_cast<std::int64_t>(block.members[k]));
            result_.block.push_back(number);
            result_.sector.push_back(columns.sectors[k]);
            result_.arc.push_back(want.arc);
            result_.azimuth.push_back(want.azimuth);
            result_.half_along.push_back(want.half_along);
            result_.half_across.push_back(want.half_across);
        }
    }

    // Column angles at arcs of one tube: those of the blocks, even between them where that is far enough.
    void add_turns(std::size_t tube, const std::vector<Block>& blocks, const std::vector<BlockColumns>& arranged) {
        const double phase = tubes_.phase[tube], start = tubes_.start[tube];
        if (blocks.empty()) {
            add_turn(tube, start, even_columns(std::isnan(phase) ? 0.0 : phase));
            return;
        }
        double before = start;
        if (!std::isnan(phase)) add_turn(tube, start, even_columns(phase));
        for (std::size_t k = 0; k < blocks.size(); ++k) {
            const Block& block = blocks[k];
            double thickest = 0;
            for (const std::size_t member : block.members) thickest = std::max(thickest, wants_[member].parent_radius);
            const double relaxed = settings_.relaxed * thickest;
            const Columns6 even = even_columns(mean_turn(arranged[k].middle));
            if (block.low - relaxed > before) add_turn(tube, block.low - relaxed, even);
            add_turn(tube, block.low, arranged[k].ends);
            add_turn(tube, (block.low + block.high) / 2, arranged[k].middle);
            add_turn(tube, block.high, arranged[k].ends);
            const double after = k + 1 < blocks.size() ? blocks[k + 1].low : tubes_.length[tube];
            if (block.high + relaxed < after) add_turn(tube, block.high + relaxed, even);
            before = block.high + relaxed;
        }
    }

    void add_turn(std::size_t tube, double arc, const Columns6& angles) {
        result_.turn_tube.push_back(static_cast<std::int64_t>(tube));
        result_.turn_arc.push_back(arc);
        result_.turn_angles.insert(result_.turn_angles.end(), angles.begin(), angles.end());
    }

    const HoleTubes& tubes_;
    std::vector<HoleWant> wants_;
    HoleSettings settings_;
    std::vector<std::uint8_t> gone_;
    HolePlacement result_;
};

}  // namespace

HolePlacement place_holes(const HoleTubes& tubes, std::vector<HoleWant> wants, const HoleSettings& settings) {
    return Placer(tubes, std::move(wants), settings).place();
}

}  // namespace usdfoliage
