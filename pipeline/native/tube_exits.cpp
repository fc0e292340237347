#include "tube_exits.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "parallel.h"

namespace usdfoliage {
namespace {

constexpr std::size_t kBlock = 64;  // walks of one task

using Vector = std::array<double, 3>;

double dot(const Vector& a, const Vector& b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }
Vector between(const Vector& from, const Vector& to) { return {to[0] - from[0], to[1] - from[1], to[2] - from[2]}; }
double length(const Vector& a) { return std::sqrt(dot(a, a)); }

struct Place {
    Vector point;
    double radius;
};

class Walker {
  public:
    Walker(const TubeAxes& axes, const ExitWalk& how, std::int64_t tube, std::int64_t parent, double clearance,
           std::int64_t& at)
        : axes_(axes), how_(how), tube_(tube), parent_(parent), clearance_(clearance), at_(at) {}

    bool walk(double& arc) {
        const double end = axes_.arc[axes_.first[tube_] + axes_.counts[tube_] - 1];
        for (int step = 0; step < how_.most_steps; ++step) {
            const Place own = axis(arc), near = nearest(own.point);
            const Vector offset = between(near.point, own.point);
            const double distance = length(offset);
            double missing = near.radius - distance;
            if (how_.whole_disc) {
                const double radius = std::min(own.radius, how_.thickest * near.radius);
                const double along = dot(offset, tangent(arc, 0.5 * radius)) / std::max(distance, 1e-300);
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
    Vector point(std::int64_t at) const {
        return {axes_.points[3 * at], axes_.points[3 * at + 1], axes_.points[3 * at + 2]};
    }
    Vector direction(std::int64_t at) const {
        return {axes_.direction[3 * at], axes_.direction[3 * at + 1], axes_.direction[3 * at + 2]};
    }
    double step_at(std::int64_t at) const { return axes_.arc[at + 1] - axes_.arc[at]; }

    std::int64_t segment(double arc) const {
        const std::int64_t first = axes_.first[tube_], last = first + axes_.counts[tube_] - 2;
        const auto found = std::upper_bound(axes_.arc + first, axes_.arc + last + 2, arc) - axes_.arc - 1;
        return std::clamp(static_cast<std::int64_t>(found), first, last);
    }

    Place axis(double arc) const {
        const std::int64_t at = segment(arc);
        const double share = std::clamp((arc - axes_.arc[at]) / step_at(at), 0.0, 1.0);
        const Vector low = point(at), step = between(low, point(at + 1));
        return {{low[0] + share * step[0], low[1] + share * step[1], low[2] + share * step[2]},
                axes_.radius[at] + share * (axes_.radius[at + 1] - axes_.radius[at])};
    }

    // Unit chord over the axis from reach before a place to reach after it.
    Vector tangent(double arc, double reach) const {
        const double end = axes_.arc[axes_.first[tube_] + axes_.counts[tube_] - 1];
        Vector chord = between(axis(std::max(arc - reach, 0.0)).point, axis(std::min(arc + reach, end)).point);
        // Where the axis comes back on itself the chord says nothing, and the segment does.
        if (length(chord) < 0.2 * reach) chord = direction(segment(arc));
        const double size = length(chord);
        return {chord[0] / size, chord[1] / size, chord[2] / size};
    }

    double share_of(const Vector& place, std::int64_t at) const {
        return dot(between(point(at), place), direction(at)) / step_at(at);
    }

    double distance_to(const Vector& place, std::int64_t at) const {
        Vector offset = between(point(at), place);
        const Vector way = direction(at);
        const double along = std::clamp(dot(offset, way), 0.0, step_at(at));
        for (std::size_t k = 0; k < 3; ++k) offset[k] -= along * way[k];
        return length(offset);
    }

    // The place of the parent next to a point, from where the last one was.
    Place nearest(const Vector& place) const {
        const std::int64_t low = axes_.first[parent_], high = low + axes_.counts[parent_] - 2;
        for (int step = 0; step < how_.most_steps; ++step) {
            const double share = share_of(place, at_);
            const std::int64_t next = share > 1 && at_ < high ? at_ + 1 : share < 0 && at_ > low ? at_ - 1 : at_;
            // Only to a neighbour that is nearer, or a corner would be stepped over for ever.
            if (next == at_ || !(distance_to(place, next) < distance_to(place, at_))) break;
            at_ = next;
        }
        const double share = std::clamp(share_of(place, at_), 0.0, 1.0);
        const Vector start = point(at_), way = direction(at_);
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
