#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>

#include "bindings/arrays.h"
#include "bindings/bindings.h"
#include "forest/crown_choice.h"

namespace nb = nanobind;
using namespace nb::literals;

namespace {

template <typename T, typename Shape>
using Input = nb::ndarray<const T, Shape, nb::c_contig, nb::device::cpu>;

nb::ndarray<nb::numpy, std::int32_t> choose(const Input<double, nb::shape<-1, 2>>& places,
                                            const Input<double, nb::shape<-1>>& radii,
                                            const Input<std::int32_t, nb::shape<-1>>& order, double apart) {
    std::vector<std::int32_t> taken;
    {
        nb::gil_scoped_release unlocked;
        taken = usdfoliage::choose_crowns(places.data(), radii.data(), order.data(), order.shape(0), apart);
    }
    const std::size_t count = taken.size();
    return to_numpy(std::move(taken), {count});
}

}  // namespace

void bind_crown_choice(nb::module_& m) {
    m.def("choose_crowns", &choose, "places"_a, "radii"_a, "order"_a, nb::kw_only(), "apart"_a,
          "Numbers (K,) of crowns that are taken one after another in an order (N,), but none within apart of the sum of "
          "its radius and that of one that was taken. Arguments are trusted.");
}
