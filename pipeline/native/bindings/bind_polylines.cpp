#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/tuple.h>

#include <cstdint>
#include <tuple>
#include <utility>
#include <vector>

#include "bindings/arrays.h"
#include "bindings/bindings.h"
#include "geometry/polylines.h"

namespace nb = nanobind;
using namespace nb::literals;

namespace {

template <typename T, typename Shape>
using Input = nb::ndarray<const T, Shape, nb::c_contig, nb::device::cpu>;
using Numbers = Input<double, nb::shape<-1>>;
using Integers = Input<std::int32_t, nb::shape<-1>>;
using Vectors = Input<double, nb::shape<-1, 3>>;

std::tuple<nb::ndarray<nb::numpy, std::int64_t>, nb::ndarray<nb::numpy, double>> nearest(const Vectors& points,
                                                                                         const Integers& first,
                                                                                         const Integers& counts,
                                                                                         const Vectors& places,
                                                                                         const Integers& line, int threads) {
    const std::size_t n = line.shape(0);
    std::vector<std::int64_t> segment(n);
    std::vector<double> share(n);
    {
        nb::gil_scoped_release unlocked;
        usdfoliage::nearest_on_lines({points.data(), first.data(), counts.data()}, places.data(), line.data(), n,
                                     segment.data(), share.data(), threads);
    }
    return {to_numpy(std::move(segment), {n}), to_numpy(std::move(share), {n})};
}

nb::ndarray<nb::numpy, double> beyond(const Vectors& points, const Integers& first, const Integers& counts,
                                      const Vectors& places, const Integers& line, const Numbers& radius, int threads) {
    const std::size_t n = line.shape(0);
    std::vector<double> found(n);
    {
        nb::gil_scoped_release unlocked;
        usdfoliage::beyond_lines({points.data(), first.data(), counts.data()}, radius.data(), places.data(), line.data(), n,
                                 found.data(), threads);
    }
    return to_numpy(std::move(found), {n});
}

}  // namespace

void bind_polylines(nb::module_& m) {
    m.def("nearest_on_lines", &nearest, "points"_a, "first"_a, "counts"_a, nb::kw_only(), "places"_a, "line"_a, "threads"_a,
          "Segments (N,), by their first points, and shares of them (N,), where polylines are nearest to places (N, 3); line "
          "(N,) is that of each. Arguments are trusted.");
    m.def("beyond_lines", &beyond, "points"_a, "first"_a, "counts"_a, nb::kw_only(), "places"_a, "line"_a, "radius"_a,
          "threads"_a,
          "How far places (N, 3) are outside polylines (N,) with radii at their points. Arguments are trusted.");
}
