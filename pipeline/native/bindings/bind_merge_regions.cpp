#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>

#include "bindings/arrays.h"
#include "bindings/bindings.h"
#include "segmentation/merge_regions.h"

namespace nb = nanobind;
using namespace nb::literals;

namespace {

template <typename T>
using Vector = nb::ndarray<const T, nb::ndim<1>, nb::c_contig, nb::device::cpu>;

nb::tuple merge(std::size_t count, const Vector<std::int64_t>& first, const Vector<std::int64_t>& second,
                const Vector<double>& weight, const Vector<double>& divisor, double weakest) {
    usdfoliage::MergedRegions made;
    {
        nb::gil_scoped_release unlocked;
        made = usdfoliage::merge_regions(count, first.data(), second.data(), weight.data(), weight.shape(0), divisor.data(),
                                         weakest);
    }
    const std::size_t joins = made.size.size(), rounds = made.rounds.size();
    return nb::make_tuple(to_array(std::move(made.children), {joins, 2}), to_array(std::move(made.linkage), {joins}),
                          to_array(std::move(made.across), {joins}), to_array(std::move(made.size), {joins}),
                          to_array(std::move(made.rounds), {rounds}));
}

}  // namespace

void bind_merge_regions(nb::module_& m) {
    m.def("merge_regions", &merge, "count"_a, "first"_a, "second"_a, "weight"_a, "divisor"_a, "weakest"_a,
          "Joins of regions that are each other's most strongly linked neighbour: children (J, 2), linkage, across and size "
          "(J,), and where rounds begin (R + 1,). Arguments are trusted.");
}
