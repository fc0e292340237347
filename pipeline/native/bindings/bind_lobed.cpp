#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>

#include <cstdint>

#include "bindings/bindings.h"
#include "lobed/deformation.h"

namespace nb = nanobind;
using namespace nb::literals;

namespace {

template <typename T, typename Shape>
using Input = nb::ndarray<const T, Shape, nb::c_contig, nb::device::cpu>;
using Integers = Input<std::int32_t, nb::shape<-1>>;
using Places = Input<double, nb::shape<-1, 2>>;
using Output = nb::ndarray<double, nb::shape<-1, -1, 3>, nb::c_contig, nb::device::cpu>;

void deform(const Places& nodes, const Integers& parents, const Integers& branches, const Places& spans,
            const Integers& tie_nodes, const Places& feet, const Input<std::int64_t, nb::shape<-1, 3, -1>>& key_first,
            const Input<std::int32_t, nb::shape<-1, 3, -1>>& key_counts, const Places& keys, const Output& points, int threads) {
    const usdfoliage::LobedShape shape{nodes.data(),    parents.data(),      branches.data(),  spans.data(),  nodes.shape(0),
                                       key_counts.shape(2), tie_nodes.data(), feet.data(), feet.shape(0)};
    nb::gil_scoped_release unlocked;
    usdfoliage::deform_lobed_leaves(shape, {key_first.data(), key_counts.data(), keys.data()}, key_counts.shape(0),
                                    points.data(), threads);
}

}  // namespace

void bind_lobed(nb::module_& m) {
    m.def("deform_lobed_leaves", &deform, "nodes"_a, nb::kw_only(), "parents"_a, "branches"_a, "spans"_a, "tie_nodes"_a,
          "feet"_a, "key_first"_a, "key_counts"_a, "keys"_a, "points"_a.noconvert(), "threads"_a,
          "Leaves of one flat shape, each deformed by the functions of its branches, into points (M, N + T, 3). Arguments "
          "are trusted.");
}
