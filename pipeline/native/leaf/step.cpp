#include "leaf/step.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "geometry/small_matrix.h"
#include "leaf/jacobian.h"
#include "leaf/limits.h"

namespace usdfoliage {
namespace {

constexpr int kN = static_cast<int>(kLeafNumbers);
constexpr int kMaxSteps = 20, kMaxTries = 8;
constexpr double kFirstDamping = 1e-4;
constexpr double kDone = 1e-6;      // share by which the cost falls in the last step
// What points in the leaf's plane hardly determine, so that turns of mapping and fitting would drift in it: at which pace
// the axis runs along itself, and whether it sways to both sides. Pulls as shares of what all points pull.
constexpr double kPacePull = 0.1, kSwayPull = 0.03;

// Which terms and which parameters a coordinate has.
struct Coordinate {
    int n_terms, terms[5], n_numbers, numbers[14];
};
constexpr Coordinate kCoordinates[3] = {
    {3, {0, 1, 2}, 10, {0, 1, 3, 4, 6, 7, 9, 10, 12, 13}},
    {3, {0, 1, 2}, 10, {0, 1, 3, 4, 6, 7, 9, 10, 12, 13}},
    {5, {0, 1, 3, 4, 5}, 14, {2, 5, 6, 8, 9, 11, 12, 14, 15, 16, 17, 18, 19, 20}},
};

double pull_on(int number, double prior) { return prior + (number == 1 || number == 4 ? kPacePull : 0.0); }

double sway(const double* leaf) { return leaf[0] - leaf[3]; }

double total_weight(const std::vector<LineMoments>& lines) {
    double sum = 0;
    for (const LineMoments& line : lines) sum += line.weight;
    return sum > 0 ? sum : 1.0;
}

// What stands at the terms in each coordinate.
void line_values(const LeafCurves& curves, const Along& along, double values[3][kTerms]) {
    const LeafRow row = leaf_row(curves, along);
    for (int c = 0; c < 3; ++c) {
        values[c][0] = row.foot[c];
        values[c][1] = row.axis[c];
        values[c][2] = c < 2 ? row.step[c] : 0.0;
        for (int k = 0; k < 3; ++k) values[c][3 + k] = c == 2 ? row.height[k] : 0.0;
    }
}

// Derivatives of what stands at the terms, by the parameters.
void line_slopes(const CurveSlopes& slopes, const Along& along, double by[3][kTerms][kN]) {
    std::fill(&by[0][0][0], &by[0][0][0] + 3 * kTerms * kN, 0.0);
    for (int k = 0; k < 2; ++k) {
        double foot = 0, step[4] = {0, 0, 0, 0};
        for (int i = 0; i < 3; ++i) {
            foot += along.quartic[i] * slopes.foot_axis[i][k];
            for (int m = 0; m < 4; ++m) step[m] += along.quartic[i] * slopes.step_axis[i][k][m];
        }
        for (int c = 0; c < 3; ++c) {
            by[c][0][3 * k + c] = foot;
            by[c][1][3 * k + c] = along.axis[k] - foot;
        }
        for (int c = 0; c < 2; ++c)
            for (int m = 0; m < 2; ++m) by[c][2][3 * k + m] = step[2 * c + m];
    }
    for (int i = 0; i < 3; ++i) {
        const double weight = along.quartic[i];
        for (int c = 0; c < 3; ++c) {
            by[c][0][6 + 3 * i] = weight * slopes.foot_v[i][c];
            by[c][1][6 + 3 * i] = -weight * slopes.foot_v[i][c];
        }
        for (int c = 0; c < 2; ++c) {
            by[c][2][6 + 3 * i] = weight * slopes.step_v[i][c];
            by[c][2][7 + 3 * i] = weight * slopes.step_x[i][c];
        }
        by[2][3][15 + i] = weight;
        by[2][4][18 + i] = weight;
        by[2][5][8 + 3 * i] = weight;
    }
}

// Half the gradient and half of Gauss and Newton's Hessian of the cost.
void normal_equations(const std::vector<LineMoments>& lines, double total, const double* start, double prior,
                      const double* leaf, double (&hessian)[kN][kN], double (&gradient)[kN]) {
    std::fill(&hessian[0][0], &hessian[0][0] + kN * kN, 0.0);
    std::fill(gradient, gradient + kN, 0.0);
    const LeafCurves curves = leaf_curves(leaf);
    const CurveSlopes slopes = curve_slopes(leaf);
    double values[3][kTerms], by[3][kTerms][kN];
    for (const LineMoments& line : lines) {
        if (!(line.weight > 0)) continue;
        line_values(curves, line.along, values);
        line_slopes(slopes, line.along, by);
        for (int c = 0; c < 3; ++c) {
            const Coordinate& own = kCoordinates[c];
            double weighted[5][14];  // moments times derivatives
            for (int a = 0; a < own.n_terms; ++a) {
                const int s = own.terms[a];
                double off = -line.right[c][s];
                for (int b = 0; b < own.n_terms; ++b) off += line.terms[s][own.terms[b]] * values[c][own.terms[b]];
                for (int k = 0; k < own.n_numbers; ++k) {
                    gradient[own.numbers[k]] += by[c][s][own.numbers[k]] * off;
                    double sum = 0;
                    for (int b = 0; b < own.n_terms; ++b)
                        sum += line.terms[s][own.terms[b]] * by[c][own.terms[b]][own.numbers[k]];
                    weighted[a][k] = sum;
                }
            }
            for (int k = 0; k < own.n_numbers; ++k) {
                for (int m = 0; m <= k; ++m) {
                    double sum = 0;
                    for (int a = 0; a < own.n_terms; ++a) sum += by[c][own.terms[a]][own.numbers[k]] * weighted[a][m];
                    hessian[own.numbers[k]][own.numbers[m]] += sum;
                }
            }
        }
    }
    for (int k = 0; k < kN; ++k) {
        for (int m = 0; m <= k; ++m) hessian[k][m] /= total;
        hessian[k][k] += pull_on(k, prior);
        gradient[k] = gradient[k] / total + pull_on(k, prior) * (leaf[k] - start[k]);
    }
    hessian[0][0] += kSwayPull;
    hessian[3][3] += kSwayPull;
    hessian[3][0] -= kSwayPull;
    gradient[0] += kSwayPull * sway(leaf);
    gradient[3] -= kSwayPull * sway(leaf);
}

}  // namespace

LineMoments empty_moments(double v) {
    LineMoments line{};
    line.along = along_at(v);
    return line;
}

void add_point(double weight, const Across& across, const double* point, LineMoments* line) {
    const double terms[kTerms] = {across.foot, across.axis, across.step, across.height[0], across.height[1], across.height[2]};
    line->weight += weight;
    for (int a = 0; a < kTerms; ++a) {
        const double weighted = weight * terms[a];
        for (int b = 0; b < kTerms; ++b) line->terms[a][b] += weighted * terms[b];
        for (int c = 0; c < 3; ++c) line->right[c][a] += weighted * point[c];
    }
    for (int c = 0; c < 3; ++c) line->square[c] += weight * point[c] * point[c];
}

double fit_cost(const std::vector<LineMoments>& lines, const double* start, double prior, const double* leaf) {
    const LeafCurves curves = leaf_curves(leaf);
    double sum = 0, values[3][kTerms];
    for (const LineMoments& line : lines) {
        if (!(line.weight > 0)) continue;
        line_values(curves, line.along, values);
        for (int c = 0; c < 3; ++c) {
            sum += line.square[c];
            const Coordinate& own = kCoordinates[c];
            for (int a = 0; a < own.n_terms; ++a) {
                const int s = own.terms[a];
                double off = -2 * line.right[c][s];
                for (int b = 0; b < own.n_terms; ++b) off += line.terms[s][own.terms[b]] * values[c][own.terms[b]];
                sum += values[c][s] * off;
            }
        }
    }
    double cost = sum / total_weight(lines) + kSwayPull * sway(leaf) * sway(leaf);
    for (int k = 0; k < kN; ++k) cost += pull_on(k, prior) * (leaf[k] - start[k]) * (leaf[k] - start[k]);
    return cost;
}

double mean_change(const std::vector<LineMoments>& lines, const double* before, const double* after) {
    const LeafCurves first = leaf_curves(before), second = leaf_curves(after);
    double sum = 0, was[3][kTerms], is[3][kTerms];
    for (const LineMoments& line : lines) {
        if (!(line.weight > 0)) continue;
        line_values(first, line.along, was);
        line_values(second, line.along, is);
        for (int c = 0; c < 3; ++c)
            for (int a = 0; a < kTerms; ++a)
                for (int b = 0; b < kTerms; ++b) sum += (is[c][a] - was[c][a]) * line.terms[a][b] * (is[c][b] - was[c][b]);
    }
    return std::sqrt(std::max(sum, 0.0) / total_weight(lines));
}

void minimise(const std::vector<LineMoments>& lines, const double* start, double prior, double half_width, double* leaf) {
    const LeafLimits limits = leaf_limits(half_width);
    const double total = total_weight(lines);
    double cost = fit_cost(lines, start, prior, leaf), damping = kFirstDamping;
    double hessian[kN][kN], gradient[kN], matrix[kN][kN], step[kN], trial[kN];
    for (int round = 0; round < kMaxSteps; ++round) {
        normal_equations(lines, total, start, prior, leaf, hessian, gradient);
        bool bounded[kN];  // at a bound and pushed against it
        for (int k = 0; k < kN; ++k)
            bounded[k] = (leaf[k] <= limits.low[k] && gradient[k] > 0) || (leaf[k] >= limits.high[k] && gradient[k] < 0);
        double fall = 0;
        bool better = false;
        for (int attempt = 0; attempt < kMaxTries && !better; ++attempt) {
            for (int k = 0; k < kN; ++k) {
                for (int m = 0; m <= k; ++m) matrix[k][m] = bounded[k] || bounded[m] ? 0.0 : hessian[k][m];
                matrix[k][k] = bounded[k] ? 1.0 : hessian[k][k] * (1 + damping);
                step[k] = bounded[k] ? 0.0 : -gradient[k];
            }
            double next = std::numeric_limits<double>::infinity();
            if (solve_positive<kN>(matrix, step)) {
                for (int k = 0; k < kN; ++k) trial[k] = std::clamp(leaf[k] + step[k], limits.low[k], limits.high[k]);
                if (silhouette_in_order(trial)) next = fit_cost(lines, start, prior, trial);
            }
            better = next < cost;
            if (better) {
                fall = cost - next;
                cost = next;
                std::copy(trial, trial + kN, leaf);
                damping = std::max(damping / 10, 1e-12);
            } else {
                damping *= 10;
            }
        }
        if (!better || fall <= kDone * cost) break;
    }
}

}  // namespace usdfoliage
