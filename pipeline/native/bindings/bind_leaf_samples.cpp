#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>

#include <cstdint>
#include <utility>

#include "bindings/arrays.h"
#include "bindings/bindings.h"
#include "bindings/structs.h"
#include "leaf/samples.h"

namespace nb = nanobind;
using namespace nb::literals;

namespace {

using Points = nb::ndarray<const double, nb::shape<-1, 3>, nb::c_contig, nb::device::cpu>;
using Flags = nb::ndarray<const std::uint8_t, nb::shape<-1>, nb::c_contig, nb::device::cpu>;
using Offsets = nb::ndarray<const std::int64_t, nb::shape<-1>, nb::c_contig, nb::device::cpu>;
using usdfoliage::SampleSettings;

struct SampledPoints {
    nb::object index, apart, offsets;
};

SampledPoints sample(const Points& points, const Flags& edge, const Offsets& offsets, const SampleSettings& settings, int threads) {
    usdfoliage::SampledPoints sampled;
    {
        nb::gil_scoped_release unlocked;
        sampled = usdfoliage::sample_leaf_points({points.data(), edge.data(), offsets.data(), offsets.shape(0) - 1}, settings,
                                                 threads);
    }
    const std::size_t n = sampled.index.size(), leaves = sampled.offsets.size();
    return {to_array(std::move(sampled.index), {n}), to_array(std::move(sampled.apart), {n}),
            to_array(std::move(sampled.offsets), {leaves})};
}

}  // namespace

void bind_leaf_samples(nb::module_& m) {
    bind_settings(m, "SampleSettings", "How many points of a leaf are taken.",
                  field("interior", &SampleSettings::interior, "Points of the interior, at most."),
                  field("edge", &SampleSettings::edge, "Points of the edge, at most."),
                  field("before_spread", &SampleSettings::before_spread, "Times as many are looked at as are wanted."),
                  field("apart", &SampleSettings::apart,
                        "Median distances to the fourth neighbour, beyond which a point lies apart."));
    bind_result(m, "SampledPoints", "Points spread evenly over their leaves.",
                field("index", &SampledPoints::index, "(S,), among all points."),
                field("apart", &SampledPoints::apart, "(S,), 1 for those that lie apart."),
                field("offsets", &SampledPoints::offsets, "(N + 1,)."));
    m.def("sample_leaf_points", &sample, "points_m"_a, "edge"_a, "offsets"_a, nb::kw_only(), "settings"_a, "threads"_a,
          "Points spread evenly over their leaves, of points (P, 3).");
}
