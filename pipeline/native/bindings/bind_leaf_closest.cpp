#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>

#include <cstdint>

#include "bindings/bindings.h"
#include "leaf/closest.h"

namespace nb = nanobind;
using namespace nb::literals;

namespace {

using Vectors = nb::ndarray<const double, nb::shape<-1, 3>, nb::c_contig, nb::device::cpu>;
using Numbers = nb::ndarray<const double, nb::shape<-1>, nb::c_contig, nb::device::cpu>;
using Integers = nb::ndarray<const std::int64_t, nb::shape<-1>, nb::c_contig, nb::device::cpu>;
using Flags = nb::ndarray<const std::uint8_t, nb::shape<-1>, nb::c_contig, nb::device::cpu>;
using Leaves = nb::ndarray<const double, nb::shape<-1, 7, 3>, nb::c_contig, nb::device::cpu>;
using Frames = nb::ndarray<const double, nb::shape<-1, 3, 3>, nb::c_contig, nb::device::cpu>;
using PairsOut = nb::ndarray<double, nb::shape<-1, 2>, nb::c_contig, nb::device::cpu>;
using NumbersOut = nb::ndarray<double, nb::shape<-1>, nb::c_contig, nb::device::cpu>;

void project(const Vectors& points, const Flags& edge, const Integers& offsets, const Leaves& parameters,
             const Frames& axes, const Vectors& bases, const Numbers& lengths, const PairsOut& uv,
             const NumbersOut& distances, int threads) {
    nb::gil_scoped_release unlocked;
    usdfoliage::project_to_leaves(points.data(), edge.data(), offsets.data(), parameters.data(), axes.data(), bases.data(),
                                  lengths.data(), parameters.shape(0), uv.data(), distances.data(), threads);
}

}  // namespace

void bind_leaf_closest(nb::module_& m) {
    m.def("project_to_leaves", &project, "points"_a, "edge"_a, "offsets"_a, "parameters"_a, "axes"_a, "bases"_a, "lengths"_a,
          "uv"_a, "distances"_a, "threads"_a, "Fill uv (P, 2) and distances (P,) of the closest places to points (P, 3).");
}
