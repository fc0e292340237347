#include "leaf_surface_fit.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <vector>

#include "leaf_curves.h"
#include "leaf_jacobian.h"
#include "parallel.h"
#include "small_matrix.h"

namespace usdfoliage {
namespace {

constexpr std::size_t kUnknowns = 28;  // parameters, turn, shift, logarithm of the length
constexpr int kTurn = 21, kShift = 24, kLength = 27;

constexpr int kGridU = 9, kGridV = 15;    // places among which the closest is looked for
constexpr int kEdgeV = 33;                // places along either silhouette
constexpr int kSteps = 2;                 // towards the closest place after a search; one else
constexpr int kSearchEvery = 5;           // iterations between searches among all places
constexpr std::size_t kRows = 64;         // of the normal equations, added together
constexpr double kSettled = 1e-4;         // share of the cost; less gain ends the iterations
constexpr double kMostTurn = 0.3;         // of any unknown in one step
constexpr double kMidrib = 1e-9;          // |u| of a place that came to the crease
constexpr double kFoldMargin = 0.04;      // area elements below it count as near to a fold

double dot3(const double* a, const double* b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

void cross3(const double* a, const double* b, double* c) {
    c[0] = a[1] * b[2] - a[2] * b[1];
    c[1] = a[2] * b[0] - a[0] * b[2];
    c[2] = a[0] * b[1] - a[1] * b[0];
}

bool unit3(double* a) {
    const double length = std::sqrt(dot3(a, a));
    if (!(length > 1e-12)) return false;
    for (int c = 0; c < 3; ++c) a[c] /= length;
    return true;
}

struct Pose {
    double parameters[kLeafNumbers];
    double axes[9], base[3], length;
};

struct Place {
    double point[3], by_u[3], by_v[3];
};

Place place_at(const LeafCurves& curves, double u, double v) {
    Place place;
    const LeafRow row = leaf_row(curves, along_at(v));
    const Across across = across_at(u);
    leaf_point(row, across, place.point);
    leaf_point(row, across_slope_at(u), place.by_u);
    // The derivative by v of the row; leaf_row's control points without a base are those of the curve, so that only the
    // weights differ.
    leaf_point(leaf_row(curves, along_slope_at(v)), across, place.by_v);
    return place;
}

// Where a point's closest place is.
enum class On : std::uint8_t { kInside, kSide, kTip };

struct Match {
    double u, v;
    On on;
    double place[3];     // leaf space
    double rows[3][3];   // directions along which the offset counts
    double offset[3];    // along them, in leaf lengths
    int count;           // rows in use
    double square;       // of the offsets that count
};

// Points sampled over the surface, to look for the closest.
struct Samples {
    double grid[kGridU * kGridV][3];
    double edge[2 * kEdgeV][3];
};

void sample_surface(const LeafCurves& curves, Samples& samples) {
    for (int k = 0; k < kGridV; ++k) {
        const LeafRow row = leaf_row(curves, along_at(static_cast<double>(k) / (kGridV - 1)));
        for (int i = 0; i < kGridU; ++i)
            leaf_point(row, across_at(2.0 * i / (kGridU - 1) - 1), samples.grid[kGridU * k + i]);
    }
    for (int k = 0; k < kEdgeV; ++k) {
        const LeafRow row = leaf_row(curves, along_at(static_cast<double>(k) / (kEdgeV - 1)));
        for (int side = 0; side < 2; ++side) leaf_point(row, across_at(2.0 * side - 1), samples.edge[2 * k + side]);
    }
}

template <std::size_t N>
int closest(const double (&samples)[N][3], const double* point) {
    int best = 0;
    double least = std::numeric_limits<double>::infinity();
    for (std::size_t k = 0; k < N; ++k) {
        const double x = samples[k][0] - point[0], y = samples[k][1] - point[1], z = samples[k][2] - point[2];
        const double square = x * x + y * y + z * z;
        if (square < least) {
            least = square;
            best = static_cast<int>(k);
        }
    }
    return best;
}

void search(const Samples& samples, const double* point, bool edge, Match& match) {
    if (edge) {
        const int k = closest(samples.edge, point);
        match.u = 2.0 * (k % 2) - 1;
        match.v = static_cast<double>(k / 2) / (kEdgeV - 1);
    } else {
        const int k = closest(samples.grid, point);
        match.u = 2.0 * (k % kGridU) / (kGridU - 1) - 1;
        match.v = static_cast<double>(k / kGridU) / (kGridV - 1);
    }
}

// Step towards the closest place of the silhouette.
void slide_along(const Place& place, const double* point, Match& match) {
    const double offset[3] = {point[0] - place.point[0], point[1] - place.point[1], point[2] - place.point[2]};
    const double speed = std::max(dot3(place.by_v, place.by_v), 1e-9);
    match.v = std::clamp(match.v + std::clamp(dot3(offset, place.by_v) / speed, -0.05, 0.05), 0.0, 1.0);
}

// Step towards the closest place of the surface; a place stays on the border where the point lies beyond, and lands on the
// crease before it goes over to the other half.
void slide_over(const Place& place, const double* point, Match& match) {
    const double offset[3] = {point[0] - place.point[0], point[1] - place.point[1], point[2] - place.point[2]};
    double a = dot3(place.by_u, place.by_u), c = dot3(place.by_v, place.by_v);
    const double b = dot3(place.by_u, place.by_v), e = dot3(place.by_u, offset), f = dot3(place.by_v, offset);
    const double damping = 1e-9 + 1e-6 * (a + c);
    a += damping;
    c += damping;
    const double determinant = std::max(a * c - b * b, 1e-15);
    double du = (c * e - b * f) / determinant, dv = (a * f - b * e) / determinant;
    const bool held_u = (match.u >= 1 && du > 0) || (match.u <= -1 && du < 0);
    const bool held_v = (match.v >= 1 && dv > 0) || (match.v <= 0 && dv < 0);
    if (held_u) {
        du = 0;
        dv = f / c;
    }
    if (held_v) {
        dv = 0;
        du = held_u ? 0 : e / a;
    }
    double u = std::clamp(match.u + std::clamp(du, -0.3, 0.3), -1.0, 1.0);
    if (u * match.u < 0 && std::abs(match.u) > kMidrib) u = u < 0 ? -kMidrib : kMidrib;
    match.u = u;
    match.v = std::clamp(match.v + std::clamp(dv, -0.2, 0.2), 0.0, 1.0);
}

// What of the offset from the closest place counts.
void measure(const Place& place, const double* point, bool edge, Match& match) {
    const double offset[3] = {point[0] - place.point[0], point[1] - place.point[1], point[2] - place.point[2]};
    std::copy(place.point, place.point + 3, match.place);
    double normal[3], along[3] = {place.by_v[0], place.by_v[1], place.by_v[2]};
    cross3(place.by_u, place.by_v, normal);
    const bool tip = match.v <= 0 || match.v >= 1 || !unit3(normal) || !unit3(along);
    if (tip) {
        match.on = On::kTip;
        match.count = 3;
        for (int i = 0; i < 3; ++i)
            for (int c = 0; c < 3; ++c) match.rows[i][c] = i == c ? 1.0 : 0.0;
    } else {
        match.on = edge || std::abs(match.u) >= 1 ? On::kSide : On::kInside;
        match.count = match.on == On::kSide ? 2 : 1;
        std::copy(normal, normal + 3, match.rows[0]);
        cross3(along, normal, match.rows[1]);
    }
    match.square = 0;
    for (int i = 0; i < match.count; ++i) {
        match.offset[i] = dot3(match.rows[i], offset);
        match.square += match.offset[i] * match.offset[i];
    }
}

// Places where folds are looked for, either half.
struct FoldPlaces {
    std::array<double, 3> u = {1e-6, 0.6, 1.0};
    std::array<double, 9> v = {0.03, 0.08, 0.16, 0.3, 0.5, 0.7, 0.84, 0.92, 0.97};
};

// How wide the leaf is meant to be, which area elements are compared with.
double mean_width(const double* parameters) {
    return std::max((std::abs(parameters[7]) + std::abs(parameters[10]) + std::abs(parameters[13])) / 3, 1e-3);
}

class Fit {
   public:
    Fit(const SurfacePoints& all, std::size_t leaf, const double* mean, const double* precision,
        const SurfaceFitSettings& settings)
        : first_(static_cast<std::size_t>(all.offsets[leaf])),
          count_(static_cast<std::size_t>(all.offsets[leaf + 1]) - first_),
          points_(all.points + 3 * first_),
          edge_(all.edge + first_),
          weights_(all.weights + first_),
          noise_(all.noise[leaf]),
          mean_(mean),
          precision_(precision),
          settings_(settings) {
        for (auto* each : {&matches_, &tried_}) each->resize(count_);
    }

    void run(Pose& pose, double* costs);

   private:
    void match(const Pose& pose, std::vector<Match>& matches, bool anew) const;
    double data_cost(const Pose& pose, const std::vector<Match>& matches, double cutoff) const;
    double prior_cost(const Pose& pose) const;
    double fold_cost(const Pose& pose) const;
    void add_points(const Pose& pose, double cutoff);
    void add_rows(const double (*rows)[kUnknowns + 1], std::size_t count);
    void add_prior(const Pose& pose);
    void add_folds(const Pose& pose);
    void prior_offsets(const Pose& pose, double* offsets) const;
    // Square of the residual of a point, in its noise.
    double scaled(const Pose& pose, std::size_t i, const Match& match) const {
        const double rate = pose.length / (noise_ * (edge_[i] ? settings_.edge_noise : 1.0));
        return match.square * rate * rate;
    }

    std::size_t first_, count_;
    const double* points_;
    const std::uint8_t* edge_;
    const double* weights_;
    double noise_;
    const double *mean_, *precision_;
    const SurfaceFitSettings& settings_;
    std::vector<Match> matches_, tried_;
    double matrix_[kUnknowns][kUnknowns], right_[kUnknowns];
};

void local_point(const Pose& pose, const double* world, double* point) {
    const double offset[3] = {world[0] - pose.base[0], world[1] - pose.base[1], world[2] - pose.base[2]};
    for (int c = 0; c < 3; ++c)
        point[c] = (offset[0] * pose.axes[c] + offset[1] * pose.axes[3 + c] + offset[2] * pose.axes[6 + c]) / pose.length;
}

void match_points(const Pose& pose, const double* points, const std::uint8_t* edge, std::size_t count, bool anew, int steps,
                  Match* matches) {
    const LeafCurves curves = leaf_curves(pose.parameters);
    Samples samples;
    if (anew) sample_surface(curves, samples);
    for (std::size_t i = 0; i < count; ++i) {
        double point[3];
        local_point(pose, points + 3 * i, point);
        Match& match = matches[i];
        if (anew) search(samples, point, edge[i] != 0, match);
        for (int step = 0; step < steps; ++step) {
            const Place place = place_at(curves, match.u, match.v);
            if (edge[i])
                slide_along(place, point, match);
            else
                slide_over(place, point, match);
        }
        measure(place_at(curves, match.u, match.v), point, edge[i] != 0, match);
    }
}

void Fit::match(const Pose& pose, std::vector<Match>& matches, bool anew) const {
    match_points(pose, points_, edge_, count_, anew, anew ? kSteps : 1, matches.data());
}

double Fit::data_cost(const Pose& pose, const std::vector<Match>& matches, double cutoff) const {
    const double c = cutoff * cutoff;
    double sum = 0;
    for (std::size_t i = 0; i < count_; ++i) {
        const double square = scaled(pose, i, matches[i]);
        sum += weights_[i] * c * square / (c + square);
    }
    return sum / 2;
}

void Fit::prior_offsets(const Pose& pose, double* offsets) const {
    for (std::size_t k = 0; k < kLeafNumbers; ++k) offsets[k] = pose.parameters[k] - mean_[k];
    offsets[kLeafNumbers] = std::log(pose.length) - mean_[kLeafNumbers];
}

double Fit::prior_cost(const Pose& pose) const {
    double offsets[kPriorNumbers], sum = 0;
    prior_offsets(pose, offsets);
    for (std::size_t i = 0; i < kPriorNumbers; ++i) {
        double row = 0;
        for (std::size_t k = 0; k < kPriorNumbers; ++k) row += precision_[kPriorNumbers * i + k] * offsets[k];
        sum += offsets[i] * row;
    }
    return sum / 2;
}

template <typename Visit>
void visit_near_folds(const double* parameters, const Visit& visit) {
    static const FoldPlaces places;
    const LeafCurves curves = leaf_curves(parameters);
    const double width = mean_width(parameters);
    for (const double v : places.v) {
        for (const double side : {-1.0, 1.0}) {
            for (const double abs_u : places.u) {
                const double u = side * abs_u;
                const Place place = place_at(curves, u, v);
                const double scale = 1 / width, margin = kFoldMargin * 4 * v * (1 - v);
                const double area = scale * (place.by_u[0] * place.by_v[1] - place.by_u[1] * place.by_v[0]);
                if (area < margin) visit(place, u, v, scale, margin - area);
            }
        }
    }
}

double Fit::fold_cost(const Pose& pose) const {
    double sum = 0;
    visit_near_folds(pose.parameters, [&](const Place&, double, double, double, double lack) { sum += lack * lack; });
    return settings_.fold_weight * sum / 2;
}

void Fit::add_folds(const Pose& pose) {
    const CurveSlopes slopes = curve_slopes(pose.parameters);
    visit_near_folds(pose.parameters, [&](const Place& place, double u, double v, double scale, double lack) {
        double of_u[3 * kLeafNumbers], of_v[3 * kLeafNumbers], row[kLeafNumbers];
        write_jacobian(slopes, along_at(v), across_slope_at(u), of_u);
        write_jacobian(slopes, along_slope_at(v), across_at(u), of_v);
        for (std::size_t k = 0; k < kLeafNumbers; ++k)
            row[k] = scale * (of_u[k] * place.by_v[1] + place.by_u[0] * of_v[kLeafNumbers + k] -
                              of_u[kLeafNumbers + k] * place.by_v[0] - place.by_u[1] * of_v[k]);
        for (std::size_t i = 0; i < kLeafNumbers; ++i) {
            right_[i] += settings_.fold_weight * lack * row[i];
            for (std::size_t k = 0; k <= i; ++k) matrix_[i][k] += settings_.fold_weight * row[i] * row[k];
        }
    });
}

void Fit::add_prior(const Pose& pose) {
    double offsets[kPriorNumbers];
    prior_offsets(pose, offsets);
    const auto unknown = [](std::size_t i) { return i < kLeafNumbers ? i : static_cast<std::size_t>(kLength); };
    for (std::size_t i = 0; i < kPriorNumbers; ++i) {
        for (std::size_t k = 0; k < kPriorNumbers; ++k) {
            const double value = precision_[kPriorNumbers * i + k];
            right_[unknown(i)] -= value * offsets[k];
            if (k <= i) matrix_[unknown(i)][unknown(k)] += value;
        }
    }
}

void Fit::add_points(const Pose& pose, double cutoff) {
    const CurveSlopes slopes = curve_slopes(pose.parameters);
    const double c = cutoff * cutoff;
    double jacobian[3 * kLeafNumbers], rows[kRows][kUnknowns + 1];
    std::size_t filled = 0;
    for (std::size_t i = 0; i < count_; ++i) {
        const Match& match = matches_[i];
        const double noises = pose.length / (noise_ * (edge_[i] ? settings_.edge_noise : 1.0));
        const double drop = c / (c + match.square * noises * noises);
        const double rate = std::sqrt(weights_[i]) * drop * noises;
        if (!(rate > 0)) continue;
        write_jacobian(slopes, along_at(match.v), across_at(match.u), jacobian);
        for (int r = 0; r < match.count; ++r) {
            const double* direction = match.rows[r];
            double* row = rows[filled];
            for (std::size_t k = 0; k < kLeafNumbers; ++k)
                row[k] = direction[0] * jacobian[k] + direction[1] * jacobian[kLeafNumbers + k] +
                         direction[2] * jacobian[2 * kLeafNumbers + k];
            cross3(match.place, direction, row + kTurn);
            std::copy(direction, direction + 3, row + kShift);
            row[kLength] = dot3(direction, match.place);
            row[kUnknowns] = match.offset[r];
            for (double& number : rows[filled]) number *= rate;
            if (++filled == kRows) {
                add_rows(rows, filled);
                filled = 0;
            }
        }
    }
    add_rows(rows, filled);
}

// Add rows, each with what it should be at its end, to the normal equations: in tiles that stay in registers.
void Fit::add_rows(const double (*rows)[kUnknowns + 1], std::size_t count) {
    constexpr std::size_t kTile = 4;
    static_assert(kUnknowns % kTile == 0);
    for (std::size_t i = 0; i < kUnknowns; i += kTile) {
        for (std::size_t k = 0; k <= i; k += kTile) {
            double tile[kTile][kTile] = {};
            for (std::size_t r = 0; r < count; ++r)
                for (std::size_t a = 0; a < kTile; ++a)
                    for (std::size_t b = 0; b < kTile; ++b) tile[a][b] += rows[r][i + a] * rows[r][k + b];
            for (std::size_t a = 0; a < kTile; ++a)
                for (std::size_t b = 0; b < kTile; ++b) matrix_[i + a][k + b] += tile[a][b];
        }
        for (std::size_t r = 0; r < count; ++r)
            for (std::size_t a = 0; a < kTile; ++a) right_[i + a] += rows[r][i + a] * rows[r][kUnknowns];
    }
}

Pose moved(const Pose& pose, const double* step) {
    Pose next = pose;
    for (std::size_t k = 0; k < kLeafNumbers; ++k) next.parameters[k] += step[k];
    const double* turn = step + kTurn;
    const double angle = std::sqrt(dot3(turn, turn));
    double matrix[9] = {1, 0, 0, 0, 1, 0, 0, 0, 1};
    if (angle > 1e-15) {
        const double x = turn[0] / angle, y = turn[1] / angle, z = turn[2] / angle;
        const double s = std::sin(angle), c = std::cos(angle), t = 1 - c;
        const double turned[9] = {c + t * x * x, t * x * y - s * z, t * x * z + s * y, t * x * y + s * z, c + t * y * y,
                                  t * y * z - s * x, t * x * z - s * y, t * y * z + s * x, c + t * z * z};
        std::copy(turned, turned + 9, matrix);
    }
    for (int i = 0; i < 3; ++i) {
        for (int k = 0; k < 3; ++k)
            next.axes[3 * i + k] = pose.axes[3 * i] * matrix[k] + pose.axes[3 * i + 1] * matrix[3 + k] +
                                   pose.axes[3 * i + 2] * matrix[6 + k];
        next.base[i] += pose.length * dot3(pose.axes + 3 * i, step + kShift);
    }
    next.length = pose.length * std::exp(step[kLength]);
    return next;
}

void Fit::run(Pose& pose, double* costs) {
    const auto other_costs = [&](const Pose& at) { return prior_cost(at) + fold_cost(at); };
    match(pose, matches_, true);
    double damping = 1e-2;
    const int last = std::max(1, settings_.iterations * 2 / 3);  // iteration from which the cutoff stays
    double cutoff = settings_.first_cutoff;
    for (int iteration = 0; iteration < settings_.iterations; ++iteration) {
        const double share = std::min(1.0, static_cast<double>(iteration) / last);
        cutoff = settings_.first_cutoff * std::pow(settings_.last_cutoff / settings_.first_cutoff, share);
        const double cost = data_cost(pose, matches_, cutoff) + other_costs(pose);
        for (auto& matrix_row : matrix_) std::fill(matrix_row, matrix_row + kUnknowns, 0.0);
        std::fill(right_, right_ + kUnknowns, 0.0);
        add_points(pose, cutoff);
        add_prior(pose);
        add_folds(pose);
        for (std::size_t k = 0; k < kUnknowns; ++k) matrix_[k][k] += damping * matrix_[k][k] + 1e-6;
        bool better = false, settled = false;
        if (solve_positive<static_cast<int>(kUnknowns)>(matrix_, right_)) {
            double most = 0;
            for (const double number : right_) most = std::max(most, std::abs(number));
            const double shorter = most > kMostTurn ? kMostTurn / most : 1.0;
            for (double& number : right_) number *= shorter;
            const Pose next = moved(pose, right_);
            tried_ = matches_;
            match(next, tried_, (iteration + 1) % kSearchEvery == 0);
            const double next_cost = data_cost(next, tried_, cutoff) + other_costs(next);
            better = next_cost < cost;
            settled = better && iteration >= last && cost - next_cost < kSettled * cost;
            if (better) {
                pose = next;
                std::swap(matches_, tried_);
            }
        }
        if (settled) break;
        damping = std::clamp(better ? damping * 0.3 : damping * 5, 1e-6, 1e4);
    }
    costs[0] = data_cost(pose, matches_, settings_.last_cutoff);
    costs[1] = prior_cost(pose);
    costs[2] = fold_cost(pose);
}

Pose pose_of(const double* parameters, const double* axes, const double* base, double length) {
    Pose pose;
    std::copy(parameters, parameters + kLeafNumbers, pose.parameters);
    std::copy(axes, axes + 9, pose.axes);
    std::copy(base, base + 3, pose.base);
    pose.length = length;
    return pose;
}

}  // namespace

void fit_leaf_surfaces(const SurfacePoints& points, const SurfacePriors& priors, const SurfaceFitSettings& settings,
                       const SurfaceFits& fits, std::size_t n, int threads) {
    parallel_for(n, threads, [&](std::size_t i) {
        Pose pose = pose_of(fits.parameters + kLeafNumbers * i, fits.axes + 9 * i, fits.bases + 3 * i, fits.lengths[i]);
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

void project_to_leaves(const double* points, const std::uint8_t* edge, const std::int64_t* offsets, const double* parameters,
                       const double* axes, const double* bases, const double* lengths, std::size_t n, double* uv,
                       double* distances, int threads) {
    parallel_for(n, threads, [&](std::size_t i) {
        const std::size_t first = static_cast<std::size_t>(offsets[i]);
        const std::size_t count = static_cast<std::size_t>(offsets[i + 1]) - first;
        const Pose pose = pose_of(parameters + kLeafNumbers * i, axes + 9 * i, bases + 3 * i, lengths[i]);
        std::vector<Match> matches(count);
        match_points(pose, points + 3 * first, edge + first, count, true, 2 * kSteps, matches.data());
        for (std::size_t k = 0; k < count; ++k) {
            const Match& match = matches[k];
            double point[3];
            local_point(pose, points + 3 * (first + k), point);
            uv[2 * (first + k)] = match.u;
            uv[2 * (first + k) + 1] = match.v;
            distances[first + k] = pose.length * std::sqrt((point[0] - match.place[0]) * (point[0] - match.place[0]) +
                                                           (point[1] - match.place[1]) * (point[1] - match.place[1]) +
                                                           (point[2] - match.place[2]) * (point[2] - match.place[2]));
        }
    });
}

}  // namespace usdfoliage
