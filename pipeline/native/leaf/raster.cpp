#include "leaf/raster.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include "parallel.h"

namespace usdfoliage {
namespace {

constexpr std::size_t kBandRows = 32;  // rows of pixels that one thread draws at a time

struct Vertex {
    double x, y, depth;
    bool drawn;
};

Vertex vertex_at(const double* place) {
    const bool drawn = std::isfinite(place[0]) && std::isfinite(place[1]) && std::isfinite(place[2]) && place[2] > 0;
    return {place[0], place[1], place[2], drawn};
}

// Least and greatest y of a grid; an empty range for one that is nowhere before the camera.
struct Rows {
    double low = std::numeric_limits<double>::infinity(), high = -std::numeric_limits<double>::infinity();
};

Rows rows_of(const double* grid, std::size_t vertices) {
    Rows rows;
    for (std::size_t k = 0; k < vertices; ++k) {
        const Vertex vertex = vertex_at(grid + 3 * k);
        if (!vertex.drawn) continue;
        rows.low = std::min(rows.low, vertex.y);
        rows.high = std::max(rows.high, vertex.y);
    }
    return rows;
}

// The rows of pixels from begin to end, of a picture this wide.
struct Band {
    std::int32_t* ids;
    float* depth;
    std::size_t width, begin, end;

    // First pixel, within [first, last], whose centre lies at or beyond low.
    static std::size_t first_from(double low, std::size_t first, std::size_t last) {
        return static_cast<std::size_t>(std::clamp(std::ceil(low - 0.5), static_cast<double>(first), static_cast<double>(last)));
    }

    void draw(const Vertex& a, const Vertex& b, const Vertex& c, std::int32_t id) const {
        const double low = std::min({a.y, b.y, c.y}), high = std::max({a.y, b.y, c.y});
        if (!(low < static_cast<double>(end) && high > static_cast<double>(begin))) return;
        const double area = (b.x - a.x) * (c.y - a.y) - (b.y - a.y) * (c.x - a.x);
        if (!(std::abs(area) > 0)) return;
        const std::size_t row_end = first_from(high + 1, begin, end);
        const std::size_t column_end = first_from(std::max({a.x, b.x, c.x}) + 1, 0, width);
        const std::size_t first_column = first_from(std::min({a.x, b.x, c.x}), 0, width);
        const double share = 1 / area;
        // 1 / depth is linear in the picture.
        const double inverse[3] = {1 / a.depth, 1 / b.depth, 1 / c.depth};
        for (std::size_t row = first_from(low, begin, end); row < row_end; ++row) {
            const double y = static_cast<double>(row) + 0.5;
            for (std::size_t column = first_column; column < column_end; ++column) {
                const double x = static_cast<double>(column) + 0.5;
                const double of_a = share * ((b.x - x) * (c.y - y) - (b.y - y) * (c.x - x));
                const double of_b = share * ((c.x - x) * (a.y - y) - (c.y - y) * (a.x - x));
                const double of_c = 1 - of_a - of_b;
                if (!(of_a >= 0 && of_b >= 0 && of_c >= 0)) continue;
                const auto seen = static_cast<float>(1 / (of_a * inverse[0] + of_b * inverse[1] + of_c * inverse[2]));
                const std::size_t pixel = row * width + column;
                if (ids[pixel] >= 0 && depth[pixel] <= seen) continue;
                ids[pixel] = id;
                depth[pixel] = seen;
            }
        }
    }
};

}  // namespace

void draw_leaf_grids(const double* places, std::size_t n, std::size_t rows, std::size_t columns, std::int32_t* ids, float* depth,
                     std::size_t height, std::size_t width, int threads) {
    const std::size_t vertices = rows * columns;
    std::vector<Rows> reach(n);
    parallel_for(n, threads, [&](std::size_t leaf) { reach[leaf] = rows_of(places + 3 * vertices * leaf, vertices); });

    const std::size_t bands = (height + kBandRows - 1) / kBandRows;
    parallel_for(bands, threads, [&](std::size_t number) {
        const std::size_t begin = number * kBandRows;
        const Band band{ids, depth, width, begin, std::min(begin + kBandRows, height)};
        std::fill(ids + begin * width, ids + band.end * width, -1);
        std::fill(depth + begin * width, depth + band.end * width, 0.0f);
        for (std::size_t leaf = 0; leaf < n; ++leaf) {
            if (!(reach[leaf].low < static_cast<double>(band.end) && reach[leaf].high > static_cast<double>(begin))) continue;
            const double* grid = places + 3 * vertices * leaf;
            for (std::size_t row = 0; row + 1 < rows; ++row) {
                for (std::size_t column = 0; column + 1 < columns; ++column) {
                    const std::size_t corner = row * columns + column;
                    const Vertex p = vertex_at(grid + 3 * corner), q = vertex_at(grid + 3 * (corner + 1));
                    const Vertex r = vertex_at(grid + 3 * (corner + columns)), s = vertex_at(grid + 3 * (corner + columns + 1));
                    if (!(p.drawn && q.drawn && r.drawn && s.drawn)) continue;
                    band.draw(p, q, s, static_cast<std::int32_t>(leaf));
                    band.draw(p, s, r, static_cast<std::int32_t>(leaf));
                }
            }
        }
    });
}

}  // namespace usdfoliage
