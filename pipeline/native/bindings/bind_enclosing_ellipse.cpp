#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>

#include "bindings/bindings.h"
#include "geometry/enclosing_ellipse.h"

namespace nb = nanobind;
using namespace nb::literals;

namespace {

template <typename T, typename... Shape>
using Array = nb::ndarray<T, Shape..., nb::c_contig, nb::device::cpu>;

void ellipses(const Array<const double, nb::shape<-1, 2>>& points, const Array<const long long, nb::ndim<1>>& offsets,
              double tolerance, const Array<double, nb::shape<-1, 2>>& centers,
              const Array<double, nb::shape<-1, 2>>& halves, const Array<double, nb::ndim<1>>& angles, int threads) {
    nb::gil_scoped_release unlocked;
    usdfoliage::enclosing_ellipses(points.data(), offsets.data(), offsets.shape(0) - 1, tolerance, centers.data(),
                                   halves.data(), angles.data(), threads);
}

}  // namespace

// Outputs are written in place: a converted copy of one would be lost.
void bind_enclosing_ellipse(nb::module_& m) {
    m.def("enclosing_ellipses", &ellipses, "points"_a, "offsets"_a, nb::kw_only(), "tolerance"_a, "centers"_a.noconvert(),
          "half_axes"_a.noconvert(), "angles"_a.noconvert(), "threads"_a,
          "Fill the smallest ellipses around the sets that begin at offsets (M + 1,). Arguments are trusted.");
}
