#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>

#include <cstdint>

#include "bindings/bindings.h"
#include "leaf/surface_fit.h"

namespace nb = nanobind;
using namespace nb::literals;

namespace {

using Vectors = nb::ndarray<const double, nb::shape<-1, 3>, nb::c_contig, nb::device::cpu>;
using Numbers = nb::ndarray<const double, nb::shape<-1>, nb::c_contig, nb::device::cpu>;
using Integers = nb::ndarray<const std::int64_t, nb::shape<-1>, nb::c_contig, nb::device::cpu>;
using Flags = nb::ndarray<const std::uint8_t, nb::shape<-1>, nb::c_contig, nb::device::cpu>;
using Means = nb::ndarray<const double, nb::shape<-1, 22>, nb::c_contig, nb::device::cpu>;
using Precisions = nb::ndarray<const double, nb::shape<-1, 22, 22>, nb::c_contig, nb::device::cpu>;
using Leaves = nb::ndarray<double, nb::shape<-1, 7, 3>, nb::c_contig, nb::device::cpu>;
using Frames = nb::ndarray<double, nb::shape<-1, 3, 3>, nb::c_contig, nb::device::cpu>;
using VectorsOut = nb::ndarray<double, nb::shape<-1, 3>, nb::c_contig, nb::device::cpu>;
using NumbersOut = nb::ndarray<double, nb::shape<-1>, nb::c_contig, nb::device::cpu>;

void fit(const Vectors& points, const Flags& edge, const Numbers& weights, const Integers& offsets, const Numbers& noise,
         const Means& means, const Precisions& precisions, const Integers& leaf, const Integers& prior, const Leaves& parameters,
         const Frames& axes, const VectorsOut& bases, const NumbersOut& lengths, const VectorsOut& costs, int iterations,
         double first_cutoff, double last_cutoff, double edge_noise, double fold_weight, int threads) {
    nb::gil_scoped_release unlocked;
    usdfoliage::fit_leaf_surfaces({points.data(), edge.data(), weights.data(), offsets.data(), noise.data()},
                                  {means.data(), precisions.data()},
                                  {iterations, first_cutoff, last_cutoff, edge_noise, fold_weight},
                                  {leaf.data(), prior.data(), parameters.data(), axes.data(), bases.data(), lengths.data(),
                                   costs.data()},
                                  leaf.shape(0), threads);
}

}  // namespace

void bind_leaf_surface_fit(nb::module_& m) {
    m.def("fit_leaf_surfaces", &fit, "points"_a, "edge"_a, "weights"_a, "offsets"_a, "noise"_a, "means"_a, "precisions"_a,
          "leaf"_a, "prior"_a, "parameters"_a, "axes"_a, "bases"_a, "lengths"_a, "costs"_a, "iterations"_a, "first_cutoff"_a,
          "last_cutoff"_a, "edge_noise"_a, "fold_weight"_a, "threads"_a,
          "Improve fits in place: parameters (S, 7, 3), axes (S, 3, 3), bases (S, 3), lengths (S,); costs (S, 3) are written.");
}
