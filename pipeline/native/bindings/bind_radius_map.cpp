#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>

#include "bindings/arrays.h"
#include "bindings/bindings.h"
#include "crown/radius_map.h"

namespace nb = nanobind;
using namespace nb::literals;

namespace {

nb::tuple render(const nb::ndarray<const double, nb::shape<-1, 3>, nb::c_contig, nb::device::cpu>& points,
                 const nb::ndarray<const std::int32_t, nb::shape<-1, 3>, nb::c_contig, nb::device::cpu>& triangles, int size,
                 int threads) {
    usdfoliage::RadiusMap map;
    {
        nb::gil_scoped_release unlocked;
        map = usdfoliage::radius_map(points.data(), points.shape(0), triangles.data(), triangles.shape(0), size, threads);
    }
    const auto side = static_cast<std::size_t>(size);
    return nb::make_tuple(to_numpy(std::move(map.radius), {6, side, side}), to_numpy(std::move(map.triangle), {6, side, side}));
}

}  // namespace

void bind_radius_map(nb::module_& m) {
    m.def("radius_map", &render, "points"_a, "triangles"_a, "size"_a, "threads"_a,
          "Farthest hit of each cubemap texel's ray from the origin: radius (6, N, N), 0 for none, and triangle, -1 for none.");
}
