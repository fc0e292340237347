#include "branch_cage/tube_exits.h"

#include <algorithm>
#include <cmath>

#include "parallel.h"

namespace usdfoliage {
namespace {

constexpr std::size_t kBlock = 64;  // walks of one task

class Walker {
  public:
    Walker(const TubeAxes& axes, const ExitWalkSettings& settings, std::int64_t tube, std::int64_t parent, double clearance,
           std::int64_t& at)
        : axes_(axes), settings_(settings), tube_(tube), parent_(parent), clearance_(clearance), at_(at) {}

    bool walk(double& arc) {
        const double end = tube_length(axes_, tube_);
        for (int step = 0; step < settings_.max_steps; ++step) {
            const TubePlace own = tube_axis(axes_, tube_, arc), near = tube_nearest(axes_, parent_, own.point, settings_.max_steps, at_);
            const TubeVector offset = between(near.point, own.point);
            const double distance = length(offset);
            double missing = near.radius - distance;
            if (settings_.whole_disc) {
                const double radius = std::min(own.radius, settings_.thickest * near.radius);
                const double along = dot(offset, tube_tangent(axes_, tube_, arc, 0.5 * radius)) / std::max(distance, 1e-300);
                const double sideways = std::sqrt(std::clamp(1 - along * along, 0.0, 1.0));
                missing = settings_.cage_factor * (near.radius + sideways * radius) + clearance_ * radius - distance;
            }
            // A straight way out is met exactly, or just not.
            if (missing <= settings_.skin * near.radius) return true;
            if (arc >= end) return false;
            // No point nearer than what is missing can be outside: the distance grows at most as fast as the arc.
            arc = std::min(arc + std::max(settings_.whole_disc ? 0.6 * missing : missing, 0.04 * near.radius), end);
        }
        return false;
    }

  private:
    const TubeAxes& axes_;
    const ExitWalkSettings& settings_;
    std::int64_t tube_, parent_;
    double clearance_;
    std::int64_t& at_;
};

}  // namespace

void walk_out(const TubeAxes& axes, const std::int64_t* tube, const std::int64_t* parent, const double* clearance,
              std::size_t n, const ExitWalkSettings& settings, std::int64_t* at, double* arc, std::uint8_t* done, int threads) {
    parallel_for((n + kBlock - 1) / kBlock, threads, [&](std::size_t block) {
        for (std::size_t k = block * kBlock; k < std::min(n, (block + 1) * kBlock); ++k)
            done[k] = Walker(axes, settings, tube[k], parent[k], clearance[k], at[k]).walk(arc[k]) ? 1 : 0;
    });
}

}  // namespace usdfoliage
