#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>

#include <utility>
#include <vector>

#include "bindings/arrays.h"
#include "bindings/bindings.h"
#include "bindings/structs.h"
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
using usdfoliage::LeafFitSettings;
using usdfoliage::Robustness;

struct LeafFits {
    nb::object parameters, ellipses, base_m, axes, length_m, residual_m, coverages, iterations, outcomes;
};

LeafFits fit(const Points& points, const Points& normals, const Row<const long long>& offsets, const LeafFitSettings& settings,
             int threads) {
    const std::size_t n = offsets.shape(0) - 1;
    std::vector<double> parameters(21 * n), ellipses(21 * n), bases(3 * n), axes(9 * n), lengths(n), residuals(n), coverages(n);
    std::vector<int> iterations(n), outcomes(n);
    {
        nb::gil_scoped_release unlocked;
        const usdfoliage::LeafFits fits{parameters.data(), ellipses.data(),  bases.data(),      axes.data(),    lengths.data(),
                                        residuals.data(),  coverages.data(), iterations.data(), outcomes.data()};
        usdfoliage::fit_leaves(points.data(), normals.data(), offsets.data(), n, settings, fits, threads);
    }
    return {to_array(std::move(parameters), {n, 7, 3}), to_array(std::move(ellipses), {n, 7, 3}),
            to_array(std::move(bases), {n, 3}),         to_array(std::move(axes), {n, 3, 3}),
            to_array(std::move(lengths), {n}),          to_array(std::move(residuals), {n}),
            to_array(std::move(coverages), {n}),        to_array(std::move(iterations), {n}),
            to_array(std::move(outcomes), {n})};
}

void map(const Array<const double, nb::shape<7, 3>>& leaf, const Points& points, double half_width,
         const Array<double, nb::shape<-1, 2>>& uv, const Row<int>& line, const Array<double, nb::shape<-1, 2>>& weights) {
    nb::gil_scoped_release unlocked;
    const std::size_t n = points.shape(0), lines = weights.shape(0);
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

void bind_types(nb::module_& m) {
    using S = LeafFitSettings;
    nb::enum_<Robustness>(m, "Robustness", "What points off the surface count.")
        .value("NONE", Robustness::kNone, "As much as all others; none is left out.")
        .value("HUBER", Robustness::kHuber, "Huber's weights.")
        .value("TUKEY", Robustness::kTukey, "Tukey's weights.");
    bind_settings(m, "LeafFitSettings", "How leaves are fitted, and which are not.",
                  field("min_points", &S::min_points, "Leaves of fewer are not fitted."),
                  field("isolation", &S::isolation,
                        "Points whose neighbours are this many times farther than the median are left out."),
                  field("scanlines", &S::scanlines, "At most; a leaf of few points has fewer."),
                  field("max_iterations", &S::max_iterations, "Of mapping and fitting in turns."),
                  field("tolerance", &S::tolerance, "Root mean square change, in leaf lengths, that ends the iterations."),
                  field("robustness", &S::robustness, "What points off the surface count."),
                  field("prior", &S::prior, "Pull towards the enclosing ellipse, a share of what all points pull."));
    bind_result(m, "LeafFits", "What is fitted to M leaves; zeros where the outcome is not 0.",
                field("parameters", &LeafFits::parameters, "(M, 7, 3)."),
                field("ellipses", &LeafFits::ellipses, "(M, 7, 3), the leaves that the fits began with."),
                field("base_m", &LeafFits::base_m, "(M, 3)."),
                field("axes", &LeafFits::axes, "(M, 3, 3), rows x, y and z of leaf space."),
                field("length_m", &LeafFits::length_m, "(M,)."),
                field("residual_m", &LeafFits::residual_m, "(M,), root mean square distance of all points."),
                field("coverages", &LeafFits::coverages, "(M,), share of the leaf's width that points reach."),
                field("iterations", &LeafFits::iterations, "(M,)."),
                field("outcomes", &LeafFits::outcomes,
                      "(M,), 0 fitted, 1 too few points, 2 not finite, 3 on a line."));
}

}  // namespace

// Outputs are written in place: a converted copy of one would be lost.
void bind_leaf_fit(nb::module_& m) {
    bind_types(m);
    m.def("fit_leaves", &fit, "points_m"_a, "normals"_a, "offsets"_a, nb::kw_only(), "settings"_a, "threads"_a,
          "Fit a leaf to each set of points that begins at offsets. Arguments are trusted.");
    m.def("map_leaf_points", &map, "leaf"_a, "points"_a, nb::kw_only(), "half_width"_a, "uv"_a.noconvert(),
          "line"_a.noconvert(), "weights"_a.noconvert(),
          "Fill the (u, v) of points (P, 3) of one leaf and the weights of its scanlines.");
}
