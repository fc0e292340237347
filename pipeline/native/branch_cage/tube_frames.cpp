#include "branch_cage/tube_frames.h"

#include <algorithm>
#include <cmath>

#include "parallel.h"

namespace usdfoliage {
namespace {

constexpr std::size_t kBlock = 64;  // tubes of one task

double dot(const double* a, const double* b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }
void cross(const double* a, const double* b, double* out) {
    out[0] = a[1] * b[2] - a[2] * b[1];
    out[1] = a[2] * b[0] - a[0] * b[2];
    out[2] = a[0] * b[1] - a[1] * b[0];
}

}  // namespace

void carry_normal(const double* from, const double* to, const double* vector, double* out) {
    const double cosine = dot(from, to);
    double axis[3], beside[3];
    cross(from, to, axis);
    cross(axis, vector, beside);
    // 1 / (1 + cos) has no limit for opposite vectors: any half turn will do.
    const bool opposite = cosine < -1 + 1e-9;
    const double along = dot(axis, vector) / std::max(1 + cosine, 1e-9);
    for (int k = 0; k < 3; ++k) out[k] = opposite ? vector[k] : cosine * vector[k] + beside[k] + along * axis[k];
    const double lean = dot(out, to);
    for (int k = 0; k < 3; ++k) out[k] -= lean * to[k];
    const double size = std::sqrt(dot(out, out));
    for (int k = 0; k < 3; ++k) out[k] /= size;
}

void carry_references(const double* direction, const std::int64_t* first, const std::int64_t* counts, std::size_t n_tubes,
                      double* reference, int threads) {
    parallel_for((n_tubes + kBlock - 1) / kBlock, threads, [&](std::size_t block) {
        for (std::size_t tube = block * kBlock; tube < std::min(n_tubes, (block + 1) * kBlock); ++tube)
            for (std::int64_t at = first[tube] + 1; at < first[tube] + counts[tube]; ++at)
                carry_normal(direction + 3 * (at - 1), direction + 3 * at, reference + 3 * (at - 1), reference + 3 * at);
    });
}

}  // namespace usdfoliage
