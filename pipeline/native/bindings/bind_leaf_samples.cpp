#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>

#include <cstdint>
#include <utility>

#include "bindings/arrays.h"
#include "bindings/bindings.h"
#include "leaf/samples.h"

namespace nb = nanobind;
using namespace nb::literals;

namespace {

using Points = nb::ndarray<const double, nb::shape<-1, 3>, nb::c_contig, nb::device::cpu>;
using Flags = nb::ndarray<const std::uint8_t, nb::shape<-1>, nb::c_contig, nb::device::cpu>;
using Offsets = nb::ndarray<const std::int64_t, nb::shape<-1>, nb::c_contig, nb::device::cpu>;

nb::tuple sample(const Points& points, const Flags& edge, const Offsets& offsets, std::int64_t interior, std::int64_t most_edge,
                 std::int64_t before, double apart, int threads) {
    usdfoliage::SampledPoints sampled;
    {
        nb::gil_scoped_release unlocked;
        sampled = usdfoliage::sample_leaf_points({points.data(), edge.data(), offsets.data(), offsets.shape(0) - 1},
                                                 {interior, most_edge, before, apart}, threads);
    }
    const std::size_t n = sampled.index.size(), leaves = sampled.offsets.size();
    return nb::make_tuple(to_numpy(std::move(sampled.index), {n}), to_numpy(std::move(sampled.apart), {n}),
                          to_numpy(std::move(sampled.offsets), {leaves}));
}

}  // namespace

void bind_leaf_samples(nb::module_& m) {
    m.def("sample_leaf_points", &sample, "points"_a, "edge"_a, "offsets"_a, "interior"_a, "most_edge"_a, "before"_a, "apart"_a,
          "threads"_a, "Indices (S,) of points (P, 3) spread evenly over their leaves, whether each lies apart, offsets (N + 1,).");
}
