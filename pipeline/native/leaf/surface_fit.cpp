#include "leaf/surface_fit.h"

#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

#include "leaf/closest.h"
#include "leaf/curves.h"
#include "leaf/jacobian.h"
#include "leaf/near_folds.h"
#include "leaf/normal_equations.h"
#include "leaf/pose.h"
#include "parallel.h"
#include "geometry/small_matrix.h"
#include "vector_clones.h"

namespace usdfoliage {
namespace {

constexpr int kSteps = 2;              // towards the closest place after a search; one else
constexpr int kSearchEvery = 5;        // iterations between searches among all places
constexpr double kSettled = 1e-4;      // share of the cost; less gain ends the iterations
constexpr double kMaxTurn = 0.3;      // of any unknown in one step

// Points of the world, 3 arrays of n one after the other, in leaf space.
USDFOLIAGE_VECTOR_CLONES
void localize(const LeafPose& pose, const double* __restrict world, std::size_t n, double* __restrict x, double* __restrict y,
              double* __restrict z) {
    const LeafPose from = pose;
    for (std::size_t i = 0; i < n; ++i) {
        const double point[3] = {world[i], world[n + i], world[2 * n + i]};
        double local[3];
        localize_point(from, point, local);
        x[i] = local[0];
        y[i] = local[1];
        z[i] = local[2];
    }
}

// What the points cost, each with Geman and McClure's weight.
USDFOLIAGE_VECTOR_CLONES
double points_cost(const double* __restrict squares, const double* __restrict weights, const double* __restrict precisions,
                   double length, double cutoff, std::size_t n) {
    const double c = cutoff * cutoff, area = length * length;
    double sums[4] = {0, 0, 0, 0};
    for (std::size_t i = 0; i < n; i += 4) {
        for (std::size_t k = 0; k < 4; ++k) {
            const double square = squares[i + k] * area * precisions[i + k];
            sums[k] += weights[i + k] * c * square / (c + square);
        }
    }
    return ((sums[0] + sums[1]) + (sums[2] + sums[3])) / 2;
}

// By what the offset of each point is multiplied, before it is squared, for a step.
USDFOLIAGE_VECTOR_CLONES
void offset_rates(const double* __restrict squares, const double* __restrict weights, const double* __restrict precisions,
                  double length, double cutoff, std::size_t n, double* __restrict rates) {
    const double c = cutoff * cutoff, area = length * length;
    for (std::size_t i = 0; i < n; ++i) {
        const double precision = area * precisions[i], drop = c / (c + squares[i] * precision);
        rates[i] = std::sqrt(weights[i] * precision) * drop;
    }
}

class Fit {
   public:
    Fit(const SurfacePoints& all, std::size_t leaf, const double* mean, const double* precision,
        const SurfaceFitSettings& settings);

    void run(LeafPose& pose, double* costs);

   private:
    void match(const LeafPose& pose, ClosestPlaces& places, bool anew) const;
    double data_cost(const LeafPose& pose, const ClosestPlaces& places, double cutoff) const;
    double prior_cost(const LeafPose& pose) const;
    double fold_cost(const LeafPose& pose) const;
    void add_points(const LeafPose& pose, double cutoff);
    void add_prior(const LeafPose& pose);
    void add_folds(const LeafPose& pose);
    void prior_offsets(const LeafPose& pose, double* offsets) const;

    const double *mean_, *precision_;
    const SurfaceFitSettings& settings_;
    ClosestPlaces places_, tried_;
    // Of the points, in the order of the places; what fills these up has no weight.
    std::vector<double> world_, weights_, precisions_, rates_;
    NormalEquations equations_;
};

// How many points of a leaf count that are of the edge, or not.
std::size_t count_points(const SurfacePoints& all, std::size_t leaf, bool edge) {
    std::size_t count = 0;
    for (std::int64_t i = all.offsets[leaf]; i < all.offsets[leaf + 1]; ++i)
        if ((all.edge[i] != 0) == edge && all.weights[i] > 0) ++count;
    return count;
}

Fit::Fit(const SurfacePoints& all, std::size_t leaf, const double* mean, const double* precision,
         const SurfaceFitSettings& settings)
    : mean_(mean),
      precision_(precision),
      settings_(settings),
      places_(count_points(all, leaf, false), count_points(all, leaf, true)),
      tried_(places_),
      world_(3 * places_.size()),
      weights_(places_.size()),
      precisions_(places_.size()),
      rates_(places_.size()) {
    std::size_t next[2] = {0, places_.inside()};
    for (std::int64_t i = all.offsets[leaf]; i < all.offsets[leaf + 1]; ++i) {
        if (!(all.weights[i] > 0)) continue;
        const bool edge = all.edge[i] != 0;
        const std::size_t k = next[edge]++;
        const double noise = all.noise[leaf] * (edge ? settings.edge_noise : 1.0);
        for (std::size_t c = 0; c < 3; ++c) world_[places_.size() * c + k] = all.points[3 * i + static_cast<std::int64_t>(c)];
        weights_[k] = all.weights[i];
        precisions_[k] = 1 / (noise * noise);
    }
}

void Fit::match(const LeafPose& pose, ClosestPlaces& places, bool anew) const {
    const LeafCurves curves = leaf_curves(pose.parameters);
    localize(pose, world_.data(), places.size(), places.point(0), places.point(1), places.point(2));
    if (anew) places.search(curves);
    places.approach(curves, anew ? kSteps : 1);
}

double Fit::data_cost(const LeafPose& pose, const ClosestPlaces& places, double cutoff) const {
    return points_cost(places.square(), weights_.data(), precisions_.data(), pose.length, cutoff, places.size());
}

void Fit::prior_offsets(const LeafPose& pose, double* offsets) const {
    for (std::size_t k = 0; k < kLeafNumbers; ++k) offsets[k] = pose.parameters[k] - mean_[k];
    offsets[kLeafNumbers] = std::log(pose.length) - mean_[kLeafNumbers];
}

double Fit::prior_cost(const LeafPose& pose) const {
    double offsets[kPriorNumbers], sum = 0;
    prior_offsets(pose, offsets);
    for (std::size_t i = 0; i < kPriorNumbers; ++i) {
        double row = 0;
        for (std::size_t k = 0; k < kPriorNumbers; ++k) row += precision_[kPriorNumbers * i + k] * offsets[k];
        sum += offsets[i] * row;
    }
    return sum / 2;
}

double Fit::fold_cost(const LeafPose& pose) const {
    double sum = 0;
    for (const NearFold& near : find_near_folds(pose.parameters)) sum += near.lack * near.lack;
    return settings_.fold_weight * sum / 2;
}

void Fit::add_points(const LeafPose& pose, double cutoff) {
    offset_rates(places_.square(), weights_.data(), precisions_.data(), pose.length, cutoff, places_.size(), rates_.data());
    add_offsets(curve_slopes(pose.parameters), places_, rates_.data(), equations_);
}

void Fit::add_prior(const LeafPose& pose) {
    double offsets[kPriorNumbers];
    prior_offsets(pose, offsets);
    const auto unknown = [](std::size_t i) { return i < kLeafNumbers ? i : kLeafGrowth; };
    for (std::size_t i = 0; i < kPriorNumbers; ++i) {
        for (std::size_t k = 0; k < kPriorNumbers; ++k) {
            const double value = precision_[kPriorNumbers * i + k];
            equations_.right[unknown(i)] -= value * offsets[k];
            if (k <= i) equations_.matrix[unknown(i)][unknown(k)] += value;
        }
    }
}

void Fit::add_folds(const LeafPose& pose) {
    const std::vector<NearFold> folds = find_near_folds(pose.parameters);
    if (folds.empty()) return;
    const LeafCurves curves = leaf_curves(pose.parameters);
    const CurveSlopes slopes = curve_slopes(pose.parameters);
    for (const NearFold& near : folds) {
        double row[kLeafNumbers];
        write_area_slopes(curves, slopes, near, row);
        for (std::size_t i = 0; i < kLeafNumbers; ++i) {
            equations_.right[i] += settings_.fold_weight * near.lack * row[i];
            for (std::size_t k = 0; k <= i; ++k) equations_.matrix[i][k] += settings_.fold_weight * row[i] * row[k];
        }
    }
}

void Fit::run(LeafPose& pose, double* costs) {
    const auto other_costs = [&](const LeafPose& at) { return prior_cost(at) + fold_cost(at); };
    match(pose, places_, true);
    double damping = 1e-2;
    double other = other_costs(pose), last_cutoff = 0;
    bool moved = true;
    const int last = std::max(1, settings_.iterations * 2 / 3);  // iteration from which the cutoff stays
    for (int iteration = 0; iteration < settings_.iterations; ++iteration) {
        const double share = std::min(1.0, static_cast<double>(iteration) / last);
        const double cutoff = settings_.first_cutoff * std::pow(settings_.cutoff / settings_.first_cutoff, share);
        const double cost = data_cost(pose, places_, cutoff) + other;
        if (moved || cutoff != last_cutoff) {
            equations_ = {};
            add_points(pose, cutoff);
            add_prior(pose);
            add_folds(pose);
        }
        last_cutoff = cutoff;
        NormalEquations damped = equations_;
        for (std::size_t k = 0; k < kLeafUnknowns; ++k) damped.matrix[k][k] += damping * damped.matrix[k][k] + 1e-6;
        bool better = false, settled = false;
        if (solve_positive<static_cast<int>(kLeafUnknowns)>(damped.matrix, damped.right)) {
            double* step = damped.right;
            double largest = 0;
            for (std::size_t k = 0; k < kLeafUnknowns; ++k) largest = std::max(largest, std::abs(step[k]));
            const double shorter = largest > kMaxTurn ? kMaxTurn / largest : 1.0;
            for (std::size_t k = 0; k < kLeafUnknowns; ++k) step[k] *= shorter;
            const LeafPose next = moved_pose(pose, step, step + kLeafTurn, step + kLeafShift, step[kLeafGrowth]);
            tried_.begin_at(places_);
            match(next, tried_, (iteration + 1) % kSearchEvery == 0);
            const double next_other = other_costs(next);
            const double next_cost = data_cost(next, tried_, cutoff) + next_other;
            better = next_cost < cost;
            settled = better && iteration >= last && cost - next_cost < kSettled * cost;
            if (better) {
                pose = next;
                other = next_other;
                std::swap(places_, tried_);
            }
        }
        if (settled) break;
        moved = better;
        damping = std::clamp(better ? damping * 0.3 : damping * 5, 1e-6, 1e4);
    }
    costs[0] = data_cost(pose, places_, settings_.cutoff);
    costs[1] = prior_cost(pose);
    costs[2] = fold_cost(pose);
}

}  // namespace

void fit_leaf_surfaces(const SurfacePoints& points, const SurfacePriors& priors, const SurfaceFitSettings& settings,
                       const SurfaceFits& fits, std::size_t n, int threads) {
    parallel_for(n, threads, [&](std::size_t i) {
        LeafPose pose = leaf_pose(fits.parameters + kLeafNumbers * i, fits.axes + 9 * i, fits.bases + 3 * i, fits.lengths[i]);
        const std::size_t prior = static_cast<std::size_t>(fits.prior[i]);
        Fit fit(points, static_cast<std::size_t>(fits.leaf[i]), priors.means + kPriorNumbers * prior,
                priors.precisions + kPriorNumbers * kPriorNumbers * prior, settings);
        fit.run(pose, fits.costs + 3 * i);
        std::copy(pose.parameters, pose.parameters + kLeafNumbers, fits.parameters + kLeafNumbers * i);
        std::copy(pose.axes, pose.axes + 9, fits.axes + 9 * i);
        std::copy(pose.base, pose.base + 3, fits.bases + 3 * i);
        fits.lengths[i] = pose.length;
    });
}

}  // namespace usdfoliage
