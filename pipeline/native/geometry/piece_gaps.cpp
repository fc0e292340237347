#include "geometry/piece_gaps.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <utility>
#include <vector>

#include "geometry/piece_boxes.h"
#include "parallel.h"

namespace usdfoliage {
namespace {

constexpr std::size_t kLeaf = 6;  // triangles of a box that is not halved
constexpr std::uint64_t kCells = 1ULL << 21;  // of the curve along which triangles are sorted, along each axis
constexpr double kFar = std::numeric_limits<double>::infinity();

Point minus(const Point& a, const Point& b) { return {a[0] - b[0], a[1] - b[1], a[2] - b[2]}; }
double dot(const Point& a, const Point& b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }
Point cross(const Point& a, const Point& b) {
    return {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
}
Point along(const Point& from, const Point& step, double share) {
    return {from[0] + share * step[0], from[1] + share * step[1], from[2] + share * step[2]};
}

// The point of a triangle that is nearest to p. Source: C. Ericson, Real-Time Collision Detection, 2004, 5.1.5.
Point nearest_of(const Point& a, const Point& b, const Point& c, const Point& p) {
    const Point ab = minus(b, a), ac = minus(c, a), ap = minus(p, a);
    const double d1 = dot(ab, ap), d2 = dot(ac, ap);
    if (d1 <= 0 && d2 <= 0) return a;
    const Point bp = minus(p, b);
    const double d3 = dot(ab, bp), d4 = dot(ac, bp);
    if (d3 >= 0 && d4 <= d3) return b;
    const double vc = d1 * d4 - d3 * d2;
    if (vc <= 0 && d1 >= 0 && d3 <= 0) return along(a, ab, d1 / (d1 - d3));
    const Point cp = minus(p, c);
    const double d5 = dot(ab, cp), d6 = dot(ac, cp);
    if (d6 >= 0 && d5 <= d6) return c;
    const double vb = d5 * d2 - d1 * d6;
    if (vb <= 0 && d2 >= 0 && d6 <= 0) return along(a, ac, d2 / (d2 - d6));
    const double va = d3 * d6 - d5 * d4;
    if (va <= 0 && d4 - d3 >= 0 && d5 - d6 >= 0) return along(b, minus(c, b), (d4 - d3) / ((d4 - d3) + (d5 - d6)));
    const double whole = va + vb + vc;
    if (!(whole > 0)) return a;  // a triangle without area
    return along(along(a, ab, vb / whole), ac, vc / whole);
}

// The bits of a number below kCells, each third one apart.
std::uint64_t spread(std::uint64_t x) {
    x = (x | x << 32) & 0x1f00000000ffffULL;
    x = (x | x << 16) & 0x1f0000ff0000ffULL;
    x = (x | x << 8) & 0x100f00f00f00f00fULL;
    x = (x | x << 4) & 0x10c30c30c30c30c3ULL;
    return (x | x << 2) & 0x1249249249249249ULL;
}

// Whether a straight way enters a box.
bool enters(const PieceBox& box, const Point& from, const Point& step) {
    double begin = 0, end = 1;
    for (int c = 0; c < 3; ++c) {
        if (step[c] == 0) {
            if (from[c] < box.low[c] || from[c] > box.high[c]) return false;
            continue;
        }
        const double one = (box.low[c] - from[c]) / step[c], two = (box.high[c] - from[c]) / step[c];
        begin = std::max(begin, std::min(one, two));
        end = std::min(end, std::max(one, two));
    }
    return begin <= end;
}

// Whether it goes through a triangle. Source: T. Moeller and B. Trumbore, Fast, minimum storage ray/triangle
// intersection, 1997.
bool goes_through(const Point& a, const Point& b, const Point& c, const Point& from, const Point& step) {
    const Point ab = minus(b, a), ac = minus(c, a), across = cross(step, ac);
    const double volume = dot(ab, across);
    if (volume == 0) return false;  // along its plane, or a triangle without area
    const Point away = minus(from, a), turned = cross(away, ab);
    const double u = dot(away, across) / volume, v = dot(step, turned) / volume, at = dot(ac, turned) / volume;
    return u >= 0 && v >= 0 && u + v <= 1 && at >= 0 && at <= 1;
}

class TriangleTree {
public:
    explicit TriangleTree(const PieceMesh& whole) : mesh(whole), order(whole.triangles) {
        if (!mesh.triangles) return;
        sort_along_curve();
        boxes.reserve(mesh.triangles);
        halve(0, mesh.triangles);
    }

    // Distance of p to the nearest triangle of another piece, if it is below `square`: squared.
    double square_to_others(const Point& p, std::int32_t own, double square) const {
        find(0, p, own, square);
        return square;
    }

    // Whether the way from a point goes through a triangle of another piece.
    bool crosses_others(const Point& from, const Point& step, std::int32_t own, std::size_t at = 0) const {
        const PieceBox& box = boxes[at];
        if (box.piece == own || !enters(box, from, step)) return false;
        if (box.far_half) {
            return crosses_others(from, step, own, at + 1) || crosses_others(from, step, own, box.far_half);
        }
        for (std::size_t i = box.begin; i < box.end; ++i) {
            const std::size_t t = order[i];
            if (piece_of(t) != own && goes_through(corner(t, 0), corner(t, 1), corner(t, 2), from, step)) return true;
        }
        return false;
    }

    bool empty() const { return boxes.empty(); }

private:
    Point corner(std::size_t triangle, int c) const {
        const double* p = mesh.points + 3 * static_cast<std::size_t>(mesh.corners[3 * triangle + c]);
        return {p[0], p[1], p[2]};
    }
    std::int32_t piece_of(std::size_t triangle) const { return mesh.piece[mesh.corners[3 * triangle]]; }

    // Triangles along a Morton curve, so that halves of any part of it lie together. Source: C. Lauterbach et al., Fast
    // BVH construction on GPUs, 2009, section 3.
    void sort_along_curve() {
        Point low = {kFar, kFar, kFar}, high = {-kFar, -kFar, -kFar};
        for (std::size_t t = 0; t < mesh.triangles; ++t) {
            for (int c = 0; c < 3; ++c) {
                low[c] = std::min(low[c], corner(t, 0)[c]);
                high[c] = std::max(high[c], corner(t, 0)[c]);
            }
        }
        const double extent = std::max({high[0] - low[0], high[1] - low[1], high[2] - low[2]});
        const double cells = extent > 0 ? (kCells - 1) / extent : 0;
        std::vector<std::pair<std::uint64_t, std::size_t>> placed(mesh.triangles);
        for (std::size_t t = 0; t < mesh.triangles; ++t) {
            const Point p = corner(t, 0);
            std::uint64_t code = 0;
            for (int c = 0; c < 3; ++c) {
                code |= spread(static_cast<std::uint64_t>((p[c] - low[c]) * cells)) << c;
            }
            placed[t] = {code, t};
        }
        std::sort(placed.begin(), placed.end());
        for (std::size_t i = 0; i < mesh.triangles; ++i) order[i] = placed[i].second;
    }

    std::size_t halve(std::size_t begin, std::size_t end) {
        const std::size_t own = boxes.size();
        PieceBox box{{kFar, kFar, kFar}, {-kFar, -kFar, -kFar}, begin, end, 0, piece_of(order[begin])};
        boxes.push_back(box);
        if (end - begin <= kLeaf) {
            for (std::size_t i = begin; i < end; ++i) {
                for (int k = 0; k < 3; ++k) grow(box, corner(order[i], k), corner(order[i], k));
                if (piece_of(order[i]) != box.piece) box.piece = kMixed;
            }
        } else {
            const std::size_t middle = (begin + end) / 2;
            const std::size_t near = halve(begin, middle);
            box.far_half = halve(middle, end);
            for (const std::size_t each : {near, box.far_half}) {
                grow(box, boxes[each].low, boxes[each].high);
                if (boxes[each].piece != box.piece) box.piece = kMixed;
            }
        }
        boxes[own] = box;
        return own;
    }

    static void grow(PieceBox& box, const Point& low, const Point& high) {
        for (int c = 0; c < 3; ++c) {
            box.low[c] = std::min(box.low[c], low[c]);
            box.high[c] = std::max(box.high[c], high[c]);
        }
    }

    void find(std::size_t at, const Point& p, std::int32_t own, double& square) const {
        const PieceBox& box = boxes[at];
        if (box.piece == own || square_from(box, p) >= square) return;
        if (!box.far_half) {
            for (std::size_t i = box.begin; i < box.end; ++i) {
                if (piece_of(order[i]) == own) continue;
                const Point away = minus(p, nearest_of(corner(order[i], 0), corner(order[i], 1), corner(order[i], 2), p));
                square = std::min(square, dot(away, away));
            }
            return;
        }
        const std::size_t near = at + 1, far = box.far_half;
        const bool first = square_from(boxes[near], p) <= square_from(boxes[far], p);
        find(first ? near : far, p, own, square);
        find(first ? far : near, p, own, square);
    }

    const PieceMesh& mesh;
    std::vector<std::size_t> order;
    std::vector<PieceBox> boxes;
};

}  // namespace

std::vector<double> piece_gaps(const PieceMesh& mesh, const PieceEdges& asked, double near_enough, bool through,
                               int threads) {
    const TriangleTree tree(mesh);
    std::vector<double> gaps(asked.count, kFar);
    if (tree.empty()) return gaps;
    const double enough = near_enough * near_enough;
    const auto point = [&](std::int32_t index) {
        const double* p = mesh.points + 3 * static_cast<std::size_t>(index);
        return Point{p[0], p[1], p[2]};
    };
    parallel_for(asked.count, threads, [&](std::size_t q) {
        const std::int32_t own = asked.pieces[q];
        for (std::int64_t i = asked.first[q]; through && i < asked.first[q + 1]; ++i) {
            const Point from = point(asked.ends[2 * i]);
            if (tree.crosses_others(from, minus(point(asked.ends[2 * i + 1]), from), own)) {
                gaps[q] = 0;
                return;
            }
        }
        double closest = kFar;
        for (std::int64_t i = asked.first[q]; i < asked.first[q + 1] && closest > enough; ++i) {
            closest = tree.square_to_others(point(asked.ends[2 * i]), own, closest);
        }
        gaps[q] = std::sqrt(closest);
    });
    return gaps;
}

}  // namespace usdfoliage
