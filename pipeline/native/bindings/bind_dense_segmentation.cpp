#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/vector.h>

#include <cstdint>
#include <optional>
#include <utility>
#include <vector>

#include "bindings/arrays.h"
#include "bindings/bindings.h"
#include "bindings/structs.h"
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
using usdfoliage::FuseSettings;

// A depth map and its camera: focal lengths and centre; cam_from_world.
struct View {
    Depth depth_m;
    Intrinsics intrinsics;
    Matrix cam_from_world;
};

struct LocalPlanes {
    nb::object slopes, support;
};

struct PlaneGaps {
    nb::object right, down;
};

struct JoinedPixels {
    nb::object labels;
    std::int32_t count;
};

struct EdgePlaces {
    nb::object places_px, depth_m;
};

struct PointSums {
    nb::object pixels, sums, products, first_m;
};

struct Extents {
    nb::object length_m, width_m, area_m2;
};

struct FusedDepth {
    nb::object depth_m, kinds;
};

struct PickedPixels {
    nb::object pixels, places;
};

usdfoliage::DepthView to_view(const View& view) {
    const double* k = view.intrinsics.data();
    return {view.depth_m.data(),
            static_cast<int>(view.depth_m.shape(1)),
            static_cast<int>(view.depth_m.shape(0)),
            {k[0], k[1]},
            {k[2], k[3]},
            view.cam_from_world.data()};
}

std::size_t rows(const View& view) { return view.depth_m.shape(0); }
std::size_t columns(const View& view) { return view.depth_m.shape(1); }

LocalPlanes planes(const View& camera, const std::optional<Integers>& pixels, int radius_px, double steepest, double noise_m, int threads) {
    const usdfoliage::DepthView view = to_view(camera);
    const std::size_t n = pixels ? pixels->shape(0) : view.pixels();
    std::vector<float> found(3 * n), support(n);
    {
        nb::gil_scoped_release unlocked;
        usdfoliage::fit_local_planes(view, pixels ? pixels->data() : nullptr, n, {radius_px, steepest, noise_m}, threads, found.data(),
                                     support.data());
    }
    return {to_array(std::move(found), {n, 3}), to_array(std::move(support), {n})};
}

nb::ndarray<nb::numpy, float> normals(const View& camera, const Planes& fitted, const std::optional<Integers>& pixels, int threads) {
    const std::size_t n = fitted.shape(0);
    std::vector<float> found(3 * n);
    {
        nb::gil_scoped_release unlocked;
        usdfoliage::plane_normals(to_view(camera), fitted.data(), pixels ? pixels->data() : nullptr, n, threads, found.data());
    }
    return to_numpy(std::move(found), {n, 3});
}

PlaneGaps gaps(const View& camera, const Planes& fitted, int threads) {
    const usdfoliage::DepthView view = to_view(camera);
    std::vector<float> right(view.pixels()), down(view.pixels());
    {
        nb::gil_scoped_release unlocked;
        usdfoliage::measure_gaps(view, fitted.data(), threads, right.data(), down.data());
    }
    return {to_array(std::move(right), {rows(camera), columns(camera)}), to_array(std::move(down), {rows(camera), columns(camera)})};
}

JoinedPixels pieces(const View& camera, const Floats& right, const Floats& down, const Bytes& valid, double max_gap, double noise_m,
                    std::size_t min_px) {
    const usdfoliage::DepthView view = to_view(camera);
    std::vector<std::int32_t> labels(view.pixels());
    std::int32_t count = 0;
    {
        nb::gil_scoped_release unlocked;
        count = usdfoliage::join_pixels(view, right.data(), down.data(), valid.data(), max_gap, noise_m, min_px, labels.data());
    }
    return {to_array(std::move(labels), {rows(camera), columns(camera)}), count};
}

nb::ndarray<nb::numpy, std::uint8_t> edges(const View& camera, const Labels& labels, const std::optional<Integers>& pixels,
                                           double footprints, double noise_m, int threads) {
    const usdfoliage::DepthView view = to_view(camera);
    const std::size_t n = pixels ? pixels->shape(0) : view.pixels();
    std::vector<std::uint8_t> kinds(n);
    {
        nb::gil_scoped_release unlocked;
        usdfoliage::classify_edges(view, labels.data(), pixels ? pixels->data() : nullptr, n, footprints, noise_m, threads,
                                   kinds.data());
    }
    return to_numpy(std::move(kinds), {n});
}

EdgePlaces outermost(const View& camera, const Labels& labels, const Planes& fitted, const Integers& pixels, const Kinds& kinds,
                   int beside_px, int threads) {
    const std::size_t n = pixels.shape(0);
    std::vector<double> places(2 * n), depths(n);
    {
        nb::gil_scoped_release unlocked;
        usdfoliage::place_edges(to_view(camera), labels.data(), fitted.data(), pixels.data(), kinds.data(), n, beside_px, threads,
                                places.data(), depths.data());
    }
    return {to_array(std::move(places), {n, 2}), to_array(std::move(depths), {n})};
}

PointSums sums(const View& camera, const Labels& labels, std::size_t count) {
    std::vector<double> first, moments;
    {
        nb::gil_scoped_release unlocked;
        moments = usdfoliage::sum_points(to_view(camera), labels.data(), count, first);
    }
    const auto fields = to_columns(std::move(moments), {count}, {{0, 1}, {1, 3}, {4, 6}});
    return {fields[0], fields[1], fields[2], to_array(std::move(first), {count, 3})};
}

Extents extents(const View& camera, const Labels& labels, const Axes& axes, double min_cosine) {
    std::vector<double> measured;
    {
        nb::gil_scoped_release unlocked;
        measured = usdfoliage::measure_extents(to_view(camera), labels.data(), axes.shape(0), axes.data(), min_cosine);
    }
    const auto fields = to_columns(std::move(measured), {axes.shape(0)}, {{0, 1}, {1, 1}, {2, 1}});
    return {fields[0], fields[1], fields[2]};
}

FusedDepth fuse(const View& camera, const std::vector<View>& others, const FuseSettings& settings, int threads) {
    const usdfoliage::DepthView view = to_view(camera);
    std::vector<usdfoliage::DepthView> seen;
    for (const View& other : others) seen.push_back(to_view(other));
    std::vector<float> depth(view.pixels());
    std::vector<std::uint8_t> kinds(view.pixels());
    {
        nb::gil_scoped_release unlocked;
        usdfoliage::fuse_depth(view, seen, settings, threads, depth.data(), kinds.data());
    }
    return {to_array(std::move(depth), {rows(camera), columns(camera)}), to_array(std::move(kinds), {rows(camera), columns(camera)})};
}

nb::ndarray<nb::numpy, std::int32_t> claim(const View& camera, const Grids& grids, const Floats& penalty, double footprints,
                                           double noise_m, double min_cosine, int threads) {
    const usdfoliage::DepthView view = to_view(camera);
    std::vector<std::int32_t> labels(view.pixels());
    {
        nb::gil_scoped_release unlocked;
        usdfoliage::claim_pixels({grids.data(), grids.shape(0), static_cast<int>(grids.shape(1)), static_cast<int>(grids.shape(2)), penalty.data()},
                                 view, {footprints, noise_m}, min_cosine, threads, labels.data());
    }
    return to_numpy(std::move(labels), {rows(camera), columns(camera)});
}

nb::ndarray<nb::numpy, std::uint8_t> classify(const Points& points, const View& camera, double footprints, double noise_m,
                                              int threads) {
    std::vector<std::uint8_t> states(points.shape(0));
    {
        nb::gil_scoped_release unlocked;
        usdfoliage::classify_points(points.data(), points.shape(0), to_view(camera), {footprints, noise_m}, threads, states.data());
    }
    return to_numpy(std::move(states), {points.shape(0)});
}

nb::ndarray<nb::numpy, std::int64_t> count(const View& camera, const Labels& labels, std::size_t leaves) {
    std::vector<std::int64_t> counts;
    {
        nb::gil_scoped_release unlocked;
        counts = usdfoliage::count_labels(to_view(camera), labels.data(), leaves);
    }
    return to_numpy(std::move(counts), {leaves});
}

PickedPixels pick(const View& camera, const Labels& labels, const Integers& total, const Integers& kept, const Integers& offsets,
               const IntegersOut& seen) {
    usdfoliage::PickedPixels picked;
    {
        nb::gil_scoped_release unlocked;
        picked = usdfoliage::pick_pixels(to_view(camera), labels.data(), total.data(), kept.data(), offsets.data(), seen.data());
    }
    const std::size_t n = picked.pixel.size();
    return {to_array(std::move(picked.pixel), {n}), to_array(std::move(picked.place), {n})};
}

void bind_types(nb::module_& m) {
    nb::class_<View>(m, "DepthView", "A depth map and the pinhole camera that saw it.")
        .def(nb::init<Depth, Intrinsics, Matrix>(), "depth_m"_a, "intrinsics"_a, "cam_from_world"_a)
        .def_prop_ro("depth_m", [](const View& view) { return view.depth_m; }, "(H, W), 0 where there is none.")
        .def_prop_ro("intrinsics", [](const View& view) { return view.intrinsics; }, "(4,), focal lengths and centre, in pixels.")
        .def_prop_ro("cam_from_world", [](const View& view) { return view.cam_from_world; }, "(3, 4).");
    bind_settings(m, "FuseSettings", "When depths of several views are of one surface.",
                  field("footprints", &FuseSettings::footprints, "Of a pixel, that depths may differ by."),
                  field("noise_m", &FuseSettings::noise_m, "And so much more."),
                  field("min_own", &FuseSettings::min_own, "Depths, its own with them, that confirm a pixel's own."),
                  field("min_others", &FuseSettings::min_others,
                        "Depths that stand in for one that is not confirmed, or for none."));
    bind_result(m, "LocalPlanes", "Planes around P pixels.",
                field("slopes", &LocalPlanes::slopes, "(P, 3), inverse depth: change a pixel to the right and down, value."),
                field("support", &LocalPlanes::support, "(P,), about how many neighbours lie on it."));
    bind_result(m, "PlaneGaps", "Gaps between the planes of neighbours, in footprints of a pixel.",
                field("right", &PlaneGaps::right, "(H, W), to the next pixel to the right."),
                field("down", &PlaneGaps::down, "(H, W), to the next pixel below."));
    bind_result(m, "JoinedPixels", "Connected pieces.", field("labels", &JoinedPixels::labels, "(H, W), 0 for none."),
                field("count", &JoinedPixels::count, "Number of pieces."));
    bind_result(m, "EdgePlaces", "Where what P pixels show ends.", field("places_px", &EdgePlaces::places_px, "(P, 2)."),
                field("depth_m", &EdgePlaces::depth_m, "(P,)."));
    bind_result(m, "PointSums", "Sums over the points of K labels, in camera axes.",
                field("pixels", &PointSums::pixels, "(K,), number of points."),
                field("sums", &PointSums::sums, "(K, 3), of x, y and z, from the first point."),
                field("products", &PointSums::products, "(K, 6), of xx, xy, xz, yy, yz and zz, from the first point."),
                field("first_m", &PointSums::first_m, "(K, 3), the first point."));
    bind_result(m, "Extents", "Sizes of K labels.", field("length_m", &Extents::length_m, "(K,), along the first axis."),
                field("width_m", &Extents::width_m, "(K,), along the second."), field("area_m2", &Extents::area_m2, "(K,)."));
    bind_result(m, "FusedDepth", "A view's depth from its own and others'.",
                field("depth_m", &FusedDepth::depth_m, "(H, W), 0 for none."),
                field("kinds", &FusedDepth::kinds, "(H, W), what became of each pixel."));
    bind_result(m, "PickedPixels", "Pixels picked evenly.", field("pixels", &PickedPixels::pixels, "(P,)."),
                field("places", &PickedPixels::places, "(P,), among all points."));
}

}  // namespace

void bind_dense_segmentation(nb::module_& m) {
    bind_types(m);
    m.def("fit_local_planes", &planes, "view"_a, "pixels"_a.none() = nb::none(), nb::kw_only(), "radius_px"_a, "steepest"_a,
          "noise_m"_a, "threads"_a, "Planes around pixels, and their support.");
    m.def("plane_normals", &normals, "view"_a, "slopes"_a, "pixels"_a.none() = nb::none(), nb::kw_only(), "threads"_a,
          "Unit normals (P, 3) in the world, towards the camera, of planes (P, 3) around pixels.");
    m.def("measure_gaps", &gaps, "view"_a, "slopes"_a, nb::kw_only(), "threads"_a,
          "Gaps between the planes of neighbours, in footprints of a pixel.");
    m.def("join_pixels", &pieces, "view"_a, nb::kw_only(), "right"_a, "down"_a, "valid"_a, "max_gap"_a, "noise_m"_a, "min_px"_a,
          "Connected pieces, 0 for none, and their number.");
    m.def("classify_edges", &edges, "view"_a, "labels"_a, "pixels"_a.none() = nb::none(), nb::kw_only(), "footprints"_a,
          "noise_m"_a, "threads"_a, "Kinds (P,) of pixels by their labels (H, W): 0 interior, 1 free, 2 hidden, 3 unknown edge.");
    m.def("place_edges", &outermost, "view"_a, "labels"_a, "slopes"_a, nb::kw_only(), "pixels"_a, "kinds"_a, "beside_px"_a,
          "threads"_a, "Where what pixels show ends, or their centres.");
    m.def("sum_points", &sums, "view"_a, "labels"_a, nb::kw_only(), "count"_a,
          "Sums over each label's points in camera axes about its first.");
    m.def("measure_extents", &extents, "view"_a, "labels"_a, nb::kw_only(), "axes"_a, "min_cosine"_a,
          "Extents along each label's first two axes, and its area.");
    m.def("fuse_depth", &fuse, "view"_a, "others"_a, nb::kw_only(), "settings"_a, "threads"_a,
          "A view's depth from its own and others', and what became of each pixel.");
    m.def("claim_pixels", &claim, "view"_a, "grids"_a, nb::kw_only(), "penalty"_a, "footprints"_a, "noise_m"_a, "min_cosine"_a,
          "threads"_a, "Which leaf (H, W) each pixel shows, from grids (N, V, U, 3); 0 for none, k for the leaf k - 1.");
    m.def("classify_points", &classify, "points_m"_a, "view"_a, nb::kw_only(), "footprints"_a, "noise_m"_a, "threads"_a,
          "States (P,) of points to what a view sees: 0 unseen, 1 on it, 2 before it, 3 behind it.");
    m.def("count_labels", &count, "view"_a, "labels"_a, nb::kw_only(), "count"_a,
          "How many pixels with depth each label from 1 to count has: (N,).");
    m.def("pick_pixels", &pick, "view"_a, "labels"_a, nb::kw_only(), "total"_a, "kept"_a, "offsets"_a, "seen"_a.noconvert(),
          "Pixels picked evenly of each leaf and their places among all points; seen (N,) is brought up to date.");
}
