#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>

#include "bindings/arrays.h"
#include "bindings/bindings.h"
#include "branch_tracing/piece_bridges.h"

namespace nb = nanobind;
using namespace nb::literals;

namespace {

template <typename T, typename... Shape>
using Array = nb::ndarray<T, Shape..., nb::c_contig, nb::device::cpu>;

nb::ndarray<nb::numpy, std::int64_t> bridges(const Array<const double, nb::shape<-1, 3>>& points,
                                             const Array<const std::int32_t, nb::ndim<1>>& piece_of, std::size_t pieces) {
    std::vector<std::int64_t> links;
    {
        nb::gil_scoped_release unlocked;
        links = usdfoliage::bridge_pieces(points.data(), piece_of.data(), points.shape(0), pieces);
    }
    const std::size_t count = links.size() / 2;
    return to_numpy(std::move(links), {count, 2});
}

}  // namespace

void bind_piece_bridges(nb::module_& m) {
    m.def("bridge_pieces", &bridges, "points"_a, "piece_of"_a, "pieces"_a,
          "Points (pieces - 1, 2) between which the shortest links are that join all pieces. Arguments are trusted.");
}
