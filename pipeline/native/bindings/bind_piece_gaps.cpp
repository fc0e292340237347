#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>

#include "bindings/arrays.h"
#include "bindings/bindings.h"
#include "geometry/piece_gaps.h"

namespace nb = nanobind;
using namespace nb::literals;

namespace {

template <typename T, typename Shape>
using Input = nb::ndarray<const T, Shape, nb::c_contig, nb::device::cpu>;

nb::ndarray<nb::numpy, double> gaps(const Input<double, nb::shape<-1, 3>>& points,
                                    const Input<std::int32_t, nb::shape<-1, 3>>& corners,
                                    const Input<std::int32_t, nb::shape<-1>>& piece,
                                    const Input<std::int32_t, nb::shape<-1, 2>>& asked_edges,
                                    const Input<std::int64_t, nb::shape<-1>>& asked_first,
                                    const Input<std::int32_t, nb::shape<-1>>& asked_pieces, double near_enough, bool through,
                                    int threads) {
    std::vector<double> found;
    {
        nb::gil_scoped_release unlocked;
        const usdfoliage::PieceMesh mesh{points.data(), corners.data(), piece.data(), corners.shape(0)};
        const usdfoliage::PieceEdges asked{asked_edges.data(), asked_first.data(), asked_pieces.data(),
                                            asked_pieces.shape(0)};
        found = usdfoliage::piece_gaps(mesh, asked, near_enough, through, threads);
    }
    const std::size_t count = found.size();
    return to_numpy(std::move(found), {count});
}

}  // namespace

void bind_piece_gaps(nb::module_& m) {
    m.def("piece_gaps", &gaps, "points"_a, "corners"_a, "piece"_a, nb::kw_only(), "asked_edges"_a, "asked_first"_a,
          "asked_pieces"_a, "near_enough"_a, "through"_a, "threads"_a,
          "Distance (Q,) of each asked piece of a mesh of triangles (T, 3) to all others; where through is true, 0 where an "
          "edge of it goes through one; piece (P,) is that of each point. What is nearer than near_enough need not be the smallest. Arguments are "
          "trusted.");
}
