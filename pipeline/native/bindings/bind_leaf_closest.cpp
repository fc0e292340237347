#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>

#include <cstdint>
#include <utility>
#include <vector>

#include "bindings/arrays.h"
#include "bindings/bindings.h"
#include "bindings/structs.h"
#include "leaf/closest.h"

namespace nb = nanobind;
using namespace nb::literals;

namespace {

template <typename T, typename Shape>
using Array = nb::ndarray<const T, Shape, nb::c_contig, nb::device::cpu>;
using Vectors = Array<double, nb::shape<-1, 3>>;
using Numbers = Array<double, nb::shape<-1>>;
using Integers = Array<std::int64_t, nb::shape<-1>>;
using Flags = Array<std::uint8_t, nb::shape<-1>>;
using Leaves = Array<double, nb::shape<-1, 7, 3>>;
using Frames = Array<double, nb::shape<-1, 3, 3>>;

struct PosedLeaves {
    Leaves parameters;
    Frames axes;
    Vectors base_m;
    Numbers length_m;
};

struct ClosestPlaces {
    nb::object uv, distance_m;
};

ClosestPlaces project(const Vectors& points, const PosedLeaves& leaves, const Flags& edge, const Integers& offsets, int threads) {
    const std::size_t n = points.shape(0);
    std::vector<double> uv(2 * n), distances(n);
    {
        nb::gil_scoped_release unlocked;
        usdfoliage::project_to_leaves(points.data(), edge.data(), offsets.data(), leaves.parameters.data(), leaves.axes.data(),
                                      leaves.base_m.data(), leaves.length_m.data(), leaves.parameters.shape(0), uv.data(),
                                      distances.data(), threads);
    }
    return {to_array(std::move(uv), {n, 2}), to_array(std::move(distances), {n})};
}

}  // namespace

void bind_leaf_closest(nb::module_& m) {
    nb::class_<PosedLeaves>(m, "PosedLeaves", "N leaves and their places.")
        .def(nb::init<Leaves, Frames, Vectors, Numbers>(), nb::kw_only(), "parameters"_a, "axes"_a, "base_m"_a, "length_m"_a);
    bind_result(m, "ClosestPlaces", "The places of leaves that are closest to P points.",
                field("uv", &ClosestPlaces::uv, "(P, 2)."),
                field("distance_m", &ClosestPlaces::distance_m, "(P,)."));
    m.def("project_to_leaves", &project, "points_m"_a, "leaves"_a, nb::kw_only(), "edge"_a, "offsets"_a, "threads"_a,
          "The places of leaves that are closest to points (P, 3).");
}
