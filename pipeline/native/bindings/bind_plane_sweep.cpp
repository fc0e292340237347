#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/vector.h>

#include <cstdint>
#include <utility>
#include <vector>

#include "bindings/arrays.h"
#include "bindings/bindings.h"
#include "mvs/plane_sweep.h"

namespace nb = nanobind;
using namespace nb::literals;

namespace {

using Homographies = nb::ndarray<const double, nb::shape<-1, -1, 3, 3>, nb::c_contig, nb::device::cpu>;
using Costs = nb::ndarray<const std::uint8_t, nb::shape<-1, -1, -1>, nb::c_contig, nb::device::cpu>;
using Photo = nb::ndarray<const std::int16_t, nb::shape<-1, -1>, nb::c_contig, nb::device::cpu>;

usdfoliage::Brightness brightness(const Photo& photo) {
    return {photo.data(), static_cast<int>(photo.shape(1)), static_cast<int>(photo.shape(0))};
}

nb::ndarray<nb::numpy, std::uint8_t> cost(const Photo& photo, const std::vector<Photo>& others,
                                          const Homographies& homographies, int radius, int tolerance, double best_share, int threads) {
    std::vector<usdfoliage::Brightness> seen;
    for (const Photo& other : others) seen.push_back(brightness(other));
    std::vector<std::uint8_t> costs;
    {
        nb::gil_scoped_release unlocked;
        costs = usdfoliage::sweep_cost(brightness(photo), seen, homographies.data(), homographies.shape(1),
                                       {radius, tolerance, best_share, threads});
    }
    return to_numpy(std::move(costs), {photo.shape(0), photo.shape(1), homographies.shape(1)});
}

nb::tuple pick(const Costs& costs, const Photo& photo,
               int small_step, int large_step, double edge, int threads) {
    usdfoliage::PlanePicks picks;
    {
        nb::gil_scoped_release unlocked;
        picks = usdfoliage::pick_planes(costs.data(), costs.shape(2), brightness(photo), {small_step, large_step, edge, threads});
    }
    return nb::make_tuple(to_numpy(std::move(picks.plane), {photo.shape(0), photo.shape(1)}),
                          to_numpy(std::move(picks.uniqueness), {photo.shape(0), photo.shape(1)}));
}

}  // namespace

void bind_plane_sweep(nb::module_& m) {
    m.def("sweep_cost", &cost, "photo"_a, "others"_a, "homographies"_a, "radius"_a, "tolerance"_a, "best_share"_a, "threads"_a,
          "Census cost (H, W, planes) of a photograph on every plane, from others warped by homographies (others, planes, 3, 3).");
    m.def("pick_planes", &pick, "cost"_a, "photo"_a, "small_step"_a, "large_step"_a, "edge"_a, "threads"_a,
          "Plane of each pixel by semiglobal matching (H, W), between planes, and how far it stands out (H, W) in [0, 1].");
}
