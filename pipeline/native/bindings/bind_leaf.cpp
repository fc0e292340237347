#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/optional.h>

#include <optional>

#include "bindings/bindings.h"
#include "leaf/bounds.h"
#include "leaf/curves.h"
#include "leaf/jacobian.h"
#include "leaf/surface.h"

namespace nb = nanobind;
using namespace nb::literals;

namespace {

template <typename... Shape>
using Input = nb::ndarray<const double, Shape..., nb::c_contig, nb::device::cpu>;
template <typename Real>
using Output = nb::ndarray<Real, nb::c_contig, nb::device::cpu>;
using LeafInput = Input<nb::shape<-1, 7, 3>>;
using Placements = Input<nb::shape<-1, 3, 4>>;
using Waves = Input<nb::shape<-1, 2>>;
using Row = Input<nb::ndim<1>>;

struct Jitter {
    double amplitude, frequency;
    Waves waves;
    std::optional<Row> map, phases;
};

template <typename Array>
auto* data_of(const std::optional<Array>& array) {
    return array ? array->data() : nullptr;
}

void nets(const LeafInput& leaves, const Output<double>& out, int threads) {
    nb::gil_scoped_release unlocked;
    usdfoliage::leaf_nets(leaves.data(), leaves.shape(0), out.data(), threads);
}

void axes(const LeafInput& leaves, const Input<nb::ndim<2>>& v, bool shared, const std::optional<Output<double>>& points,
          const std::optional<Output<double>>& normals, int threads) {
    nb::gil_scoped_release unlocked;
    usdfoliage::leaf_axes(leaves.data(), leaves.shape(0), v.data(), v.shape(1), shared, data_of(points), data_of(normals), threads);
}

template <typename Real>
void samples(const LeafInput& leaves, const Input<nb::shape<-1, -1, 2>>& uv, bool shared, const Jitter& given,
             const std::optional<Placements>& placements, const std::optional<Output<Real>>& points,
             const std::optional<Output<Real>>& tangents_u, const std::optional<Output<Real>>& tangents_v,
             const std::optional<Output<Real>>& normals, const std::optional<Output<Real>>& areas, int threads) {
    const usdfoliage::LeafJitter jitter{given.amplitude,     given.frequency,
                                        given.waves.data(),  given.waves.shape(0),
                                        data_of(given.map),  given.map ? given.map->shape(0) : 0,
                                        data_of(given.phases)};
    const usdfoliage::LeafSamples<Real> out{data_of(points), data_of(tangents_u), data_of(tangents_v), data_of(normals),
                                            data_of(areas)};
    nb::gil_scoped_release unlocked;
    usdfoliage::leaf_samples(leaves.data(), leaves.shape(0), uv.data(), uv.shape(1), shared, jitter, data_of(placements), out,
                             threads);
}

template <typename Real>
void jacobians(const LeafInput& leaves, const Input<nb::shape<-1, -1, 2>>& uv, bool shared, const Output<Real>& points,
               const Output<Real>& out, int threads) {
    nb::gil_scoped_release unlocked;
    usdfoliage::leaf_jacobians(leaves.data(), leaves.shape(0), uv.data(), uv.shape(1), shared, points.data(), out.data(), threads);
}

void bounds(const LeafInput& leaves, const std::optional<Placements>& placements, double reach, std::size_t group,
            const Output<double>& out, int threads) {
    nb::gil_scoped_release unlocked;
    usdfoliage::leaf_bounds(leaves.data(), leaves.shape(0), data_of(placements), reach, group, out.data(), threads);
}

// Outputs are written in place: a converted copy of one would be lost.
template <typename Real>
void bind_outputs(nb::module_& m) {
    m.def("leaf_samples", &samples<Real>, "leaves"_a, "uv"_a, nb::kw_only(), "shared"_a, "jitter"_a, "placements"_a.none(),
          "points"_a.none().noconvert(), "tangents_u"_a.none().noconvert(), "tangents_v"_a.none().noconvert(),
          "normals"_a.none().noconvert(), "areas"_a.none().noconvert(), "threads"_a,
          "Fill the outputs that are not None: leaves (N, 7, 3) at uv (N, P, 2), or (1, P, 2) shared by all.");
    m.def("leaf_jacobians", &jacobians<Real>, "leaves"_a, "uv"_a, nb::kw_only(), "shared"_a, "points"_a.noconvert(),
          "jacobians"_a.noconvert(), "threads"_a,
          "Fill points (N, P, 3) and their derivatives (N, P, 3, 21) by the parameters.");
}

}  // namespace

void bind_leaf(nb::module_& m) {
    nb::class_<Jitter>(m, "LeafJitter", "A wave along the silhouettes, the same for all leaves but for the phase.")
        .def(nb::init<double, double, Waves, std::optional<Row>, std::optional<Row>>(), nb::kw_only(), "amplitude"_a,
             "frequency"_a, "waves"_a, "map"_a.none() = nb::none(), "phases"_a.none() = nb::none());
    m.def("leaf_nets", &nets, "leaves"_a, nb::kw_only(), "nets"_a.noconvert(), "threads"_a,
          "Fill control nets (N, 5, 7, 3) of leaves (N, 7, 3). Arguments are trusted.");
    m.def("leaf_axes", &axes, "leaves"_a, "v"_a, nb::kw_only(), "shared"_a, "points"_a.none().noconvert() = nb::none(),
          "normals"_a.none().noconvert() = nb::none(), "threads"_a,
          "Fill points and normals (N, P, 3) of the axes at v (N, P), or (1, P) shared by all.");
    m.def("leaf_bounds", &bounds, "leaves"_a, nb::kw_only(), "placements"_a.none(), "reach"_a, "group"_a,
          "bounds"_a.noconvert(), "threads"_a,
          "Fill boxes (ceil(N / group), 2, 3), least and greatest, around groups of leaves that jitter moves by up to reach.");
    bind_outputs<double>(m);
    bind_outputs<float>(m);
}
