#include "branch_tracing/piece_bridges.h"

#include <algorithm>
#include <array>
#include <limits>
#include <numeric>

#include "geometry/piece_boxes.h"

namespace usdfoliage {
namespace {

constexpr std::size_t kLeaf = 8;  // points of a box that is not halved
constexpr double kFar = std::numeric_limits<double>::infinity();

double square_apart(const Point& a, const Point& b) {
    const double x = a[0] - b[0], y = a[1] - b[1], z = a[2] - b[2];
    return x * x + y * y + z * z;
}

struct Found {
    double square = kFar;
    std::size_t point = 0;
};

// Points in the order of their boxes, each with the piece that it is in now.
class PieceTree {
public:
    PieceTree(const double* points, std::size_t n) : order(n), at(n), piece(n) {
        std::iota(order.begin(), order.end(), std::size_t{0});
        halve(points, 0, n);
        for (std::size_t i = 0; i < n; ++i) at[i] = point_of(points, order[i]);
    }

    // From what is in piece, which boxes are in one piece.
    void find_boxes() {
        for (std::size_t b = boxes.size(); b-- > 0;) {  // halves come after the whole
            PieceBox& box = boxes[b];
            if (box.far_half) {
                const std::int32_t near = boxes[b + 1].piece;
                box.piece = near == boxes[box.far_half].piece ? near : kMixed;
            } else {
                box.piece = piece[box.begin];
                for (std::size_t i = box.begin; i < box.end; ++i)
                    if (piece[i] != box.piece) box.piece = kMixed;
            }
        }
    }

    // The nearest point of another piece, where one is nearer than the best so far.
    void find_other(std::size_t from, std::size_t b, Found& best) const {
        const PieceBox& box = boxes[b];
        if (box.piece == piece[from]) return;
        if (!box.far_half) {
            for (std::size_t i = box.begin; i < box.end; ++i) {
                if (piece[i] == piece[from]) continue;
                const double square = square_apart(at[from], at[i]);
                if (square < best.square) best = {square, i};
            }
            return;
        }
        std::size_t first = b + 1, second = box.far_half;
        double first_square = square_from(boxes[first], at[from]), second_square = square_from(boxes[second], at[from]);
        if (second_square < first_square) {
            std::swap(first, second);
            std::swap(first_square, second_square);
        }
        if (first_square < best.square) find_other(from, first, best);
        if (second_square < best.square) find_other(from, second, best);
    }

    std::vector<std::size_t> order;  // index of each point
    std::vector<Point> at;
    std::vector<std::int32_t> piece;

private:
    static Point point_of(const double* points, std::size_t i) {
        return {points[3 * i], points[3 * i + 1], points[3 * i + 2]};
    }

    void halve(const double* points, std::size_t begin, std::size_t end) {
        PieceBox box{point_of(points, order[begin]), point_of(points, order[begin]), begin, end, 0, kMixed};
        for (std::size_t i = begin; i < end; ++i) {
            for (int c = 0; c < 3; ++c) {
                box.low[c] = std::min(box.low[c], points[3 * order[i] + c]);
                box.high[c] = std::max(box.high[c], points[3 * order[i] + c]);
            }
        }
        const std::size_t number = boxes.size();
        boxes.push_back(box);
        if (end - begin <= kLeaf) return;
        int axis = 0;
        for (int c = 1; c < 3; ++c)
            if (box.high[c] - box.low[c] > box.high[axis] - box.low[axis]) axis = c;
        const std::size_t middle = begin + (end - begin) / 2;
        const auto first = order.begin();
        std::nth_element(first + static_cast<std::ptrdiff_t>(begin), first + static_cast<std::ptrdiff_t>(middle),
                         first + static_cast<std::ptrdiff_t>(end), [&](std::size_t a, std::size_t b) {
                             const double x = points[3 * a + axis], y = points[3 * b + axis];
                             return x < y || (x == y && a < b);
                         });
        halve(points, begin, middle);
        boxes[number].far_half = boxes.size();
        halve(points, middle, end);
    }

    std::vector<PieceBox> boxes;  // the whole first
};

std::int32_t root_of(std::vector<std::int32_t>& joined, std::int32_t piece) {
    while (joined[piece] != piece) piece = joined[piece] = joined[joined[piece]];
    return piece;
}

}  // namespace

std::vector<std::int64_t> bridge_pieces(const double* points, const std::int32_t* piece_of, std::size_t n,
                                        std::size_t pieces) {
    std::vector<std::int64_t> links;
    if (pieces < 2) return links;
    PieceTree tree(points, n);
    std::vector<std::int32_t> joined(pieces);
    std::iota(joined.begin(), joined.end(), 0);
    // Of each point the nearest of another piece, or only how far that is at least; as pieces grow it never comes nearer.
    std::vector<Found> nearest(n);
    std::vector<std::uint8_t> known(n, 0);
    for (Found& each : nearest) each.square = 0;
    while (links.size() < 2 * (pieces - 1)) {
        std::vector<std::size_t> size(pieces, 0);
        for (std::size_t i = 0; i < n; ++i) {
            tree.piece[i] = root_of(joined, piece_of[tree.order[i]]);
            ++size[tree.piece[i]];
        }
        tree.find_boxes();
        // The largest does not look: the others find it.
        const auto largest = static_cast<std::int32_t>(std::max_element(size.begin(), size.end()) - size.begin());
        std::vector<Found> best(pieces);
        std::vector<std::size_t> start(pieces, 0);
        const auto offer = [&](std::size_t i) {
            Found& shortest = best[tree.piece[i]];
            if (nearest[i].square < shortest.square) {
                shortest = nearest[i];
                start[tree.piece[i]] = i;
            }
        };
        for (std::size_t i = 0; i < n; ++i) {
            if (tree.piece[i] == largest) continue;
            known[i] = known[i] && tree.piece[nearest[i].point] != tree.piece[i];
            if (known[i]) offer(i);
        }
        for (std::size_t i = 0; i < n; ++i) {
            const Found& shortest = best[tree.piece[i]];
            if (tree.piece[i] == largest || known[i] || nearest[i].square >= shortest.square) continue;
            Found found{shortest.square, n};
            tree.find_other(i, 0, found);
            nearest[i] = found;
            known[i] = found.point < n;
            if (known[i]) offer(i);
        }
        // The shortest first, so that pieces which found different links of the same length close no circle with a
        // longer one.
        std::vector<std::int32_t> looking;
        for (std::size_t p = 0; p < pieces; ++p)
            if (best[p].square < kFar) looking.push_back(static_cast<std::int32_t>(p));
        std::stable_sort(looking.begin(), looking.end(),
                         [&](std::int32_t a, std::int32_t b) { return best[a].square < best[b].square; });
        for (const std::int32_t p : looking) {
            const std::int32_t own = root_of(joined, p), other = root_of(joined, tree.piece[best[p].point]);
            if (own == other) continue;
            joined[own] = other;
            links.push_back(static_cast<std::int64_t>(tree.order[start[p]]));
            links.push_back(static_cast<std::int64_t>(tree.order[best[p].point]));
        }
    }
    return links;
}

}  // namespace usdfoliage
