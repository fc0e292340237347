#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>

#include <cstdint>
#include <utility>
#include <vector>

#include "bindings/arrays.h"
#include "bindings/bindings.h"
#include "bindings/structs.h"
#include "leaf/raster.h"

namespace nb = nanobind;
using namespace nb::literals;

namespace {

using Grids = nb::ndarray<const double, nb::shape<-1, -1, -1, 3>, nb::c_contig, nb::device::cpu>;

struct DrawnLeaves {
    nb::object ids, depth;
};

DrawnLeaves draw(const Grids& places, std::size_t height, std::size_t width, int threads) {
    std::vector<std::int32_t> ids(height * width);
    std::vector<float> depth(height * width);
    {
        nb::gil_scoped_release unlocked;
        usdfoliage::draw_leaf_grids(places.data(), places.shape(0), places.shape(1), places.shape(2), ids.data(), depth.data(),
                                    height, width, threads);
    }
    return {to_array(std::move(ids), {height, width}), to_array(std::move(depth), {height, width})};
}

}  // namespace

void bind_leaf_raster(nb::module_& m) {
    bind_result(m, "DrawnLeaves", "A picture of leaves.", field("ids", &DrawnLeaves::ids, "(H, W), -1 for none."),
                field("depth", &DrawnLeaves::depth, "(H, W), 0 for none."));
    m.def("draw_leaf_grids", &draw, "places"_a, nb::kw_only(), "height"_a, "width"_a, "threads"_a,
          "Draw grids (N, V, U, 3), x, y and depth, with a z-buffer.");
}
