#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>

#include <algorithm>
#include <utility>
#include <vector>

#include "bindings/arrays.h"
#include "bindings/bindings.h"
#include "geometry/pinhole.h"

namespace nb = nanobind;
using namespace nb::literals;

namespace {

using Points = nb::ndarray<const double, nb::shape<-1, 3>, nb::c_contig, nb::device::cpu>;
using Places = nb::ndarray<const double, nb::shape<-1, 2>, nb::c_contig, nb::device::cpu>;
using Depths = nb::ndarray<const double, nb::shape<-1>, nb::c_contig, nb::device::cpu>;
using Intrinsics = nb::ndarray<const double, nb::shape<4>, nb::c_contig, nb::device::cpu>;
using Matrix = nb::ndarray<const double, nb::shape<3, 4>, nb::c_contig, nb::device::cpu>;

usdfoliage::PinholeNumbers to_camera(const Intrinsics& intrinsics, const Matrix& cam_from_world) {
    const double* k = intrinsics.data();
    usdfoliage::PinholeNumbers camera{{}, {k[0], k[1]}, {k[2], k[3]}};
    std::copy(cam_from_world.data(), cam_from_world.data() + 12, camera.cam_from_world);
    return camera;
}

nb::tuple project(const Points& points, const Intrinsics& intrinsics, const Matrix& cam_from_world, int threads) {
    const std::size_t n = points.shape(0);
    std::vector<double> places(2 * n), depths(n);
    {
        nb::gil_scoped_release unlocked;
        usdfoliage::project_points(to_camera(intrinsics, cam_from_world), points.data(), n, threads, places.data(), depths.data());
    }
    return nb::make_tuple(to_numpy(std::move(places), {n, 2}), to_numpy(std::move(depths), {n}));
}

nb::ndarray<nb::numpy, double> unproject(const Places& places, const Depths& depths, const Intrinsics& intrinsics,
                                         const Matrix& cam_from_world, int threads) {
    const std::size_t n = places.shape(0);
    std::vector<double> points(3 * n);
    {
        nb::gil_scoped_release unlocked;
        usdfoliage::unproject_places(to_camera(intrinsics, cam_from_world), places.data(), depths.data(), n, threads, points.data());
    }
    return to_numpy(std::move(points), {n, 3});
}

}  // namespace

void bind_pinhole(nb::module_& m) {
    m.def("project_points", &project, "points"_a, "intrinsics"_a, "cam_from_world"_a, "threads"_a,
          "Places (N, 2) in pixels, NaN behind the camera, and depths (N,) of points (N, 3) of the world.");
    m.def("unproject_places", &unproject, "places"_a, "depths"_a, "intrinsics"_a, "cam_from_world"_a, "threads"_a,
          "Points (N, 3) of the world from places (N, 2) in pixels and depths (N,).");
}
