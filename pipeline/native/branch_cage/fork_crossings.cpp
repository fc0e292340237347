#include "branch_cage/fork_crossings.h"

#include <algorithm>
#include <array>
#include <tuple>
#include <utility>

#include "parallel.h"

namespace usdfoliage {
namespace {

using Vector = std::array<double, 3>;

Vector operator-(const Vector& a, const Vector& b) { return {a[0] - b[0], a[1] - b[1], a[2] - b[2]}; }
double dot(const Vector& a, const Vector& b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }
Vector cross(const Vector& a, const Vector& b) {
    return {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
}

using Triangle = std::array<Vector, 3>;

struct Quad {
    const std::int64_t* corners;
    std::array<Vector, 4> points;
    Vector low, high;
    std::array<Vector, 2> normals;  // of its triangles

    Triangle half(int which) const {
        const auto k = static_cast<std::size_t>(which);
        return {points[0], points[1 + k], points[2 + k]};
    }
};

Quad read_quad(const double* points, const std::int64_t* corners) {
    Quad quad{corners, {}, {}, {}, {}};
    for (std::size_t k = 0; k < 4; ++k)
        for (std::size_t axis = 0; axis < 3; ++axis) {
            const double value = points[3 * corners[k] + static_cast<std::int64_t>(axis)];
            quad.points[k][axis] = value;
            quad.low[axis] = k ? std::min(quad.low[axis], value) : value;
            quad.high[axis] = k ? std::max(quad.high[axis], value) : value;
        }
    for (std::size_t k = 0; k < 2; ++k)
        quad.normals[k] = cross(quad.points[1 + k] - quad.points[0], quad.points[2 + k] - quad.points[0]);
    return quad;
}

bool share_vertex(const Quad& a, const Quad& b) {
    for (int i = 0; i < 4; ++i)
        for (int j = 0; j < 4; ++j)
            if (a.corners[i] == b.corners[j]) return true;
    return false;
}

// Whether quad b lies on one side of both triangles of quad a.
bool on_one_side(const Quad& a, const Quad& b) {
    for (const Vector& normal : a.normals) {
        bool above = true, below = true;
        for (const Vector& corner : b.points) {
            const double height = dot(corner - a.points[0], normal);
            above = above && height > 0;
            below = below && height < 0;
        }
        if (!above && !below) return false;
    }
    return true;
}

bool edge_through(const Vector& start, const Vector& end, const Triangle& triangle) {
    const Vector normal = cross(triangle[1] - triangle[0], triangle[2] - triangle[0]);
    if (!(dot(start - triangle[0], normal) * dot(end - triangle[0], normal) < 0)) return false;
    // Signs of the volumes that the edge makes with the triangle's edges.
    const Vector along = end - start;
    bool inside = true, outside = true;
    for (std::size_t k = 0; k < 3; ++k) {
        const double volume = dot(cross(triangle[k] - start, triangle[(k + 1) % 3] - start), along);
        inside = inside && volume > 0;
        outside = outside && volume < 0;
    }
    return inside || outside;
}

// Whether an edge of one triangle goes through the other.
bool triangles_cross(const Triangle& a, const Triangle& b) {
    for (std::size_t k = 0; k < 3; ++k)
        if (edge_through(a[k], a[(k + 1) % 3], b) || edge_through(b[k], b[(k + 1) % 3], a)) return true;
    return false;
}

bool quads_cross(const Quad& a, const Quad& b) {
    if (share_vertex(a, b) || on_one_side(a, b) || on_one_side(b, a)) return false;
    for (int i = 0; i < 2; ++i)
        for (int j = 0; j < 2; ++j)
            if (triangles_cross(a.half(i), b.half(j))) return true;
    return false;
}

struct Crossing {
    std::int64_t face_a, face_b;  // the lower first
    std::int64_t place_a, place_b;

    bool operator<(const Crossing& other) const {
        return std::tie(face_a, face_b, place_a, place_b) <
               std::tie(other.face_a, other.face_b, other.place_a, other.place_b);
    }
};

std::vector<Crossing> crossings_of(const double* points, const std::int64_t* faces, const std::int64_t* fork_faces,
                                   std::int64_t first, std::int64_t end) {
    const auto count = static_cast<std::size_t>(end - first);
    std::vector<Quad> quads(count);
    Vector low{}, high{};
    for (std::size_t k = 0; k < count; ++k) {
        quads[k] = read_quad(points, faces + 4 * fork_faces[first + static_cast<std::int64_t>(k)]);
        for (std::size_t axis = 0; axis < 3; ++axis) {
            low[axis] = k ? std::min(low[axis], quads[k].low[axis]) : quads[k].low[axis];
            high[axis] = k ? std::max(high[axis], quads[k].high[axis]) : quads[k].high[axis];
        }
    }
    const Vector extent = high - low;
    const auto along = static_cast<std::size_t>(std::max_element(extent.begin(), extent.end()) - extent.begin());
    std::vector<std::size_t> order(count);
    for (std::size_t k = 0; k < count; ++k) order[k] = k;
    std::sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) {
        return std::pair(quads[a].low[along], a) < std::pair(quads[b].low[along], b);
    });
    std::vector<Crossing> found;
    for (std::size_t i = 0; i < count; ++i) {
        const Quad& one = quads[order[i]];
        for (std::size_t j = i + 1; j < count && quads[order[j]].low[along] <= one.high[along]; ++j) {
            const Quad& two = quads[order[j]];
            bool apart = false;
            for (std::size_t axis = 0; axis < 3; ++axis)
                apart = apart || two.low[axis] > one.high[axis] || one.low[axis] > two.high[axis];
            if (apart || !quads_cross(one, two)) continue;
            const auto [a, b] = std::minmax(order[i], order[j]);
            const std::int64_t place_a = first + static_cast<std::int64_t>(a), place_b = first + static_cast<std::int64_t>(b);
            const auto [face_a, face_b] = std::minmax(fork_faces[place_a], fork_faces[place_b]);
            found.push_back({face_a, face_b, place_a, place_b});
        }
    }
    return found;
}

}  // namespace

std::vector<std::int64_t> find_fork_crossings(const double* points, const std::int64_t* faces, const std::int64_t* fork_faces,
                                              const std::int64_t* fork_first, std::size_t n_forks, int threads) {
    std::vector<std::vector<Crossing>> by_fork(n_forks);
    parallel_for(n_forks, threads, [&](std::size_t fork) {
        by_fork[fork] = crossings_of(points, faces, fork_faces, fork_first[fork], fork_first[fork + 1]);
    });
    std::vector<Crossing> all;
    for (const auto& some : by_fork) all.insert(all.end(), some.begin(), some.end());
    std::sort(all.begin(), all.end());
    std::vector<std::int64_t> pairs;
    for (std::size_t k = 0; k < all.size(); ++k) {
        if (k && all[k].face_a == all[k - 1].face_a && all[k].face_b == all[k - 1].face_b) continue;
        pairs.push_back(all[k].place_a);
        pairs.push_back(all[k].place_b);
    }
    return pairs;
}

}  // namespace usdfoliage
