#include "leaf/normal_equations.h"

#include "vector_clones.h"

namespace usdfoliage {
namespace {

constexpr std::size_t kRows = 128;                    // added together
constexpr std::size_t kColumns = kLeafUnknowns + 1;   // the last is what a row should be
constexpr std::size_t kLanes = 4;                     // sums of a product, added in the end
constexpr std::size_t kTileHeight = 4, kTileWidth = 2;  // products whose sums stay in registers
static_assert(kRows % kLanes == 0 && kLeafUnknowns % kTileHeight == 0 && kTileHeight % kTileWidth == 0);

using Lanes = double __attribute__((vector_size(kLanes * sizeof(double))));

// One array a quantity of each row.
struct Rows {
    double u[kRows], v[kRows];
    double place[3][kRows], direction[3][kRows];  // along which an offset counts, times its rate
    double offset[kRows];
};

struct Columns {
    alignas(sizeof(Lanes)) double of[kColumns][kRows];
};

// Derivatives, by the unknowns, of the parts of places along directions.
USDFOLIAGE_VECTOR_CLONES
void derive_rows(const CurveSlopes& given, const Rows& __restrict rows, std::size_t count, Columns& __restrict columns) {
    const CurveSlopes slopes = given;
#pragma GCC ivdep
    for (std::size_t r = 0; r < count; ++r) {
        const double dx = rows.direction[0][r], dy = rows.direction[1][r], dz = rows.direction[2][r];
        const double x = rows.place[0][r], y = rows.place[1][r], z = rows.place[2][r];
        const double direction[3] = {dx, dy, dz};
        double numbers[kLeafNumbers];
        write_directional_slopes(slopes, along_at(rows.v[r]), across_at(rows.u[r]), direction, numbers);
#pragma GCC unroll 21  // so that the loop over rows is the one that becomes vectors
        for (std::size_t k = 0; k < kLeafNumbers; ++k) columns.of[k][r] = numbers[k];
        columns.of[kLeafTurn][r] = y * dz - z * dy;
        columns.of[kLeafTurn + 1][r] = z * dx - x * dz;
        columns.of[kLeafTurn + 2][r] = x * dy - y * dx;
        columns.of[kLeafShift][r] = dx;
        columns.of[kLeafShift + 1][r] = dy;
        columns.of[kLeafShift + 2][r] = dz;
        columns.of[kLeafGrowth][r] = dx * x + dy * y + dz * z;
        columns.of[kLeafUnknowns][r] = rows.offset[r];
    }
}

// Add the products of columns: of some with some, or with the last one.
USDFOLIAGE_VECTOR_CLONES
void add_products(const Columns& columns, std::size_t count, NormalEquations& equations) {
    const auto* numbers = reinterpret_cast<const Lanes*>(columns.of);
    constexpr std::size_t kSteps = kRows / kLanes;
    const std::size_t steps = count / kLanes;
    for (std::size_t i = 0; i < kLeafUnknowns; i += kTileHeight) {
        const Lanes* left = numbers + kSteps * i;
        for (std::size_t k = 0; k < i + kTileHeight; k += kTileWidth) {
            const Lanes* top = numbers + kSteps * k;
            Lanes sums[kTileHeight][kTileWidth] = {};
            for (std::size_t step = 0; step < steps; ++step)
                for (std::size_t a = 0; a < kTileHeight; ++a)
                    for (std::size_t b = 0; b < kTileWidth; ++b)
                        sums[a][b] += left[kSteps * a + step] * top[kSteps * b + step];
            for (std::size_t a = 0; a < kTileHeight; ++a)
                for (std::size_t b = 0; b < kTileWidth; ++b) {
                    const Lanes& sum = sums[a][b];
                    equations.matrix[i + a][k + b] += (sum[0] + sum[1]) + (sum[2] + sum[3]);
                }
        }
        const Lanes* last = numbers + kSteps * kLeafUnknowns;
        Lanes sums[kTileHeight] = {};
        for (std::size_t step = 0; step < steps; ++step)
            for (std::size_t a = 0; a < kTileHeight; ++a) sums[a] += left[kSteps * a + step] * last[step];
        for (std::size_t a = 0; a < kTileHeight; ++a)
            equations.right[i + a] += (sums[a][0] + sums[a][1]) + (sums[a][2] + sums[a][3]);
    }
}

}  // namespace

void add_offsets(const CurveSlopes& slopes, const ClosestPlaces& places, const double* rates, NormalEquations& equations) {
    Rows rows;
    Columns columns;
    std::size_t filled = 0;
    const auto add_rows = [&] {
        for (; filled % kLanes != 0; ++filled) {  // with rows that have no direction and add nothing
            rows.u[filled] = rows.v[filled] = rows.offset[filled] = 0;
            for (int c = 0; c < 3; ++c) rows.place[c][filled] = rows.direction[c][filled] = 0;
        }
        derive_rows(slopes, rows, filled, columns);
        add_products(columns, filled, equations);
        filled = 0;
    };
    for (std::size_t i = 0; i < places.size(); ++i) {
        const double rate = rates[i];
        if (!(rate > 0)) continue;
        const double offset[3] = {places.offset(0)[i], places.offset(1)[i], places.offset(2)[i]};
        const auto parts = static_cast<int>(places.parts()[i]);
        for (int part = 0; part < parts; ++part) {
            double direction[3] = {0, 0, 0};
            for (std::size_t c = 0; c < 3; ++c)
                direction[c] = rate * (parts == 3 ? (static_cast<int>(c) == part ? 1.0 : 0.0)
                                                  : part == 0 ? places.normal(c)[i] : places.outward(c)[i]);
            rows.u[filled] = places.u()[i];
            rows.v[filled] = places.v()[i];
            for (std::size_t c = 0; c < 3; ++c) {
                rows.place[c][filled] = places.place(c)[i];
                rows.direction[c][filled] = direction[c];
            }
            rows.offset[filled] = direction[0] * offset[0] + direction[1] * offset[1] + direction[2] * offset[2];
            if (++filled == kRows) add_rows();
        }
    }
    if (filled > 0) add_rows();
}

}  // namespace usdfoliage
