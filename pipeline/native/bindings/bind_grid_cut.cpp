#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>

#include "bindings/arrays.h"
#include "bindings/bindings.h"
#include "geometry/grid_cut.h"

namespace nb = nanobind;
using namespace nb::literals;

namespace {

using Capacities = nb::ndarray<const std::int32_t, nb::shape<-1, -1>, nb::c_contig, nb::device::cpu>;

nb::ndarray<nb::numpy, std::uint8_t> cut(const Capacities& down, const Capacities& right, const Capacities& terminal) {
    const std::size_t rows = terminal.shape(0), columns = terminal.shape(1);
    std::vector<std::uint8_t> side;
    {
        nb::gil_scoped_release unlocked;
        side = usdfoliage::cut_grid(down.data(), right.data(), terminal.data(), rows, columns);
    }
    return to_numpy(std::move(side), {rows, columns});
}

}  // namespace

void bind_grid_cut(nb::module_& m) {
    m.def("cut_grid", &cut, "down"_a, "right"_a, "terminal"_a,
          "Minimum cut of a grid (H, W): 0 for the first end, 1 for the second. The last row and column lead to the first.");
}
