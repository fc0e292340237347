#include "leaf/near_folds.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "vector_clones.h"

namespace usdfoliage {
namespace {

constexpr double kMargin = 0.04;  // area elements below it, of a leaf as wide as long, count as near to a fold

constexpr std::array<double, 3> kAbsU = {1e-6, 0.6, 1.0};
constexpr std::array<double, 9> kV = {0.03, 0.08, 0.16, 0.3, 0.5, 0.7, 0.84, 0.92, 0.97};
constexpr std::size_t kCount = 2 * kAbsU.size() * kV.size();

struct Places {
    double u[kCount], v[kCount];
};

constexpr Places spread_places() {
    Places places{};
    std::size_t k = 0;
    for (const double v : kV) {
        for (const double side : {-1.0, 1.0}) {
            for (const double u : kAbsU) {
                places.u[k] = side * u;
                places.v[k++] = v;
            }
        }
    }
    return places;
}

constexpr Places kPlaces = spread_places();

USDFOLIAGE_VECTOR_CLONES
void area_elements(const LeafCurves& given, double* __restrict areas) {
    const LeafCurves curves = given;
    for (std::size_t k = 0; k < kCount; ++k) {
        const SurfacePlace place = surface_place(curves, kPlaces.u[k], kPlaces.v[k]);
        areas[k] = place.by_u[0] * place.by_v[1] - place.by_u[1] * place.by_v[0];
    }
}

// How wide the leaf is meant to be.
double mean_width(const double* parameters) {
    return std::max((std::abs(parameters[7]) + std::abs(parameters[10]) + std::abs(parameters[13])) / 3, 1e-3);
}

}  // namespace

std::vector<NearFold> find_near_folds(const double* parameters) {
    const double scale = 1 / mean_width(parameters);
    double areas[kCount];
    area_elements(leaf_curves(parameters), areas);
    std::vector<NearFold> found;
    for (std::size_t k = 0; k < kCount; ++k) {
        const double v = kPlaces.v[k], lack = kMargin * 4 * v * (1 - v) - scale * areas[k];
        if (lack > 0) found.push_back({kPlaces.u[k], v, scale, lack});
    }
    return found;
}

void write_area_slopes(const LeafCurves& curves, const CurveSlopes& slopes, const NearFold& near, double* slopes_of_area) {
    const SurfacePlace place = surface_place(curves, near.u, near.v);
    double of_u[3 * kLeafNumbers], of_v[3 * kLeafNumbers];
    write_jacobian(slopes, along_at(near.v), across_slope_at(near.u), of_u);
    write_jacobian(slopes, along_slope_at(near.v), across_at(near.u), of_v);
    for (std::size_t k = 0; k < kLeafNumbers; ++k)
        slopes_of_area[k] = near.scale * (of_u[k] * place.by_v[1] + place.by_u[0] * of_v[kLeafNumbers + k] -
                                          of_u[kLeafNumbers + k] * place.by_v[0] - place.by_u[1] * of_v[k]);
}

}  // namespace usdfoliage
