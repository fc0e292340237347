#include "branch_cage/tube_bend.h"

#include <algorithm>
#include <cmath>

namespace usdfoliage {
namespace {

std::vector<double> arcs_along(const double* points, std::size_t n) {
    std::vector<double> arc(n, 0.0);
    for (std::size_t k = 1; k < n; ++k) {
        double square = 0;
        for (std::size_t axis = 0; axis < 3; ++axis) {
            const double step = points[3 * k + axis] - points[3 * (k - 1) + axis];
            square += step * step;
        }
        arc[k] = arc[k - 1] + std::sqrt(square);
    }
    return arc;
}

}  // namespace

BentAxis bend_start(const double* points, const double* radius, std::size_t n, const double* step,
                    const StartBendSettings& settings) {
    const std::vector<double> arc = arcs_along(points, n);
    BentAxis bent;
    bent.old_arc = arc;
    for (int k = 0; k <= settings.samples; ++k) {
        const double added = settings.kept_m + settings.fade_m * (k / static_cast<double>(settings.samples));
        // No new point next to an old one: its segment would have no direction.
        const bool apart = std::none_of(arc.begin(), arc.end(), [&](double old) {
            return std::abs(added - old) <= settings.min_apart * settings.fade_m;
        });
        if (added < arc.back() && apart) bent.old_arc.push_back(added);
    }
    std::sort(bent.old_arc.begin(), bent.old_arc.end());
    const std::size_t count = bent.old_arc.size();
    bent.points.resize(3 * count);
    bent.moved.resize(3 * count);
    bent.radius.resize(count);
    std::size_t at = 0;
    for (std::size_t k = 0; k < count; ++k) {
        const double here = bent.old_arc[k];
        while (at + 2 < n && arc[at + 1] <= here) ++at;
        const double along = (here - arc[at]) / (arc[at + 1] - arc[at]);
        const double share = std::clamp((here - settings.kept_m) / settings.fade_m, 0.0, 1.0), weight = 1 - share * share * (3 - 2 * share);
        const auto mix = [&](double low, double high) {
            return along <= 0 ? low : along >= 1 ? high : low + along * (high - low);
        };
        bent.radius[k] = mix(radius[at], radius[at + 1]);
        for (std::size_t axis = 0; axis < 3; ++axis) {
            bent.moved[3 * k + axis] = weight * step[axis];
            bent.points[3 * k + axis] = mix(points[3 * at + axis], points[3 * (at + 1) + axis]) + bent.moved[3 * k + axis];
        }
    }
    bent.new_arc = arcs_along(bent.points.data(), count);
    return bent;
}

}  // namespace usdfoliage
