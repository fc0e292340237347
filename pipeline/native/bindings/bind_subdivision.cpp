#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>

#include "bindings/arrays.h"
#include "bindings/bindings.h"
#include "bindings/structs.h"
#include "geometry/subdivision.h"

namespace nb = nanobind;
using namespace nb::literals;

namespace {

template <typename T, typename Shape>
using Input = nb::ndarray<const T, Shape, nb::c_contig, nb::device::cpu>;

struct RefinedMesh {
    nb::object points, normals, faces;
};

RefinedMesh refine(const Input<double, nb::shape<-1, 3>>& points, const Input<std::int32_t, nb::shape<-1>>& face_counts,
                   const Input<std::int32_t, nb::shape<-1>>& face_indices, const Input<std::int32_t, nb::shape<-1, 2>>& crease_edges,
                   const Input<float, nb::shape<-1>>& crease_sharpness, const Input<std::int32_t, nb::shape<-1>>& corner_vertices,
                   const Input<float, nb::shape<-1>>& corner_sharpness, int levels, bool limit) {
    const usdfoliage::Cage cage{points.data(),           points.shape(0),         face_counts.data(),
                                face_counts.shape(0),    face_indices.data(),     face_indices.shape(0),
                                crease_edges.data(),     crease_sharpness.data(), crease_edges.shape(0),
                                corner_vertices.data(),  corner_sharpness.data(), corner_vertices.shape(0)};
    usdfoliage::RefinedMesh mesh;
    {
        nb::gil_scoped_release unlocked;
        mesh = usdfoliage::refine_catmull_clark(cage, levels, limit);
    }
    const std::size_t n_points = mesh.points.size() / 3, n_normals = mesh.normals.size() / 3, n_quads = mesh.face_indices.size() / 4;
    return {to_array(std::move(mesh.points), {n_points, 3}), to_array(std::move(mesh.normals), {n_normals, 3}),
            to_array(std::move(mesh.face_indices), {n_quads, 4})};
}

}  // namespace

void bind_subdivision(nb::module_& m) {
    bind_result(m, "RefinedMesh", "A refined mesh of quads.", field("points", &RefinedMesh::points, "(V, 3)."),
                field("normals", &RefinedMesh::normals, "(V, 3) at the limit, else (0, 3)."),
                field("faces", &RefinedMesh::faces, "(F, 4)."));
    m.def("refine_catmull_clark", &refine, "points"_a, "face_counts"_a, "face_indices"_a, nb::kw_only(), "crease_edges"_a,
          "crease_sharpness"_a, "corner_vertices"_a, "corner_sharpness"_a, "levels"_a, "limit"_a,
          "Refined points (V, 3), normals (V, 3; (0, 3) unless limit), quads (F, 4). Arguments are trusted.");
}
