#include "leaf/surface.h"

#include <optional>
#include <vector>

#include "leaf/curves.h"
#include "parallel.h"

namespace usdfoliage {
namespace {

constexpr std::size_t kBlockSamples = 16384;  // samples a thread takes at once
constexpr double kNoArea = 1e-12;             // a cross product shorter than this has no direction
constexpr double kTurn = 6.283185307179586476925286766559;

// The weights at p places; places that follow each other at one v share a row.
struct Places {
    std::vector<double> v;
    std::vector<Along> along, along_slope;      // one a row
    std::vector<Across> across, across_slope;  // one a place
    std::vector<std::size_t> row_ends;         // one a row: the place behind its last

    void set(const double* uv, std::size_t p) {
        v.clear(), along.clear(), along_slope.clear(), across.clear(), across_slope.clear(), row_ends.clear();
        for (std::size_t k = 0; k < p; ++k) {
            if (k == 0 || uv[2 * k + 1] != uv[2 * k - 1]) {
                v.push_back(uv[2 * k + 1]);
                along.push_back(along_at(v.back()));
                along_slope.push_back(along_slope_at(v.back()));
                row_ends.push_back(k);
            }
            across.push_back(across_at(uv[2 * k]));
            across_slope.push_back(across_slope_at(uv[2 * k]));
            row_ends.back() = k + 1;
        }
    }
};

// J and its derivative, at a place counted in cycles.
void wave_at(const LeafJitter& jitter, double cycles, double* wave, double* slope) {
    if (jitter.map != nullptr) {
        const double size = static_cast<double>(jitter.n_map);
        const double place = (cycles - std::floor(cycles)) * size - 0.5, low = std::floor(place);
        const std::size_t first = low >= 0 ? static_cast<std::size_t>(low) % jitter.n_map : jitter.n_map - 1;
        const double from = jitter.map[first], to = jitter.map[(first + 1) % jitter.n_map];
        *wave = from + (place - low) * (to - from);
        *slope = (to - from) * size;
        return;
    }
    *wave = *slope = 0;
    for (std::size_t k = 0; k < jitter.n_waves; ++k) {
        const double rate = kTurn * jitter.waves[2 * k], weight = jitter.waves[2 * k + 1];
        *wave += weight * std::sin(rate * cycles);
        *slope += weight * rate * std::cos(rate * cycles);
    }
}

// How far the right silhouette is moved at v, and the derivative.
void move_silhouette(const double* leaf, const LeafJitter& jitter, double phase, double v, double* moved, double* moved_slope) {
    double wave, slope;
    wave_at(jitter, jitter.frequency * v + phase, &wave, &slope);
    const double middle = 2 * v - 1, squared = middle * middle, cubed = squared * middle;
    const double fade = 1 - squared * squared * squared * squared, fade_slope = -16 * squared * squared * cubed;
    const double height = jitter.amplitude * wave * fade;
    const double height_slope = jitter.amplitude * (jitter.frequency * slope * fade + wave * fade_slope);
    const AxisAt at = axis_at(leaf, v);
    const AxisFrame frame = axis_frame(at);
    double turned[2];
    turn_normal(frame, at.bend[0], at.bend[1], turned);
    for (int c = 0; c < 2; ++c) {
        moved[c] = height * frame.normal[c];
        moved_slope[c] = height_slope * frame.normal[c] + height * turned[c];
    }
}

void cross(const double* a, const double* b, double* product) {
    product[0] = a[1] * b[2] - a[2] * b[1];
    product[1] = a[2] * b[0] - a[0] * b[2];
    product[2] = a[0] * b[1] - a[1] * b[0];
}

double length(const double* a) { return std::sqrt(a[0] * a[0] + a[1] * a[1] + a[2] * a[2]); }

// A placement of points, of tangents, and of their cross products.
struct Placement {
    double linear[3][3], cofactor[3][3], origin[3];

    explicit Placement(const double* rows) {
        for (int r = 0; r < 3; ++r) {
            for (int c = 0; c < 3; ++c) linear[r][c] = rows[4 * r + c];
            origin[r] = rows[4 * r + 3];
        }
        for (int r = 0; r < 3; ++r) cross(linear[(r + 1) % 3], linear[(r + 2) % 3], cofactor[r]);
    }
};

void turn(const double (&matrix)[3][3], double* vector) {
    const double x = vector[0], y = vector[1], z = vector[2];
    for (int r = 0; r < 3; ++r) vector[r] = matrix[r][0] * x + matrix[r][1] * y + matrix[r][2] * z;
}

template <typename Real>
void put(const double* vector, Real* target) {
    for (int c = 0; c < 3; ++c) target[c] = static_cast<Real>(vector[c]);
}

// The unit of a cross product; +z where it is none.
void make_unit(double* product) {
    const double size = length(product);
    const bool none = !(size > kNoArea);
    for (int c = 0; c < 3; ++c) product[c] = none ? (c == 2 ? 1.0 : 0.0) : product[c] / size;
}

template <typename Real>
void write_points(const std::vector<LeafRow>& rows, const Places& places, const Placement* placement, Real* points) {
    std::size_t k = 0;
    for (std::size_t r = 0; r < rows.size(); ++r) {
        const LeafRow row = rows[r];
        for (; k < places.row_ends[r]; ++k) {
            double point[3];
            leaf_point(row, places.across[k], point);
            if (placement != nullptr) {
                turn(placement->linear, point);
                for (int c = 0; c < 3; ++c) point[c] += placement->origin[c];
            }
            put(point, points + 3 * k);
        }
    }
}

template <typename Real>
void write_slopes(const std::vector<LeafRow>& rows, const std::vector<LeafRow>& row_slopes, const Places& places,
                  const Placement* placement, const LeafSamples<Real>& samples) {
    std::size_t k = 0;
    for (std::size_t r = 0; r < rows.size(); ++r) {
        const LeafRow row = rows[r], row_slope = row_slopes[r];
        // At base and apex all of a row meets: there the derivative by u vanishes and its change along v takes its place.
        const double end = places.v[r] == 0 ? 1 : places.v[r] == 1 ? -1 : 0;
        for (; k < places.row_ends[r]; ++k) {
            double by_u[3], by_v[3], product[3];
            leaf_point(row, places.across_slope[k], by_u);
            leaf_point(row_slope, places.across[k], by_v);
            if (samples.areas != nullptr) {
                cross(by_u, by_v, product);
                if (placement != nullptr) turn(placement->cofactor, product);
                samples.areas[k] = static_cast<Real>(length(product));
            }
            if (samples.normals != nullptr) {
                double spread[3] = {by_u[0], by_u[1], by_u[2]};
                if (end != 0) {
                    leaf_point(row_slope, places.across_slope[k], spread);
                    for (int c = 0; c < 3; ++c) spread[c] *= end;
                }
                cross(spread, by_v, product);
                make_unit(product);
                if (placement != nullptr) {
                    turn(placement->cofactor, product);
                    const double size = length(product);
                    for (int c = 0; c < 3 && size > 0; ++c) product[c] /= size;
                }
                put(product, samples.normals + 3 * k);
            }
            if (placement != nullptr) {
                turn(placement->linear, by_u);
                turn(placement->linear, by_v);
            }
            if (samples.tangents_u != nullptr) put(by_u, samples.tangents_u + 3 * k);
            if (samples.tangents_v != nullptr) put(by_v, samples.tangents_v + 3 * k);
        }
    }
}

}  // namespace

template <typename Real>
void leaf_samples(const double* leaves, std::size_t n, const double* uv, std::size_t p, bool shared_uv,
                  const LeafJitter& jitter, const double* placements, const LeafSamples<Real>& samples, int threads) {
    if (p == 0) return;
    Places shared;
    if (shared_uv) shared.set(uv, p);
    const bool slopes = samples.tangents_u || samples.tangents_v || samples.normals || samples.areas;
    const std::size_t block = std::max<std::size_t>(1, kBlockSamples / p);
    parallel_for((n + block - 1) / block, threads, [&](std::size_t b) {
        Places own;
        std::vector<LeafRow> rows, row_slopes;
        for (std::size_t i = b * block; i < std::min(n, (b + 1) * block); ++i) {
            if (!shared_uv) own.set(uv + 2 * p * i, p);
            const Places& places = shared_uv ? shared : own;
            const double* leaf = leaves + kLeafNumbers * i;
            const LeafCurves curves = leaf_curves(leaf);
            rows.clear(), row_slopes.clear();
            for (std::size_t r = 0; r < places.v.size(); ++r) {
                rows.push_back(leaf_row(curves, places.along[r]));
                row_slopes.push_back(slopes ? leaf_row(curves, places.along_slope[r]) : LeafRow());
                if (jitter.amplitude != 0) {
                    const double phase = jitter.phases != nullptr ? jitter.phases[i] : 0.0;
                    move_silhouette(leaf, jitter, phase, places.v[r], rows.back().moved, row_slopes.back().moved);
                }
            }
            std::optional<Placement> placement;
            if (placements != nullptr) placement.emplace(placements + 12 * i);
            const Placement* placed = placement ? &*placement : nullptr;
            const auto at = [&](Real* array) { return array != nullptr ? array + 3 * p * i : nullptr; };
            const LeafSamples<Real> own_samples{at(samples.points), at(samples.tangents_u), at(samples.tangents_v),
                                                at(samples.normals),
                                                samples.areas != nullptr ? samples.areas + p * i : nullptr};
            if (own_samples.points != nullptr) write_points(rows, places, placed, own_samples.points);
            if (slopes) write_slopes(rows, row_slopes, places, placed, own_samples);
        }
    });
}

template void leaf_samples<float>(const double*, std::size_t, const double*, std::size_t, bool, const LeafJitter&,
                                  const double*, const LeafSamples<float>&, int);
template void leaf_samples<double>(const double*, std::size_t, const double*, std::size_t, bool, const LeafJitter&,
                                   const double*, const LeafSamples<double>&, int);

}  // namespace usdfoliage
