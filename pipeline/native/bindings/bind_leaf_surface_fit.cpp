#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>

#include <cstdint>

#include "bindings/bindings.h"
#include "bindings/structs.h"
#include "leaf/surface_fit.h"

namespace nb = nanobind;
using namespace nb::literals;

namespace {

template <typename T, typename Shape>
using Array = nb::ndarray<T, Shape, nb::c_contig, nb::device::cpu>;
using Vectors = Array<const double, nb::shape<-1, 3>>;
using Numbers = Array<const double, nb::shape<-1>>;
using Integers = Array<const std::int64_t, nb::shape<-1>>;
using Flags = Array<const std::uint8_t, nb::shape<-1>>;
using Means = Array<const double, nb::shape<-1, 22>>;
using Precisions = Array<const double, nb::shape<-1, 22, 22>>;
using LeavesOut = Array<double, nb::shape<-1, 7, 3>>;
using FramesOut = Array<double, nb::shape<-1, 3, 3>>;
using VectorsOut = Array<double, nb::shape<-1, 3>>;
using NumbersOut = Array<double, nb::shape<-1>>;
using usdfoliage::SurfaceFitSettings;

struct Points {
    Vectors points_m;
    Flags edge;
    Numbers weights;
    Integers offsets;
    Numbers noise_m;
};

struct Priors {
    Means means;
    Precisions precisions;
};

struct Fits {
    Integers leaf, version;
    LeavesOut parameters;
    FramesOut axes;
    VectorsOut base_m;
    NumbersOut length_m;
    VectorsOut costs;
};

void fit(const Points& points, const Priors& priors, const Fits& fits, const SurfaceFitSettings& settings, int threads) {
    nb::gil_scoped_release unlocked;
    usdfoliage::fit_leaf_surfaces(
        {points.points_m.data(), points.edge.data(), points.weights.data(), points.offsets.data(), points.noise_m.data()},
        {priors.means.data(), priors.precisions.data()}, settings,
        {fits.leaf.data(), fits.version.data(), fits.parameters.data(), fits.axes.data(), fits.base_m.data(),
         fits.length_m.data(), fits.costs.data()},
        fits.leaf.shape(0), threads);
}

}  // namespace

void bind_leaf_surface_fit(nb::module_& m) {
    using S = SurfaceFitSettings;
    bind_settings(m, "SurfaceFitSettings", "How fits go on.", field("iterations", &S::iterations, "Of each fit."),
                  field("first_cutoff", &S::first_cutoff, "Noises beyond which points count less, at first."),
                  field("cutoff", &S::cutoff, "The same in the last third of the iterations."),
                  field("edge_noise", &S::edge_noise, "Noise of points of the edge, in that of the interior."),
                  field("fold_weight", &S::fold_weight, "Of leaves that fold over themselves."));
    nb::class_<Points>(m, "SurfacePoints", "Points of N leaves, leaf after leaf.")
        .def(nb::init<Vectors, Flags, Numbers, Integers, Numbers>(), nb::kw_only(), "points_m"_a, "edge"_a, "weights"_a,
             "offsets"_a, "noise_m"_a);
    nb::class_<Priors>(m, "SurfacePriors", "Normal distributions of what a leaf looks like.")
        .def(nb::init<Means, Precisions>(), nb::kw_only(), "means"_a, "precisions"_a);
    // Written in place: a converted copy would be lost.
    nb::class_<Fits>(m, "SurfaceFits", "Where S fits begin, and what they become.")
        .def(nb::init<Integers, Integers, LeavesOut, FramesOut, VectorsOut, NumbersOut, VectorsOut>(), nb::kw_only(), "leaf"_a,
             "version"_a, "parameters"_a.noconvert(), "axes"_a.noconvert(), "base_m"_a.noconvert(), "length_m"_a.noconvert(),
             "costs"_a.noconvert());
    m.def("fit_leaf_surfaces", &fit, "points"_a, "priors"_a, "fits"_a, nb::kw_only(), "settings"_a, "threads"_a,
          "Improve fits in place, each of a leaf's points under one of the priors.");
}
