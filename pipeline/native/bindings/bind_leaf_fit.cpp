#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>

#include <vector>

#include "bindings/bindings.h"
#include "leaf/fit.h"
#include "leaf/scanlines.h"

namespace nb = nanobind;
using namespace nb::literals;

namespace {

template <typename T, typename... Shape>
using Array = nb::ndarray<T, Shape..., nb::c_contig, nb::device::cpu>;
template <typename T>
using Row = Array<T, nb::ndim<1>>;
using Points = Array<const double, nb::shape<-1, 3>>;

void fit(const Points& points, const Points& normals, const Row<const long long>& offsets, std::size_t min_points, bool trim,
         double isolation, std::size_t scanlines, int max_iterations, double tolerance, int robustness, double prior,
         const Array<double, nb::shape<-1, 7, 3>>& parameters, const Array<double, nb::shape<-1, 7, 3>>& ellipses, const Array<double, nb::shape<-1, 3>>& bases,
         const Array<double, nb::shape<-1, 3, 3>>& axes, const Row<double>& lengths, const Row<double>& residuals,
         const Row<double>& coverages, const Row<int>& iterations, const Row<int>& outcomes, int threads) {
    const usdfoliage::LeafFitSettings settings{{min_points, trim, isolation},
                                               scanlines,
                                               max_iterations,
                                               tolerance,
                                               static_cast<usdfoliage::Robustness>(robustness),
                                               prior};
    const usdfoliage::LeafFits fits{parameters.data(), ellipses.data(),  bases.data(),      axes.data(),    lengths.data(),
                                    residuals.data(),  coverages.data(), iterations.data(), outcomes.data()};
    nb::gil_scoped_release unlocked;
    usdfoliage::fit_leaves(points.data(), normals.data(), offsets.data(), offsets.shape(0) - 1, settings, fits, threads);
}

void map(const Array<const double, nb::shape<7, 3>>& leaf, double half_width, const Points& points, std::size_t lines,
         const Array<double, nb::shape<-1, 2>>& uv, const Row<int>& line, const Array<double, nb::shape<-1, 2>>& weights) {
    nb::gil_scoped_release unlocked;
    const std::size_t n = points.shape(0);
    std::vector<usdfoliage::Mapped> mapped(n);
    std::vector<usdfoliage::Scanline> scanlines(lines);
    for (std::size_t i = 0; i < n; ++i) mapped[i] = {0, points.data()[3 * i + 1], -1};
    usdfoliage::map_points(leaf.data(), {half_width, 0.5}, points.data(), std::vector<unsigned char>(n, 1), &mapped, &scanlines);
    for (std::size_t i = 0; i < n; ++i) {
        uv.data()[2 * i] = mapped[i].u;
        uv.data()[2 * i + 1] = mapped[i].v;
        line.data()[i] = mapped[i].line;
    }
    for (std::size_t j = 0; j < lines; ++j)
        for (int side = 0; side < 2; ++side) weights.data()[2 * j + side] = scanlines[j].weight[side];
}

}  // namespace

// Outputs are written in place: a converted copy of one would be lost.
void bind_leaf_fit(nb::module_& m) {
    m.def("fit_leaves", &fit, "points"_a, "normals"_a, "offsets"_a, "min_points"_a, "trim"_a, "isolation"_a, "scanlines"_a,
          "max_iterations"_a, "tolerance"_a, "robustness"_a, "prior"_a, "parameters"_a.noconvert(), "ellipses"_a.noconvert(), "bases"_a.noconvert(),
          "axes"_a.noconvert(), "lengths"_a.noconvert(), "residuals"_a.noconvert(), "coverages"_a.noconvert(),
          "iterations"_a.noconvert(), "outcomes"_a.noconvert(), "threads"_a,
          "Fill what is fitted to the points of each leaf. Arguments are trusted.");
    m.def("map_leaf_points", &map, "leaf"_a, "half_width"_a, "points"_a, "lines"_a, "uv"_a.noconvert(), "line"_a.noconvert(),
          "weights"_a.noconvert(), "Fill the (u, v) of points (P, 3) of one leaf and the weights of its scanlines.");
}
