#include "segmentation/depth_coherence.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "parallel.h"

namespace usdfoliage {

namespace {

using Matrix = std::array<double, 12>;  // 3 x 4, rows first

// One camera's axes from another's: a * b^-1 of two rigid motions.
Matrix relative(const double* a, const double* b) {
    Matrix result{};
    for (int i = 0; i < 3; ++i) {
        double* row = &result[4 * i];
        for (int j = 0; j < 3; ++j) {
            for (int k = 0; k < 3; ++k) row[j] += a[4 * i + k] * b[4 * j + k];
        }
        row[3] = a[4 * i + 3];
        for (int j = 0; j < 3; ++j) row[3] -= row[j] * b[4 * j + 3];
    }
    return result;
}

std::array<double, 3> unproject(const DepthView& view, int column, int row, double depth) {
    return {(column + 0.5 - view.center[0]) / view.focal[0] * depth, (row + 0.5 - view.center[1]) / view.focal[1] * depth, depth};
}

// Depth of other's points in the pixels of view, the nearest of each pixel.
std::vector<float> warp(const DepthView& view, const DepthView& other) {
    std::vector<float> layer(view.pixels(), 0.0f);
    const Matrix m = relative(view.cam_from_world, other.cam_from_world);
    // A point is its depth times the turned ray of its pixel, which is the sum of a part of the column and one of the row,
    // plus the way between the cameras; scaled so that the quotient is in pixels.
    const std::size_t width = static_cast<std::size_t>(other.width);
    std::vector<float> across(width), along(width), ahead(width), u(width), v(width), z(width);
    const auto scaled = [&](const double x, const double y, const double w) {
        const double depth = m[8] * x + m[9] * y + m[10] * w;
        return std::array<float, 3>{
            static_cast<float>((m[0] * x + m[1] * y + m[2] * w) * view.focal[0] + depth * view.center[0]),
            static_cast<float>((m[4] * x + m[5] * y + m[6] * w) * view.focal[1] + depth * view.center[1]), static_cast<float>(depth)};
    };
    for (std::size_t column = 0; column < width; ++column) {
        const std::array<float, 3> part = scaled((static_cast<double>(column) + 0.5 - other.center[0]) / other.focal[0], 0, 1);
        across[column] = part[0];
        along[column] = part[1];
        ahead[column] = part[2];
    }
    const float tu = static_cast<float>(m[3] * view.focal[0] + m[11] * view.center[0]);
    const float tv = static_cast<float>(m[7] * view.focal[1] + m[11] * view.center[1]), tz = static_cast<float>(m[11]);
    const float right = static_cast<float>(view.width), bottom = static_cast<float>(view.height);
    for (int row = 0; row < other.height; ++row) {
        const float* depth = other.depth_m + static_cast<std::size_t>(row) * width;
        const std::array<float, 3> part = scaled(0, (row + 0.5 - other.center[1]) / other.focal[1], 0);
        for (std::size_t k = 0; k < width; ++k) {
            const float d = depth[k], distance = d * (ahead[k] + part[2]) + tz;
            const bool known = (d > 0) & (distance > 0);
            z[k] = known ? distance : 0.0f;
            u[k] = (d * (across[k] + part[0]) + tu) / (known ? distance : 1.0f);
            v[k] = (d * (along[k] + part[1]) + tv) / (known ? distance : 1.0f);
        }
        for (std::size_t k = 0; k < width; ++k) {
            if (!(z[k] > 0 && u[k] >= 0 && u[k] < right && v[k] >= 0 && v[k] < bottom)) continue;
            float& nearest = layer[static_cast<std::size_t>(v[k]) * static_cast<std::size_t>(view.width) + static_cast<std::size_t>(u[k])];
            if (nearest == 0 || z[k] < nearest) nearest = z[k];
        }
    }
    return layer;
}

struct Cluster {
    int size;
    float mean;
};

Cluster cluster_around(const std::vector<float>& depths, float depth, float tolerance) {
    Cluster cluster{0, 0};
    double sum = 0;
    for (const float other : depths) {
        if (std::fabs(other - depth) < tolerance) {
            ++cluster.size;
            sum += other;
        }
    }
    if (cluster.size) cluster.mean = static_cast<float>(sum / cluster.size);
    return cluster;
}

}  // namespace

void fuse_depth(const DepthView& view, const std::vector<DepthView>& others, const FuseSettings& settings, int threads, float* depth_m,
                std::uint8_t* kinds) {
    std::vector<std::vector<float>> layers(others.size());
    std::vector<Matrix> other_from_view(others.size());
    parallel_for(others.size(), threads, [&](std::size_t k) {
        layers[k] = warp(view, others[k]);
        other_from_view[k] = relative(others[k].cam_from_world, view.cam_from_world);
    });
    const auto tolerance = [&](double depth, double focal) {
        return static_cast<float>(settings.noise_m + settings.footprints * depth / focal);
    };
    const double focal = view.focal_mean();

    parallel_for(static_cast<std::size_t>(view.height), threads, [&](std::size_t index) {
        const int row = static_cast<int>(index);
        std::vector<float> depths;
        for (int column = 0; column < view.width; ++column) {
            const std::size_t i = index * static_cast<std::size_t>(view.width) + static_cast<std::size_t>(column);
            const float own = view.depth_m[i];
            depths.clear();
            if (own > 0) depths.push_back(own);
            for (const std::vector<float>& layer : layers) {
                if (layer[i] > 0) depths.push_back(layer[i]);
            }
            depth_m[i] = 0;
            kinds[i] = kNoDepth;
            if (depths.empty()) continue;

            // A mean over those that agree with the mean, so that it hangs less on which one was asked first.
            const auto settle = [&](const Cluster& first) {
                const Cluster second = cluster_around(depths, first.mean, tolerance(first.mean, focal));
                return second.size >= first.size ? second.mean : first.mean;
            };
            if (own > 0) {
                const Cluster agreeing = cluster_around(depths, own, tolerance(own, focal));
                if (agreeing.size >= settings.min_own) {
                    depth_m[i] = settle(agreeing);
                    kinds[i] = kConfirmed;
                    continue;
                }
                const std::array<double, 3> p = unproject(view, column, row, own);
                bool could_be_seen = false;
                int confirmed = 1;
                for (std::size_t k = 0; k < others.size(); ++k) {
                    const Sighting seen = see(others[k], other_from_view[k].data(), p[0], p[1], p[2]);
                    if (seen.pixel < 0) continue;
                    const float theirs = others[k].depth_m[seen.pixel];
                    const float near = tolerance(seen.depth_m, others[k].focal_mean());
                    const float beyond = theirs - static_cast<float>(seen.depth_m);
                    if (!(theirs > 0) || beyond < -near) continue;
                    could_be_seen = true;
                    if (beyond < near) ++confirmed;  // its point fell into the pixel beside this one
                }
                if (!could_be_seen || confirmed >= settings.min_own) {
                    depth_m[i] = own;
                    kinds[i] = could_be_seen ? kConfirmed : kAlone;
                    continue;
                }
                kinds[i] = kRemoved;
            }
            std::sort(depths.begin(), depths.end());
            for (const float depth : depths) {
                const Cluster agreeing = cluster_around(depths, depth, tolerance(depth, focal));
                if (agreeing.size < settings.min_others) continue;
                depth_m[i] = settle(agreeing);
                kinds[i] = own > 0 ? kReplaced : kFilled;
                break;
            }
        }
    });
}

}  // namespace usdfoliage
