#include "tube_exits.h"

#include <algorithm>
#include <cmath>

#include "parallel.h"

namespace usdfoliage {
namespace {

constexpr std::size_t kBlock = 64;  // walks of one task

class Walker {
  public:
    Walker(const TubeAxes& axes, const ExitWalk& how, std::int64_t tube, std::int64_t parent, double clearance,
           std::int64_t& at)
        : axes_(axes), how_(how), tube_(tube), parent_(parent), clearance_(clearance), at_(at) {}

    bool walk(double& arc) {
        const double end = tube_length(axes_, tube_);
        for (int step = 0; step < how_.most_steps; ++step) {
            const TubePlace own = tube_axis(axes_, tube_, arc), near = nearest(own.point);
            const TubeVector offset = between(near.point, own.point);
            const double distance = length(offset);
            double missing = near.radius - distance;
            if (how_.whole_disc) {
                const double radius = std::min(own.radius, how_.thickest * near.radius);
                const double along = dot(offset, tube_tangent(axes_, tube_, arc, 0.5 * radius)) / std::max(distance, 1e-300);
                const double sideways = std::sqrt(std::clamp(1 - along * along, 0.0, 1.0));
                missing = how_.cage_factor * (near.radius + sideways * radius) + clearance_ * radius - distance;
            }
            // A straight way out is met exactly, or just not.
            if (missing <= how_.skin * near.radius) return true;
            if (arc >= end) return false;
            // No point nearer than what is missing can be outside: the distance grows at most as fast as the arc.
            arc = std::min(arc + std::max(how_.whole_disc ? 0.6 * missing : missing, 0.04 * near.radius), end);
        }
        return false;
    }

  private:
    double step_at(std::int64_t at) const { return axes_.arc[at + 1] - axes_.arc[at]; }

    double share_of(const TubeVector& place, std::int64_t at) const {
        return dot(between(vector_at(axes_.points, at), place), vector_at(axes_.direction, at)) / step_at(at);
    }

    double distance_to(const TubeVector& place, std::int64_t at) const {
        TubeVector offset = between(vector_at(axes_.points, at), place);
        const TubeVector way = vector_at(axes_.direction, at);
        const double along = std::clamp(dot(offset, way), 0.0, step_at(at));
        for (std::size_t k = 0; k < 3; ++k) offset[k] -= along * way[k];
        return length(offset);
    }

    // The place of the parent next to a point, from where the last one was.
    TubePlace nearest(const TubeVector& place) const {
        const std::int64_t low = axes_.first[parent_], high = low + axes_.counts[parent_] - 2;
        for (int step = 0; step < how_.most_steps; ++step) {
            const double share = share_of(place, at_);
            const std::int64_t next = share > 1 && at_ < high ? at_ + 1 : share < 0 && at_ > low ? at_ - 1 : at_;
            // Only to a neighbour that is nearer, or a corner would be stepped over for ever.
            if (next == at_ || !(distance_to(place, next) < distance_to(place, at_))) break;
            at_ = next;
        }
        const double share = std::clamp(share_of(place, at_), 0.0, 1.0);
        const TubeVector start = vector_at(axes_.points, at_), way = vector_at(axes_.direction, at_);
        const double along = share * step_at(at_);
        return {{start[0] + along * way[0], start[1] + along * way[1], start[2] + along * way[2]},
                axes_.radius[at_] + share * (axes_.radius[at_ + 1] - axes_.radius[at_])};
    }

    const TubeAxes& axes_;
    const ExitWalk& how_;
    std::int64_t tube_, parent_;
    double clearance_;
    std::int64_t& at_;
};

}  // namespace

void walk_out(const TubeAxes& axes, const std::int64_t* tube, const std::int64_t* parent, const double* clearance,
              std::size_t n, const ExitWalk& how, std::int64_t* at, double* arc, std::uint8_t* done, int threads) {
    parallel_for((n + kBlock - 1) / kBlock, threads, [&](std::size_t block) {
        for (std::size_t k = block * kBlock; k < std::min(n, (block + 1) * kBlock); ++k)
            done[k] = Walker(axes, how, tube[k], parent[k], clearance[k], at[k]).walk(arc[k]) ? 1 : 0;
    });
}

}  // namespace usdfoliage
