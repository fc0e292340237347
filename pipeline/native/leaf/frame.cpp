#include "leaf/frame.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <utility>

#include "geometry/enclosing_ellipse.h"
#include "geometry/small_matrix.h"

namespace usdfoliage {
namespace {

constexpr double kNarrowest = 1e-3;      // points spread over less of a width, a share of their length, lie on a line
constexpr double kEllipseTolerance = 1e-6;
constexpr double kDeviation = 1.482602218505602;  // standard deviations a median absolute deviation of normal noise counts
constexpr double kTukey = 4.685;         // 95 % as good as least squares where there are no outliers
constexpr double kOff = 6.0;             // standard deviations off the surface that make an outlier
constexpr double kExact = 1e-6;          // what is closer to the surface, in sizes of the leaf, is never one
constexpr int kHeightRounds = 6;
constexpr std::size_t kNeighbour = 4;
constexpr std::size_t kFewNear = 5, kNearShare = 50;  // points near an end: a fiftieth, but not fewer
constexpr int kRings = 3;                // of cells searched for neighbours

using Point = std::array<double, 3>;
using Quadric = std::array<double, 6>;

double median_of(std::vector<double>& values) {
    const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
    std::nth_element(values.begin(), middle, values.end());
    return *middle;
}

// Mean and principal axes x (across), y (along), z (normal) of the points that are kept.
struct Plane {
    Point mean;
    Point axes[3];
    double spread[3];  // standard deviations along them
};

Plane principal_plane(const double* points, const double* normals, std::size_t n, const std::vector<unsigned char>& kept) {
    Plane plane{};
    double count = 0, facing[3] = {0, 0, 0};
    for (std::size_t i = 0; i < n; ++i) {
        if (!kept[i]) continue;
        ++count;
        for (int c = 0; c < 3; ++c) {
            plane.mean[c] += points[3 * i + c];
            facing[c] += normals[3 * i + c];
        }
    }
    for (int c = 0; c < 3; ++c) plane.mean[c] /= count;
    double matrix[3][3] = {}, values[3], vectors[3][3];
    for (std::size_t i = 0; i < n; ++i) {
        if (!kept[i]) continue;
        for (int a = 0; a < 3; ++a)
            for (int b = 0; b < 3; ++b)
                matrix[a][b] += (points[3 * i + a] - plane.mean[a]) * (points[3 * i + b] - plane.mean[b]) / count;
    }
    principal_axes_3(matrix, values, vectors);
    double towards = 0, tail = 0;
    for (int c = 0; c < 3; ++c) towards += vectors[2][c] * facing[c];
    for (std::size_t i = 0; i < n; ++i) {
        if (!kept[i]) continue;
        double along = 0;
        for (int c = 0; c < 3; ++c) along += vectors[0][c] * (points[3 * i + c] - plane.mean[c]);
        tail += along * along * along;
    }
    // Towards the cameras; and, so that the answer does not depend on how the world is turned, towards the longer tail.
    for (int c = 0; c < 3; ++c) {
        plane.axes[2][c] = towards < 0 ? -vectors[2][c] : vectors[2][c];
        plane.axes[1][c] = tail < 0 ? -vectors[0][c] : vectors[0][c];
    }
    const Point &y = plane.axes[1], &z = plane.axes[2];
    plane.axes[0] = {y[1] * z[2] - y[2] * z[1], y[2] * z[0] - y[0] * z[2], y[0] * z[1] - y[1] * z[0]};
    plane.spread[0] = std::sqrt(std::max(values[1], 0.0));
    plane.spread[1] = std::sqrt(std::max(values[0], 0.0));
    plane.spread[2] = std::sqrt(std::max(values[2], 0.0));
    return plane;
}

// Coordinates in the plane's axes, in units of the spread along y.
std::vector<Point> in_plane(const Plane& plane, const double* points, std::size_t n) {
    std::vector<Point> local(n);
    for (std::size_t i = 0; i < n; ++i) {
        for (int k = 0; k < 3; ++k) {
            double sum = 0;
            for (int c = 0; c < 3; ++c) sum += plane.axes[k][c] * (points[3 * i + c] - plane.mean[c]);
            local[i][k] = sum / plane.spread[1];
        }
    }
    return local;
}

Quadric quadric_terms(double x, double y) { return {1, x, y, x * x, x * y, y * y}; }

double quadric_height(const Quadric& quadric, double x, double y) {
    const Quadric terms = quadric_terms(x, y);
    double sum = 0;
    for (int k = 0; k < 6; ++k) sum += quadric[k] * terms[k];
    return sum;
}

Quadric fit_quadric(const std::vector<Point>& local, const std::vector<double>& weights) {
    double matrix[6][6] = {}, right[6] = {}, total = 0;
    for (std::size_t i = 0; i < local.size(); ++i) {
        if (weights[i] == 0) continue;
        const Quadric terms = quadric_terms(local[i][0], local[i][1]);
        total += weights[i];
        for (int a = 0; a < 6; ++a) {
            right[a] += weights[i] * terms[a] * local[i][2];
            for (int b = 0; b <= a; ++b) matrix[a][b] += weights[i] * terms[a] * terms[b];
        }
    }
    for (int a = 0; a < 6; ++a) matrix[a][a] += 1e-9 * total;  // where too few places differ, the flatter surface
    Quadric quadric{};
    if (solve_positive<6>(matrix, right)) std::copy(right, right + 6, quadric.begin());
    return quadric;
}

// Leave out what stands off the quadric through most of the points: an M-estimate with Tukey's weights.
void leave_out_off_surface(const std::vector<Point>& local, std::vector<unsigned char>* kept) {
    const std::size_t n = local.size();
    std::vector<double> weights(n, 1.0), off(n), sorted;
    double deviation = 0;
    for (int round = 0; round < kHeightRounds; ++round) {
        const Quadric quadric = fit_quadric(local, weights);
        for (std::size_t i = 0; i < n; ++i) off[i] = std::abs(local[i][2] - quadric_height(quadric, local[i][0], local[i][1]));
        sorted = off;
        deviation = std::max(kDeviation * median_of(sorted), kExact);
        for (std::size_t i = 0; i < n; ++i) {
            const double far = off[i] / (kTukey * deviation);
            weights[i] = far < 1 ? (1 - far * far) * (1 - far * far) : 0.0;
        }
    }
    for (std::size_t i = 0; i < n; ++i)
        if (off[i] > kOff * deviation) (*kept)[i] = 0;
}

// Distance in the plane to the fourth neighbour, infinite where it is more than kRings cells away.
std::vector<double> neighbour_distances(const std::vector<Point>& places) {
    const std::size_t n = places.size();
    double low[2] = {places[0][0], places[0][1]}, high[2] = {low[0], low[1]};
    for (const Point& place : places) {
        for (int c = 0; c < 2; ++c) {
            low[c] = std::min(low[c], place[c]);
            high[c] = std::max(high[c], place[c]);
        }
    }
    const double area = std::max((high[0] - low[0]) * (high[1] - low[1]), 1e-12 * (high[1] - low[1]) * (high[1] - low[1]));
    const double cell = std::max(std::sqrt(2 * area / static_cast<double>(n)), (high[1] - low[1]) / (4.0 * static_cast<double>(n)));
    const int columns = 1 + static_cast<int>((high[0] - low[0]) / cell), rows = 1 + static_cast<int>((high[1] - low[1]) / cell);
    std::vector<std::size_t> begins(static_cast<std::size_t>(columns) * static_cast<std::size_t>(rows) + 1, 0), order(n), at(n);
    for (std::size_t i = 0; i < n; ++i) {
        at[i] = static_cast<std::size_t>(static_cast<int>((places[i][1] - low[1]) / cell)) * static_cast<std::size_t>(columns) +
                static_cast<std::size_t>(static_cast<int>((places[i][0] - low[0]) / cell));
        ++begins[at[i] + 1];
    }
    for (std::size_t k = 1; k < begins.size(); ++k) begins[k] += begins[k - 1];
    std::vector<std::size_t> next(begins.begin(), begins.end() - 1);
    for (std::size_t i = 0; i < n; ++i) order[next[at[i]]++] = i;
    std::vector<double> distances(n, std::numeric_limits<double>::infinity());
    for (std::size_t i = 0; i < n; ++i) {
        const int row = static_cast<int>(at[i]) / columns, column = static_cast<int>(at[i]) % columns;
        for (int ring = 1; ring <= kRings; ++ring) {
            double nearest[kNeighbour];
            std::fill(nearest, nearest + kNeighbour, std::numeric_limits<double>::infinity());
            for (int r = std::max(row - ring, 0); r <= std::min(row + ring, rows - 1); ++r) {
                const std::size_t line = static_cast<std::size_t>(r) * static_cast<std::size_t>(columns);
                const std::size_t first = begins[line + static_cast<std::size_t>(std::max(column - ring, 0))];
                const std::size_t last = begins[line + static_cast<std::size_t>(std::min(column + ring, columns - 1)) + 1];
                for (std::size_t k = first; k < last; ++k) {
                    const std::size_t other = order[k];
                    if (other == i) continue;
                    const double x = places[other][0] - places[i][0], y = places[other][1] - places[i][1];
                    double square = x * x + y * y;
                    for (double& closer : nearest)
                        if (square < closer) std::swap(square, closer);
                }
            }
            const double fourth = std::sqrt(nearest[kNeighbour - 1]);
            if (fourth <= ring * cell || (ring == kRings && fourth < std::numeric_limits<double>::infinity())) {
                distances[i] = fourth;
                break;
            }
        }
    }
    return distances;
}

void leave_out_isolated(const std::vector<Point>& local, double isolation, std::vector<unsigned char>* kept) {
    std::vector<Point> places;
    std::vector<std::size_t> numbers;
    for (std::size_t i = 0; i < local.size(); ++i) {
        if (!(*kept)[i]) continue;
        places.push_back(local[i]);
        numbers.push_back(i);
    }
    if (places.size() <= kNeighbour) return;
    const std::vector<double> distances = neighbour_distances(places);
    std::vector<double> sorted = distances;
    const double median = median_of(sorted);
    for (std::size_t k = 0; k < places.size(); ++k)
        if (distances[k] > isolation * median) (*kept)[numbers[k]] = 0;
}

// How far the points nearest to a place stand off the quadric: their median.
double height_near(const std::vector<Point>& local, const std::vector<unsigned char>& kept, const Quadric& quadric, double x,
                   double y) {
    std::vector<std::pair<double, double>> near;
    for (std::size_t i = 0; i < local.size(); ++i) {
        if (!kept[i]) continue;
        const double dx = local[i][0] - x, dy = local[i][1] - y;
        near.emplace_back(dx * dx + dy * dy, local[i][2] - quadric_height(quadric, local[i][0], local[i][1]));
    }
    const std::size_t count = std::min(std::max(kFewNear, near.size() / kNearShare), near.size());
    std::nth_element(near.begin(), near.begin() + static_cast<std::ptrdiff_t>(count - 1), near.end());
    std::vector<double> heights(count);
    for (std::size_t i = 0; i < count; ++i) heights[i] = near[i].second;
    return median_of(heights);
}

bool flat_enough(const Plane& plane) { return plane.spread[1] > 0 && plane.spread[0] > kNarrowest * plane.spread[1]; }

}  // namespace

LeafOutcome leaf_frame(const double* points, const double* normals, std::size_t n, const LeafFrameSettings& settings,
                       LeafFrame* frame, std::vector<unsigned char>* kept) {
    kept->assign(n, 1);
    if (n < std::max<std::size_t>(settings.min_points, 1)) return kTooFewPoints;
    for (std::size_t i = 0; i < 3 * n; ++i)
        if (!std::isfinite(points[i])) return kNotFinite;
    Plane plane = principal_plane(points, normals, n, *kept);
    if (!flat_enough(plane)) return kDegenerate;
    if (settings.robust) {
        leave_out_off_surface(in_plane(plane, points, n), kept);
        plane = principal_plane(points, normals, n, *kept);
        if (!flat_enough(plane)) return kDegenerate;
        leave_out_isolated(in_plane(plane, points, n), settings.isolation, kept);
        const auto left = static_cast<std::size_t>(std::count(kept->begin(), kept->end(), 1));
        if (left < std::max<std::size_t>(settings.min_points, 1)) return kTooFewPoints;
        plane = principal_plane(points, normals, n, *kept);
        if (!flat_enough(plane)) return kDegenerate;
    }
    const std::vector<Point> local = in_plane(plane, points, n);
    std::vector<double> flat, weights(n);
    double low = std::numeric_limits<double>::infinity(), high = -low;
    for (std::size_t i = 0; i < n; ++i) {
        weights[i] = (*kept)[i];
        if (!(*kept)[i]) continue;
        flat.push_back(local[i][0]);
        flat.push_back(local[i][1]);
        low = std::min(low, local[i][2]);
        high = std::max(high, local[i][2]);
    }
    const Ellipse ellipse = enclosing_ellipse(flat.data(), flat.size() / 2, kEllipseTolerance);
    if (!(ellipse.half[1] > kNarrowest * ellipse.half[0])) return kDegenerate;
    double along[2] = {std::cos(ellipse.angle), std::sin(ellipse.angle)};
    if (along[1] < 0)
        for (double& coordinate : along) coordinate = -coordinate;
    // Base and apex: x and y are those of the ellipse's far ends (section 5.1); the height is that of the surface there.
    const Quadric quadric = fit_quadric(local, weights);
    double ends[2][3];
    for (int end = 0; end < 2; ++end) {
        for (int c = 0; c < 2; ++c) ends[end][c] = ellipse.center[c] + (end == 0 ? -1.0 : 1.0) * ellipse.half[0] * along[c];
        ends[end][2] = std::clamp(quadric_height(quadric, ends[end][0], ends[end][1]), low, high) +
                       height_near(local, *kept, quadric, ends[end][0], ends[end][1]);
    }
    double y[3], length = 0;
    for (int c = 0; c < 3; ++c) length += (ends[1][c] - ends[0][c]) * (ends[1][c] - ends[0][c]);
    length = std::sqrt(length);
    for (int c = 0; c < 3; ++c) y[c] = (ends[1][c] - ends[0][c]) / length;
    const double across = std::hypot(y[0], y[1]);
    const double x[3] = {y[1] / across, -y[0] / across, 0};
    const double z[3] = {x[1] * y[2] - x[2] * y[1], x[2] * y[0] - x[0] * y[2], x[0] * y[1] - x[1] * y[0]};
    const double* leaf_axes[3] = {x, y, z};
    for (int c = 0; c < 3; ++c) {
        frame->base[c] = plane.mean[c];
        for (int k = 0; k < 3; ++k) {
            frame->base[c] += plane.spread[1] * ends[0][k] * plane.axes[k][c];
            frame->axes[k][c] = 0;
            for (int m = 0; m < 3; ++m) frame->axes[k][c] += leaf_axes[k][m] * plane.axes[m][c];
        }
    }
    frame->length = length * plane.spread[1];
    frame->half_width = ellipse.half[1] / length;
    frame->half_length = 0.5;
    return kFitted;
}

}  // namespace usdfoliage
