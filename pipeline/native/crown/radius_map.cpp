#include "crown/radius_map.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "parallel.h"

namespace usdfoliage {
namespace {

using Vec3 = std::array<double, 3>;

double dot(const Vec3& a, const Vec3& b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

Vec3 cross(const Vec3& a, const Vec3& b) {
    return {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
}

// Normal, right and up of +X −X +Y −Y +Z −Z, as in usdfoliage.geometry.cubemap.
constexpr double kFaceAxes[6][3][3] = {
    {{1, 0, 0}, {0, 0, 1}, {0, 1, 0}},  {{-1, 0, 0}, {0, 0, -1}, {0, 1, 0}}, {{0, 1, 0}, {1, 0, 0}, {0, 0, 1}},
    {{0, -1, 0}, {1, 0, 0}, {0, 0, -1}}, {{0, 0, 1}, {-1, 0, 0}, {0, 1, 0}},  {{0, 0, -1}, {1, 0, 0}, {0, 1, 0}},
};

struct Box {
    double low[2] = {std::numeric_limits<double>::infinity(), std::numeric_limits<double>::infinity()};
    double high[2] = {-std::numeric_limits<double>::infinity(), -std::numeric_limits<double>::infinity()};
    void add(double depth, double x, double y) {
        const double at[2] = {x / depth, y / depth};
        for (int k = 0; k < 2; ++k) {
            low[k] = std::min(low[k], at[k]);
            high[k] = std::max(high[k], at[k]);
        }
    }
};

// Bounds of the image of a triangle on the plane at distance 1, after clipping what lies behind the origin.
Box image_bounds(const std::array<Vec3, 3>& seen) {
    constexpr double kNear = 1e-9;
    Box box;
    for (int k = 0; k < 3; ++k) {
        const Vec3 &p = seen[k], &q = seen[(k + 1) % 3];
        if (p[0] > kNear) box.add(p[0], p[1], p[2]);
        if ((p[0] > kNear) != (q[0] > kNear)) {
            const double t = (kNear - p[0]) / (q[0] - p[0]);
            box.add(kNear, p[1] + t * (q[1] - p[1]), p[2] + t * (q[2] - p[2]));
        }
    }
    return box;
}

void render_face(int face, const double* points, const std::int32_t* triangles, std::size_t n_triangles, int size,
                 double* radius, std::int32_t* triangle) {
    Vec3 axis[3];
    for (int k = 0; k < 3; ++k) axis[k] = {kFaceAxes[face][k][0], kFaceAxes[face][k][1], kFaceAxes[face][k][2]};
    const double half = (size - 1) / 2.0;
    const auto first_texel = [&](double low) {
        return static_cast<int>(std::clamp(std::ceil((low + 1) * half - 1e-6), 0.0, static_cast<double>(size)));
    };
    const auto last_texel = [&](double high) {
        return static_cast<int>(std::clamp(std::floor((high + 1) * half + 1e-6), -1.0, size - 1.0));
    };
    for (std::size_t t = 0; t < n_triangles; ++t) {
        Vec3 corner[3];
        std::array<Vec3, 3> seen;
        for (int k = 0; k < 3; ++k) {
            const double* p = points + 3 * static_cast<std::size_t>(triangles[3 * t + k]);
            corner[k] = {p[0], p[1], p[2]};
            seen[k] = {dot(axis[0], corner[k]), dot(axis[1], corner[k]), dot(axis[2], corner[k])};
        }
        const Box box = image_bounds(seen);
        if (!(box.low[0] <= box.high[0])) continue;  // wholly behind
        const int column_end = last_texel(box.high[0]), row_end = last_texel(-box.low[1]);
        const int column_start = first_texel(box.low[0]), row_start = first_texel(-box.high[1]);
        if (column_start > column_end || row_start > row_end) continue;

        // Edge planes through the origin; two triangles that share an edge get exactly opposite ones, so no ray slips
        // between them.
        const Vec3 edge[3] = {cross(corner[1], corner[2]), cross(corner[2], corner[0]), cross(corner[0], corner[1])};
        const double volume = dot(corner[0], edge[0]);
        if (volume == 0) continue;  // seen edge-on
        const double side = volume > 0 ? 1 : -1;
        for (int row = row_start; row <= row_end; ++row) {
            const double up = 1 - row / half;
            for (int column = column_start; column <= column_end; ++column) {
                const double right = column / half - 1;
                Vec3 ray;
                for (int k = 0; k < 3; ++k) ray[k] = axis[0][k] + right * axis[1][k] + up * axis[2][k];
                const double a = side * dot(edge[0], ray), b = side * dot(edge[1], ray), c = side * dot(edge[2], ray);
                if (a < 0 || b < 0 || c < 0) continue;
                const double sum = a + b + c;
                if (sum <= 0) continue;
                const double distance = side * volume / sum * std::sqrt(1 + right * right + up * up);
                const std::size_t texel = static_cast<std::size_t>(row) * size + column;
                if (distance > radius[texel]) {
                    radius[texel] = distance;
                    triangle[texel] = static_cast<std::int32_t>(t);
                }
            }
        }
    }
}

}  // namespace

RadiusMap radius_map(const double* points, std::size_t, const std::int32_t* triangles, std::size_t n_triangles, int size,
                     int threads) {
    const std::size_t texels = static_cast<std::size_t>(size) * size;
    RadiusMap map{std::vector<double>(6 * texels, 0.0), std::vector<std::int32_t>(6 * texels, -1)};
    parallel_for(6, threads, [&](std::size_t face) {
        render_face(static_cast<int>(face), points, triangles, n_triangles, size, map.radius.data() + face * texels,
                    map.triangle.data() + face * texels);
    });
    return map;
}

}  // namespace usdfoliage
