#include "leaf/closest.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "leaf/pose.h"
#include "parallel.h"
#include "vector_clones.h"

namespace usdfoliage {
namespace {

constexpr std::size_t kGridU = 9, kGridV = 15;  // places among which the closest is looked for
constexpr std::size_t kEdgeV = 33;              // places along either silhouette
constexpr std::size_t kTogether = 3;            // samples compared with a point before the next
constexpr double kMidrib = 1e-9;                // |u| of a place that came to the crease
constexpr double kNoLength = 1e-12;             // a direction shorter than this is none
constexpr int kProjectionSteps = 4;

// Places spread over the surface.
template <std::size_t N>
struct Samples {
    double u[N], v[N], point[3][N];
};

template <std::size_t Columns, std::size_t Rows>
void sample_surface(const LeafCurves& curves, Samples<Columns * Rows>& samples) {
    for (std::size_t k = 0; k < Rows; ++k) {
        const double v = static_cast<double>(k) / (Rows - 1);
        const LeafRow row = leaf_row(curves, along_at(v));
        for (std::size_t i = 0; i < Columns; ++i) {
            const double u = 2.0 * static_cast<double>(i) / (Columns - 1) - 1;
            double point[3];
            leaf_point(row, across_at(u), point);
            samples.u[Columns * k + i] = u;
            samples.v[Columns * k + i] = v;
            for (int c = 0; c < 3; ++c) samples.point[c][Columns * k + i] = point[c];
        }
    }
}

// Look for the closest sample to each point, some samples at once; of equal ones the first.
//
// @param closest  squared distance of the closest so far, written again
// @param number   which it is, likewise
USDFOLIAGE_VECTOR_CLONES
void compare_samples(const double (&samples)[3][kTogether], double first, const double* __restrict px,
                     const double* __restrict py, const double* __restrict pz, std::size_t n, double* __restrict closest,
                     double* __restrict number) {
    for (std::size_t i = 0; i < n; ++i) {
        double best = closest[i], which = number[i];
        for (std::size_t k = 0; k < kTogether; ++k) {
            const double x = samples[0][k] - px[i], y = samples[1][k] - py[i], z = samples[2][k] - pz[i];
            const double square = x * x + y * y + z * z;
            which = square < best ? first + static_cast<double>(k) : which;
            best = square < best ? square : best;
        }
        closest[i] = best;
        number[i] = which;
    }
}

template <std::size_t N>
void begin_at_closest(const Samples<N>& samples, const double* const points[3], std::size_t n, double* u, double* v) {
    static_assert(N % kTogether == 0);
    double* closest = u;
    double* number = v;
    std::fill(closest, closest + n, std::numeric_limits<double>::infinity());
    std::fill(number, number + n, 0.0);
    for (std::size_t k = 0; k < N; k += kTogether) {
        double some[3][kTogether];
        for (int c = 0; c < 3; ++c) std::copy(samples.point[c] + k, samples.point[c] + k + kTogether, some[c]);
        compare_samples(some, static_cast<double>(k), points[0], points[1], points[2], n, closest, number);
    }
    for (std::size_t i = 0; i < n; ++i) {
        const auto k = static_cast<std::size_t>(number[i]);
        u[i] = samples.u[k];
        v[i] = samples.v[k];
    }
}

inline double dot3(const double* a, const double* b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

// std::clamp without references, which would keep loops from becoming vectors.
inline double clamped(double x, double low, double high) {
    const double above = x < low ? low : x;
    return above > high ? high : above;
}

// Step towards the closest places of the surface; a place stays on the border where the point lies beyond, and lands on the
// crease before it goes over to the other half.
USDFOLIAGE_VECTOR_CLONES
void slide_over(const LeafCurves& given, const double* __restrict px, const double* __restrict py, const double* __restrict pz,
                std::size_t n, double* __restrict us, double* __restrict vs) {
    const LeafCurves curves = given;
    for (std::size_t i = 0; i < n; ++i) {
        const double old_u = us[i], old_v = vs[i];
        const SurfacePlace place = surface_place(curves, old_u, old_v);
        const double offset[3] = {px[i] - place.point[0], py[i] - place.point[1], pz[i] - place.point[2]};
        const double aa = dot3(place.by_u, place.by_u), cc = dot3(place.by_v, place.by_v);
        const double damping = 1e-9 + 1e-6 * (aa + cc), a = aa + damping, c = cc + damping;
        const double b = dot3(place.by_u, place.by_v), e = dot3(place.by_u, offset), f = dot3(place.by_v, offset);
        const double product = a * c - b * b, determinant = product < 1e-15 ? 1e-15 : product;
        const double free_u = (c * e - b * f) / determinant, free_v = (a * f - b * e) / determinant;
        const double along_u = e / a, along_v = f / c;
        const bool fixed_u = ((old_u >= 1) & (free_u > 0)) | ((old_u <= -1) & (free_u < 0));
        const bool fixed_v = ((old_v >= 1) & (free_v > 0)) | ((old_v <= 0) & (free_v < 0));
        const double du = fixed_u ? 0.0 : fixed_v ? along_u : free_u, dv = fixed_v ? 0.0 : fixed_u ? along_v : free_v;
        const double u = clamped(old_u + clamped(du, -0.3, 0.3), -1.0, 1.0);
        const bool crossed = (u * old_u < 0) & (std::abs(old_u) > kMidrib);
        us[i] = crossed ? (u < 0 ? -kMidrib : kMidrib) : u;
        vs[i] = clamped(old_v + clamped(dv, -0.2, 0.2), 0.0, 1.0);
    }
}

// Step towards the closest places of the silhouette.
USDFOLIAGE_VECTOR_CLONES
void slide_along(const LeafCurves& given, const double* __restrict px, const double* __restrict py, const double* __restrict pz,
                 std::size_t n, const double* __restrict us, double* __restrict vs) {
    const LeafCurves curves = given;
    for (std::size_t i = 0; i < n; ++i) {
        const SurfacePlace place = surface_place(curves, us[i], vs[i]);
        const double offset[3] = {px[i] - place.point[0], py[i] - place.point[1], pz[i] - place.point[2]};
        const double square = dot3(place.by_v, place.by_v), speed = square < 1e-9 ? 1e-9 : square;
        vs[i] = clamped(vs[i] + clamped(dot3(offset, place.by_v) / speed, -0.05, 0.05), 0.0, 1.0);
    }
}

// What of the offsets from the closest places counts.
//
// @param beside  |u| from which on a place is on the silhouette
USDFOLIAGE_VECTOR_CLONES
void measure(const LeafCurves& given, const double* __restrict px, const double* __restrict py, const double* __restrict pz,
             const double* __restrict us, const double* __restrict vs, double beside, std::size_t n, std::size_t stride,
             double* __restrict measured) {
    const LeafCurves curves = given;
#pragma GCC ivdep
    for (std::size_t i = 0; i < n; ++i) {
        const double u = us[i], v = vs[i];
        const SurfacePlace place = surface_place(curves, u, v);
        const double *s = place.by_u, *t = place.by_v;
        const double offset[3] = {px[i] - place.point[0], py[i] - place.point[1], pz[i] - place.point[2]};
        const double cross[3] = {s[1] * t[2] - s[2] * t[1], s[2] * t[0] - s[0] * t[2], s[0] * t[1] - s[1] * t[0]};
        const double area = std::sqrt(dot3(cross, cross)), speed = std::sqrt(dot3(t, t));
        const bool tip = (v <= 0) | (v >= 1) | !(area > kNoLength) | !(speed > kNoLength);
        const double per_area = 1 / (area > kNoLength ? area : 1.0), per_speed = 1 / (speed > kNoLength ? speed : 1.0);
        const double normal[3] = {cross[0] * per_area, cross[1] * per_area, cross[2] * per_area};
        const double along[3] = {t[0] * per_speed, t[1] * per_speed, t[2] * per_speed};
        const double outward[3] = {along[1] * normal[2] - along[2] * normal[1], along[2] * normal[0] - along[0] * normal[2],
                                   along[0] * normal[1] - along[1] * normal[0]};
        const double up = dot3(normal, offset), out = dot3(outward, offset);
        const double inside = up * up, side = inside + out * out, whole = dot3(offset, offset);
        for (int c = 0; c < 3; ++c) {
            measured[i + stride * c] = place.point[c];
            measured[i + stride * (3 + c)] = offset[c];
            measured[i + stride * (6 + c)] = normal[c];
            measured[i + stride * (9 + c)] = outward[c];
        }
        measured[i + stride * 12] = tip ? 3.0 : std::abs(u) >= beside ? 2.0 : 1.0;
        measured[i + stride * 13] = tip ? whole : std::abs(u) >= beside ? side : inside;
    }
}

}  // namespace

void ClosestPlaces::search(const LeafCurves& curves) {
    const double* const points[3] = {array(0), array(1), array(2)};
    Samples<kGridU * kGridV> surface;
    sample_surface<kGridU, kGridV>(curves, surface);
    begin_at_closest(surface, points, inside_, array(3), array(4));
    if (size_ == inside_) return;
    const double* const of_edge[3] = {array(0) + inside_, array(1) + inside_, array(2) + inside_};
    Samples<2 * kEdgeV> silhouette;
    sample_surface<2, kEdgeV>(curves, silhouette);
    begin_at_closest(silhouette, of_edge, size_ - inside_, array(3) + inside_, array(4) + inside_);
}

void ClosestPlaces::begin_at(const ClosestPlaces& other) {
    std::copy(other.u(), other.u() + size_, array(3));
    std::copy(other.v(), other.v() + size_, array(4));
}

void ClosestPlaces::approach(const LeafCurves& curves, int steps) {
    double *u = array(3), *v = array(4);
    for (int step = 0; step < steps; ++step) {
        slide_over(curves, array(0), array(1), array(2), inside_, u, v);
        slide_along(curves, array(0) + inside_, array(1) + inside_, array(2) + inside_, size_ - inside_, u + inside_,
                    v + inside_);
    }
    measure(curves, array(0), array(1), array(2), u, v, 1.0, inside_, size_, array(5));
    measure(curves, array(0) + inside_, array(1) + inside_, array(2) + inside_, u + inside_, v + inside_, 0.0,
            size_ - inside_, size_, array(5) + inside_);
}

void project_to_leaves(const double* points, const std::uint8_t* edge, const std::int64_t* offsets, const double* parameters,
                       const double* axes, const double* bases, const double* lengths, std::size_t n, double* uv,
                       double* distances, int threads) {
    parallel_for(n, threads, [&](std::size_t leaf) {
        const std::size_t first = static_cast<std::size_t>(offsets[leaf]), last = static_cast<std::size_t>(offsets[leaf + 1]);
        const LeafPose pose = leaf_pose(parameters + kLeafNumbers * leaf, axes + 9 * leaf, bases + 3 * leaf, lengths[leaf]);
        const LeafCurves curves = leaf_curves(pose.parameters);
        std::size_t on_edge = 0;
        for (std::size_t i = first; i < last; ++i) on_edge += edge[i] != 0;
        ClosestPlaces places(last - first - on_edge, on_edge);
        std::vector<std::size_t> order(last - first);
        std::size_t next[2] = {0, places.inside()};
        for (std::size_t i = first; i < last; ++i) {
            const std::size_t k = order[i - first] = next[edge[i] != 0]++;
            double local[3];
            localize_point(pose, points + 3 * i, local);
            for (std::size_t c = 0; c < 3; ++c) places.point(c)[k] = local[c];
        }
        places.search(curves);
        places.approach(curves, kProjectionSteps);
        for (std::size_t i = first; i < last; ++i) {
            const std::size_t k = order[i - first];
            const double x = places.offset(0)[k], y = places.offset(1)[k], z = places.offset(2)[k];
            uv[2 * i] = places.u()[k];
            uv[2 * i + 1] = places.v()[k];
            distances[i] = pose.length * std::sqrt(x * x + y * y + z * z);
        }
    });
}

}  // namespace usdfoliage
