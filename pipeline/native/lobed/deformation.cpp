#include "lobed/deformation.h"

#include <array>
#include <cmath>
#include <vector>

#include "parallel.h"

namespace usdfoliage {

namespace {

using Matrix = std::array<double, 9>;  // rows

constexpr Matrix identity{1, 0, 0, 0, 1, 0, 0, 0, 1};

// Integral of a function from position 0: linear between keys, constant beyond.
double integral_to(const double* keys, std::int32_t count, double position) {
    if (count == 0) return 0;
    double sum = keys[1] * std::fmin(position, keys[0]);
    for (std::int32_t k = 1; k < count; ++k) {
        const double from = keys[2 * k - 2], to = std::fmin(position, keys[2 * k]);
        if (to <= from) return sum;
        const double slope = (keys[2 * k + 1] - keys[2 * k - 1]) / (keys[2 * k] - from);
        sum += (to - from) * (keys[2 * k - 1] + 0.5 * slope * (to - from));
    }
    const double last = keys[2 * count - 2];
    return position > last ? sum + keys[2 * count - 1] * (position - last) : sum;
}

// Rotation by a vector whose length is the angle.
Matrix rotation(double x, double y, double z) {
    const double angle = std::sqrt(x * x + y * y + z * z);
    if (angle == 0) return identity;
    x /= angle;
    y /= angle;
    z /= angle;
    const double c = std::cos(angle), s = std::sin(angle), d = 1 - c;
    return {c + d * x * x,     d * x * y - s * z, d * x * z + s * y, d * x * y + s * z, c + d * y * y,
            d * y * z - s * x, d * x * z - s * y, d * y * z + s * x, c + d * z * z};
}

Matrix product(const Matrix& a, const Matrix& b) {
    Matrix out;
    for (std::size_t i = 0; i < 3; ++i)
        for (std::size_t k = 0; k < 3; ++k) out[3 * i + k] = a[3 * i] * b[k] + a[3 * i + 1] * b[3 + k] + a[3 * i + 2] * b[6 + k];
    return out;
}

// By how much a matrix moves the end of a vector in the plane, whose begin moved by so much.
void move(const Matrix& turned, double x, double y, const double* begin, double* out) {
    out[0] = begin[0] + ((turned[0] - 1) * x + turned[1] * y);
    out[1] = begin[1] + (turned[3] * x + (turned[4] - 1) * y);
    out[2] = begin[2] + (turned[6] * x + turned[7] * y);
}

void deform(const LobedShape& shape, const LobedFunctions& functions, std::size_t leaf, double* points) {
    const std::size_t n = shape.node_count;
    std::vector<Matrix> frames(n, identity);  // at each node, from the flat leaf's
    std::vector<double> moved(3 * n, 0.0);    // from the flat leaf
    for (std::size_t i = 1; i < n; ++i) {
        const std::size_t p = static_cast<std::size_t>(shape.parents[i]);
        const double x = shape.nodes[2 * i] - shape.nodes[2 * p], y = shape.nodes[2 * i + 1] - shape.nodes[2 * p + 1];
        const double length = std::sqrt(x * x + y * y);
        const double hx = length > 0 ? x / length : 0, hy = length > 0 ? y / length : 1;
        const double begin = shape.spans[2 * i], end = shape.spans[2 * i + 1], middle = 0.5 * (begin + end);
        double first[3], second[3];  // turn, bend and twist of the halves of the step
        for (std::size_t f = 0; f < 3; ++f) {
            const std::size_t place = (3 * leaf + f) * shape.branch_count + static_cast<std::size_t>(shape.branches[i]);
            const double* keys = functions.keys + 2 * functions.first[place];
            const std::int32_t count = functions.counts[place];
            const double at_middle = integral_to(keys, count, middle);
            first[f] = at_middle - integral_to(keys, count, begin);
            second[f] = integral_to(keys, count, end) - at_middle;
        }
        // The left direction is (-hy, hx, 0).
        const auto half = [&](const double* by) {
            return rotation(by[2] * hx - by[1] * hy, by[2] * hy + by[1] * hx, by[0]);
        };
        const Matrix step = product(frames[p], half(first));
        move(step, x, y, &moved[3 * p], &moved[3 * i]);
        frames[i] = product(step, half(second));
    }
    for (std::size_t i = 0; i < n; ++i) {
        points[3 * i] = shape.nodes[2 * i] + moved[3 * i];
        points[3 * i + 1] = shape.nodes[2 * i + 1] + moved[3 * i + 1];
        points[3 * i + 2] = moved[3 * i + 2];
    }
    double* feet = points + 3 * n;
    for (std::size_t t = 0; t < shape.tie_count; ++t) {
        const std::size_t i = static_cast<std::size_t>(shape.tie_nodes[t]);
        const double* foot = shape.feet + 2 * t;
        double by[3];
        move(frames[i], foot[0] - shape.nodes[2 * i], foot[1] - shape.nodes[2 * i + 1], &moved[3 * i], by);
        feet[3 * t] = foot[0] + by[0];
        feet[3 * t + 1] = foot[1] + by[1];
        feet[3 * t + 2] = by[2];
    }
}

}  // namespace

void deform_lobed_leaves(const LobedShape& shape, const LobedFunctions& functions, std::size_t leaves, double* points,
                         int threads) {
    const std::size_t numbers = 3 * (shape.node_count + shape.tie_count);
    parallel_for(leaves, threads, [&](std::size_t leaf) { deform(shape, functions, leaf, points + leaf * numbers); });
}

}  // namespace usdfoliage
