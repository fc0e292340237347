#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/vector.h>

#include <cstdint>
#include <optional>
#include <tuple>
#include <utility>
#include <vector>

#include "bindings/arrays.h"
#include "bindings/bindings.h"
#include "segmentation/depth_coherence.h"
#include "segmentation/claims.h"
#include "segmentation/local_planes.h"

namespace nb = nanobind;
using namespace nb::literals;

namespace {

template <typename T, typename Shape>
using Array = nb::ndarray<const T, Shape, nb::c_contig, nb::device::cpu>;
using Depth = Array<float, nb::shape<-1, -1>>;
using Intrinsics = Array<double, nb::shape<4>>;
using Matrix = Array<double, nb::shape<3, 4>>;
using Camera = std::tuple<Depth, Intrinsics, Matrix>;  // depth; focal lengths and centre; cam_from_world
using Labels = Array<std::int32_t, nb::shape<-1, -1>>;
using Floats = Array<float, nb::shape<-1, -1>>;
using Bytes = Array<std::uint8_t, nb::shape<-1, -1>>;
using Kinds = Array<std::uint8_t, nb::shape<-1>>;
using Planes = Array<float, nb::shape<-1, 3>>;
using Points = Array<double, nb::shape<-1, 3>>;
using Integers = Array<std::int64_t, nb::shape<-1>>;
using IntegersOut = nb::ndarray<std::int64_t, nb::shape<-1>, nb::c_contig, nb::device::cpu>;
using Axes = Array<double, nb::shape<-1, 3, 3>>;
using Grids = Array<double, nb::shape<-1, -1, -1, 3>>;

usdfoliage::DepthView to_view(const Camera& camera) {
    const auto& [depth, intrinsics, cam_from_world] = camera;
    const double* k = intrinsics.data();
    return {depth.data(), static_cast<int>(depth.shape(1)), static_cast<int>(depth.shape(0)), {k[0], k[1]}, {k[2], k[3]},
            cam_from_world.data()};
}

std::size_t rows(const Camera& camera) { return std::get<0>(camera).shape(0); }
std::size_t columns(const Camera& camera) { return std::get<0>(camera).shape(1); }

nb::tuple planes(const Camera& camera, const std::optional<Integers>& pixels, int radius, double footprints, double noise, int threads) {
    const usdfoliage::DepthView view = to_view(camera);
    const std::size_t n = pixels ? pixels->shape(0) : view.pixels();
    std::vector<float> found(3 * n), support(n);
    {
        nb::gil_scoped_release unlocked;
        usdfoliage::fit_local_planes(view, pixels ? pixels->data() : nullptr, n, {radius, footprints, noise, threads}, found.data(),
                                     support.data());
    }
    return nb::make_tuple(to_numpy(std::move(found), {n, 3}), to_numpy(std::move(support), {n}));
}

nb::ndarray<nb::numpy, float> normals(const Camera& camera, const Planes& fitted, const std::optional<Integers>& pixels, int threads) {
    const std::size_t n = fitted.shape(0);
    std::vector<float> found(3 * n);
    {
        nb::gil_scoped_release unlocked;
        usdfoliage::plane_normals(to_view(camera), fitted.data(), pixels ? pixels->data() : nullptr, n, threads, found.data());
    }
    return to_numpy(std::move(found), {n, 3});
}

nb::tuple gaps(const Camera& camera, const Planes& fitted, int threads) {
    const usdfoliage::DepthView view = to_view(camera);
    std::vector<float> right(view.pixels()), down(view.pixels());
    {
        nb::gil_scoped_release unlocked;
        usdfoliage::measure_gaps(view, fitted.data(), threads, right.data(), down.data());
    }
    return nb::make_tuple(to_numpy(std::move(right), {rows(camera), columns(camera)}),
                          to_numpy(std::move(down), {rows(camera), columns(camera)}));
}

nb::tuple pieces(const Camera& camera, const Floats& right, const Floats& down, const Bytes& valid, double limit, double noise,
                 std::size_t least) {
    const usdfoliage::DepthView view = to_view(camera);
    std::vector<std::int32_t> labels(view.pixels());
    std::int32_t count = 0;
    {
        nb::gil_scoped_release unlocked;
        count = usdfoliage::join_pixels(view, right.data(), down.data(), valid.data(), limit, noise, least, labels.data());
    }
    return nb::make_tuple(to_numpy(std::move(labels), {rows(camera), columns(camera)}), count);
}

nb::ndarray<nb::numpy, std::uint8_t> edges(const Camera& camera, const Labels& labels, const std::optional<Integers>& pixels,
                                           double footprints, double noise, int threads) {
    const usdfoliage::DepthView view = to_view(camera);
    const std::size_t n = pixels ? pixels->shape(0) : view.pixels();
    std::vector<std::uint8_t> kinds(n);
    {
        nb::gil_scoped_release unlocked;
        usdfoliage::classify_edges(view, labels.data(), pixels ? pixels->data() : nullptr, n, footprints, noise, threads,
                                   kinds.data());
    }
    return to_numpy(std::move(kinds), {n});
}

nb::tuple outermost(const Camera& camera, const Labels& labels, const Planes& fitted, const Integers& pixels, const Kinds& kinds,
                   int most, int threads) {
    const std::size_t n = pixels.shape(0);
    std::vector<double> places(2 * n), depths(n);
    {
        nb::gil_scoped_release unlocked;
        usdfoliage::place_edges(to_view(camera), labels.data(), fitted.data(), pixels.data(), kinds.data(), n, most, threads,
                                places.data(), depths.data());
    }
    return nb::make_tuple(to_numpy(std::move(places), {n, 2}), to_numpy(std::move(depths), {n}));
}

nb::tuple sums(const Camera& camera, const Labels& labels, std::size_t count) {
    std::vector<double> first, moments;
    {
        nb::gil_scoped_release unlocked;
        moments = usdfoliage::sum_points(to_view(camera), labels.data(), count, first);
    }
    return nb::make_tuple(to_numpy(std::move(moments), {count, 10}), to_numpy(std::move(first), {count, 3}));
}

nb::ndarray<nb::numpy, double> extents(const Camera& camera, const Labels& labels, const Axes& axes, double least_cosine) {
    std::vector<double> measured;
    {
        nb::gil_scoped_release unlocked;
        measured = usdfoliage::measure_extents(to_view(camera), labels.data(), axes.shape(0), axes.data(), least_cosine);
    }
    return to_numpy(std::move(measured), {axes.shape(0), 3});
}

nb::tuple fuse(const Camera& camera, const std::vector<Camera>& others, double footprints, double noise, int least_own,
               int least_others, int threads) {
    const usdfoliage::DepthView view = to_view(camera);
    std::vector<usdfoliage::DepthView> seen;
    for (const Camera& other : others) seen.push_back(to_view(other));
    std::vector<float> depth(view.pixels());
    std::vector<std::uint8_t> kinds(view.pixels());
    {
        nb::gil_scoped_release unlocked;
        usdfoliage::fuse_depth(view, seen, {footprints, noise, least_own, least_others, threads}, depth.data(), kinds.data());
    }
    return nb::make_tuple(to_numpy(std::move(depth), {rows(camera), columns(camera)}),
                          to_numpy(std::move(kinds), {rows(camera), columns(camera)}));
}

nb::ndarray<nb::numpy, std::int32_t> claim(const Grids& grids, const Floats& penalty, const Camera& camera, double footprints,
                                           double noise, double least_cosine, int threads) {
    const usdfoliage::DepthView view = to_view(camera);
    std::vector<std::int32_t> labels(view.pixels());
    {
        nb::gil_scoped_release unlocked;
        usdfoliage::claim_pixels({grids.data(), grids.shape(0), static_cast<int>(grids.shape(1)), static_cast<int>(grids.shape(2)), penalty.data()},
                                 view, {footprints, noise}, least_cosine, threads, labels.data());
    }
    return to_numpy(std::move(labels), {rows(camera), columns(camera)});
}

nb::ndarray<nb::numpy, std::uint8_t> classify(const Points& points, const Camera& camera, double footprints, double noise,
                                              int threads) {
    std::vector<std::uint8_t> states(points.shape(0));
    {
        nb::gil_scoped_release unlocked;
        usdfoliage::classify_points(points.data(), points.shape(0), to_view(camera), {footprints, noise}, threads, states.data());
    }
    return to_numpy(std::move(states), {points.shape(0)});
}

nb::ndarray<nb::numpy, std::int64_t> count(const Camera& camera, const Labels& labels, std::size_t leaves) {
    std::vector<std::int64_t> counts;
    {
        nb::gil_scoped_release unlocked;
        counts = usdfoliage::count_labels(to_view(camera), labels.data(), leaves);
    }
    return to_numpy(std::move(counts), {leaves});
}

nb::tuple pick(const Camera& camera, const Labels& labels, const Integers& total, const Integers& kept, const Integers& offsets,
               const IntegersOut& seen) {
    usdfoliage::PickedPixels picked;
    {
        nb::gil_scoped_release unlocked;
        picked = usdfoliage::pick_pixels(to_view(camera), labels.data(), total.data(), kept.data(), offsets.data(), seen.data());
    }
    const std::size_t n = picked.pixel.size();
    return nb::make_tuple(to_numpy(std::move(picked.pixel), {n}), to_numpy(std::move(picked.place), {n}));
}

}  // namespace

void bind_dense_segmentation(nb::module_& m) {
    m.def("fit_local_planes", &planes, "camera"_a, "pixels"_a.none(), "radius"_a, "footprints"_a, "noise"_a, "threads"_a,
          "Planes (P, 3) around pixels, slopes and value of inverse depth, and their support (P,).");
    m.def("plane_normals", &normals, "camera"_a, "planes"_a, "pixels"_a.none(), "threads"_a,
          "Unit normals (P, 3) in the world, towards the camera, of planes (P, 3) around pixels.");
    m.def("measure_gaps", &gaps, "camera"_a, "planes"_a, "threads"_a,
          "Gaps (H, W) between the planes of neighbours, to the right and down, in footprints of a pixel.");
    m.def("join_pixels", &pieces, "camera"_a, "right"_a, "down"_a, "valid"_a, "limit"_a, "noise"_a, "least"_a,
          "Connected pieces (H, W), 0 for none, and their number.");
    m.def("classify_edges", &edges, "camera"_a, "labels"_a, "pixels"_a.none(), "footprints"_a, "noise"_a, "threads"_a,
          "Kinds (P,) of pixels by their labels (H, W): 0 interior, 1 free, 2 hidden, 3 unknown edge.");
    m.def("place_edges", &outermost, "camera"_a, "labels"_a, "planes"_a, "pixels"_a, "kinds"_a, "most"_a, "threads"_a,
          "Places (P, 2) in pixels and depths (P,) where what pixels show ends, or of their centres.");
    m.def("sum_points", &sums, "camera"_a, "labels"_a, "count"_a,
          "Sums (K, 10) over each label's points in camera axes about its first (K, 3).");
    m.def("measure_extents", &extents, "camera"_a, "labels"_a, "axes"_a, "least_cosine"_a,
          "Extents along each label's first two axes, and its area: (K, 3).");
    m.def("fuse_depth", &fuse, "camera"_a, "others"_a, "footprints"_a, "noise"_a, "least_own"_a, "least_others"_a, "threads"_a,
          "A view's depth (H, W) from its own and others', and what became of each pixel (H, W).");
    m.def("claim_pixels", &claim, "grids"_a, "penalty"_a, "camera"_a, "footprints"_a, "noise"_a, "least_cosine"_a, "threads"_a,
          "Which leaf (H, W) each pixel shows, from grids (N, V, U, 3); 0 for none, k for the leaf k - 1.");
    m.def("classify_points", &classify, "points"_a, "camera"_a, "footprints"_a, "noise"_a, "threads"_a,
          "States (P,) of points to what a view sees: 0 unseen, 1 on it, 2 before it, 3 behind it.");
    m.def("count_labels", &count, "camera"_a, "labels"_a, "leaves"_a,
          "How many pixels with depth each label from 1 to leaves has: (N,).");
    m.def("pick_pixels", &pick, "camera"_a, "labels"_a, "total"_a, "kept"_a, "offsets"_a, "seen"_a,
          "Pixels picked evenly of each leaf and their places among all points; seen (N,) is brought up to date.");
}
