#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/vector.h>

#include <cstdint>
#include <utility>
#include <vector>

#include "bindings/arrays.h"
#include "bindings/bindings.h"
#include "bindings/structs.h"
#include "mvs/plane_sweep.h"

namespace nb = nanobind;
using namespace nb::literals;

namespace {

using Homographies = nb::ndarray<const double, nb::shape<-1, -1, 3, 3>, nb::c_contig, nb::device::cpu>;
using Costs = nb::ndarray<const std::uint8_t, nb::shape<-1, -1, -1>, nb::c_contig, nb::device::cpu>;
using Photo = nb::ndarray<const std::int16_t, nb::shape<-1, -1>, nb::c_contig, nb::device::cpu>;
using usdfoliage::SemiglobalSettings;
using usdfoliage::SweepCostSettings;

struct PlanePicks {
    nb::object plane, uniqueness;
};

usdfoliage::Brightness brightness(const Photo& photo) {
    return {photo.data(), static_cast<int>(photo.shape(1)), static_cast<int>(photo.shape(0))};
}

nb::ndarray<nb::numpy, std::uint8_t> cost(const Photo& photo, const std::vector<Photo>& others, const Homographies& homographies,
                                          const SweepCostSettings& settings, int threads) {
    std::vector<usdfoliage::Brightness> seen;
    for (const Photo& other : others) seen.push_back(brightness(other));
    std::vector<std::uint8_t> costs;
    {
        nb::gil_scoped_release unlocked;
        costs = usdfoliage::sweep_cost(brightness(photo), seen, homographies.data(), homographies.shape(1), settings, threads);
    }
    return to_numpy(std::move(costs), {photo.shape(0), photo.shape(1), homographies.shape(1)});
}

PlanePicks pick(const Costs& costs, const Photo& photo, const SemiglobalSettings& settings, int threads) {
    usdfoliage::PlanePicks picks;
    {
        nb::gil_scoped_release unlocked;
        picks = usdfoliage::pick_planes(costs.data(), costs.shape(2), brightness(photo), settings, threads);
    }
    return {to_array(std::move(picks.plane), {photo.shape(0), photo.shape(1)}),
            to_array(std::move(picks.uniqueness), {photo.shape(0), photo.shape(1)})};
}

}  // namespace

void bind_plane_sweep(nb::module_& m) {
    bind_settings(m, "SweepCostSettings", "How a photograph is compared with others.",
                  field("window_px", &SweepCostSettings::window_px, "Radius of the census window."),
                  field("tolerance_64ths", &SweepCostSettings::tolerance_64ths,
                        "Differences of brightness up to here are none; of 16320."),
                  field("best_share", &SweepCostSettings::best_share,
                        "Of the other photographs at each pixel, so many with the lowest cost count."));
    bind_settings(m, "SemiglobalSettings", "What a change of plane between neighbours costs.",
                  field("small_step_cost", &SemiglobalSettings::small_step_cost, "Of one plane."),
                  field("large_step_cost", &SemiglobalSettings::large_step_cost,
                        "Of more, where the photograph is even; below 8000."),
                  field("edge_64ths", &SemiglobalSettings::edge_64ths, "Difference of brightness that halves it; of 16320."));
    bind_result(m, "PlanePicks", "The plane of each pixel.",
                field("plane", &PlanePicks::plane, "(H, W), between planes."),
                field("uniqueness", &PlanePicks::uniqueness, "(H, W) in [0, 1], how far it differs from others."));
    m.def("sweep_cost", &cost, "photo"_a, "others"_a, nb::kw_only(), "homographies"_a, "settings"_a, "threads"_a,
          "Census cost (H, W, planes) of a photograph on every plane, from others warped by homographies (others, planes, 3, 3).");
    m.def("pick_planes", &pick, "cost"_a, "photo"_a, nb::kw_only(), "settings"_a, "threads"_a,
          "Plane of each pixel by semiglobal matching.");
}
