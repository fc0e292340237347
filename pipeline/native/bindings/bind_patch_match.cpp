#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/vector.h>

#include <algorithm>
#include <cstdint>
#include <optional>
#include <utility>
#include <vector>

#include "bindings/arrays.h"
#include "bindings/bindings.h"
#include "bindings/structs.h"
#include "mvs/depth_fringe.h"
#include "mvs/patch_match.h"
#include "mvs/view_agreement.h"

namespace nb = nanobind;
using namespace nb::literals;

namespace {

template <typename T, typename Shape>
using Array = nb::ndarray<const T, Shape, nb::c_contig, nb::device::cpu>;
using Srgb = Array<std::uint8_t, nb::shape<-1, -1, 3>>;
using Gray = Array<std::uint8_t, nb::shape<-1, -1>>;
using Depth = Array<float, nb::shape<-1, -1>>;
using Warps = Array<double, nb::shape<2, 3, 4>>;
using Planes = Array<float, nb::shape<-1, -1, 3>>;
using Layers = Array<float, nb::shape<-1, -1, -1, 3>>;
using Turn = Array<double, nb::shape<3, 4>>;
using Offsets = Array<int, nb::shape<-1, 2>>;
using Matrix = Array<double, nb::shape<3, 3>>;
using usdfoliage::AgreementSettings;
using usdfoliage::FringeSettings;
using usdfoliage::PatchMatchSettings;

// The arrays of a photograph that gets planes.
struct Reference {
    Srgb srgb, tint;
    Matrix pixel_from_ray;
    std::optional<Gray> mask;
    std::optional<Planes> segment_planes;
    std::optional<Layers> proposals;
};

// The arrays of a photograph that it is matched with.
struct Source {
    Gray gray;
    Srgb tint;
    Warps warps;
    std::optional<Gray> open;
    std::optional<Depth> depth_m;
};

// The arrays of a photograph whose depth is compared with another one's.
struct DepthSource {
    Depth depth_m;
    Warps warps;
    std::optional<Gray> open;
};

// The arrays of a photograph whose planes are seen from another one.
struct PlaneSource {
    Planes planes;
    Depth cost;
    Warps warps;
    Matrix pixel_from_ray;
    Turn turn;
};

struct MatchedPlanes {
    nb::object planes, cost;
};

struct AgreementCounts {
    nb::object agreeing, through;
};

template <typename Array>
auto* data_of(const std::optional<Array>& array) {
    return array ? array->data() : nullptr;
}

// The last column of a warp is its epipole, the others its homography.
void split_warp(const double* warp, double* homography, double* epipole) {
    for (int i = 0; i < 3; ++i) {
        for (int j = 0; j < 3; ++j) homography[3 * i + j] = warp[4 * i + j];
        epipole[i] = warp[4 * i + 3];
    }
}

usdfoliage::MatchSource source_of(const Warps& warps, std::size_t height, std::size_t width) {
    usdfoliage::MatchSource source{};
    split_warp(warps.data(), source.homography, source.epipole);
    split_warp(warps.data() + 12, source.back_homography, source.back_epipole);
    source.height = static_cast<int>(height);
    source.width = static_cast<int>(width);
    return source;
}

MatchedPlanes match(const Reference& from, const std::vector<Source>& given, const Planes& start, const Offsets& offsets,
                    const PatchMatchSettings& settings, int threads) {
    const std::size_t rows = from.srgb.shape(0), columns = from.srgb.shape(1);
    usdfoliage::MatchReference reference{from.srgb.data(),
                                         from.tint.data(),
                                         data_of(from.mask),
                                         data_of(from.segment_planes),
                                         data_of(from.proposals),
                                         from.proposals ? static_cast<int>(from.proposals->shape(0)) : 0,
                                         static_cast<int>(columns),
                                         static_cast<int>(rows),
                                         {}};
    std::copy_n(from.pixel_from_ray.data(), 9, reference.pixel_from_ray);
    std::vector<usdfoliage::MatchSource> sources;
    for (const Source& each : given) {
        usdfoliage::MatchSource source = source_of(each.warps, each.gray.shape(0), each.gray.shape(1));
        source.gray = each.gray.data();
        source.tint = each.tint.data();
        source.open = data_of(each.open);
        source.depth_m = data_of(each.depth_m);
        sources.push_back(source);
    }
    std::vector<float> planes(start.data(), start.data() + start.size());
    std::vector<float> cost(rows * columns);
    {
        nb::gil_scoped_release unlocked;
        usdfoliage::match_planes(reference, sources, offsets.data(), offsets.shape(0), settings, threads, planes.data(),
                                 cost.data());
    }
    return {to_array(std::move(planes), {rows, columns, 3}), to_array(std::move(cost), {rows, columns})};
}

AgreementCounts agreeing(const Depth& depth_m, const std::vector<DepthSource>& given, const AgreementSettings& settings,
                         int threads) {
    std::vector<usdfoliage::MatchSource> sources;
    for (const DepthSource& each : given) {
        usdfoliage::MatchSource source = source_of(each.warps, each.depth_m.shape(0), each.depth_m.shape(1));
        source.depth_m = each.depth_m.data();
        source.open = data_of(each.open);
        sources.push_back(source);
    }
    std::vector<std::uint8_t> counts(2 * depth_m.size());
    {
        nb::gil_scoped_release unlocked;
        usdfoliage::count_agreeing(depth_m.data(), static_cast<int>(depth_m.shape(1)), static_cast<int>(depth_m.shape(0)), sources,
                                   settings, threads, counts.data());
    }
    const auto columns = to_columns(std::move(counts), {depth_m.shape(0), depth_m.shape(1)}, {{0, 1}, {1, 1}});
    return {columns[0], columns[1]};
}

MatchedPlanes show(const std::vector<PlaneSource>& sources, const Matrix& pixel_from_ray, std::size_t width, std::size_t height,
                   float max_cost) {
    std::vector<float> seen(3 * width * height);
    std::vector<float> seen_cost(width * height, max_cost);
    {
        nb::gil_scoped_release unlocked;
        for (const PlaneSource& each : sources) {
            usdfoliage::show_planes(each.planes.data(), each.cost.data(), static_cast<int>(each.planes.shape(1)),
                                    static_cast<int>(each.planes.shape(0)), max_cost, source_of(each.warps, height, width),
                                    each.pixel_from_ray.data(), pixel_from_ray.data(), each.turn.data(), seen.data(),
                                    seen_cost.data());
        }
    }
    return {to_array(std::move(seen), {height, width, 3}), to_array(std::move(seen_cost), {height, width})};
}

auto fringe(const Depth& depth_m, const Srgb& srgb, const FringeSettings& settings, int threads) {
    std::vector<std::uint8_t> found(depth_m.size());
    {
        nb::gil_scoped_release unlocked;
        usdfoliage::find_fringe(depth_m.data(), srgb.data(), static_cast<int>(depth_m.shape(1)),
                                static_cast<int>(depth_m.shape(0)), settings, threads, found.data());
    }
    return to_numpy(std::move(found), {depth_m.shape(0), depth_m.shape(1)});
}

void bind_match_settings(nb::module_& m) {
    using S = PatchMatchSettings;
    bind_settings(
        m, "PatchMatchSettings", "How windows are compared, and how planes spread.",
        field("iterations", &S::iterations, "Each visits every pixel once."),
        field("best_sources", &S::best_sources, "Photographs with the lowest cost that count at each pixel."),
        field("nearest_inverse", &S::nearest_inverse, "Largest inverse depth, in 1 / m."),
        field("farthest_inverse", &S::farthest_inverse, "Smallest inverse depth, in 1 / m, above 0."),
        field("color_scale", &S::color_scale, "Of 765: sum of the differences of three channels that weighs 1 / e."),
        field("distance_scale_px", &S::distance_scale_px, "Distance from the window's middle that weighs 1 / e."),
        field("noise", &S::noise, "Of 255: standard deviation of brightness below which a window has no texture."),
        field("brightness_weight", &S::brightness_weight, "Cost of mean brightness that differs by brightness_scale or more."),
        field("brightness_scale", &S::brightness_scale, "Of 255."),
        field("tint_weight", &S::tint_weight, "Cost of tint that differs by tint_scale or more."),
        field("tint_scale", &S::tint_scale, "Of 765."),
        field("geometric_weight", &S::geometric_weight, "Cost of a pixel of disagreement with a depth map."),
        field("geometric_limit_px", &S::geometric_limit_px, "Disagreement beyond it costs no more."),
        field("open_weight", &S::open_weight, "Cost of every photograph that sees nothing where the plane is."),
        field("segment_weight", &S::segment_weight, "Cost of depth away from the plane of the pixel's segment."),
        field("segment_limit_px", &S::segment_limit_px, "By so much movement in the photograph that moves most, or more."),
        field("segment_texture", &S::segment_texture, "Of 255: standard deviation of brightness that halves this cost."),
        field("step", &S::step, "First change of inverse depth, as a share of its range."),
        field("max_slant", &S::max_slant, "Tangent of the angle between line of sight and normal."),
        field("seed", &S::seed, "Of the random planes."));
}

void bind_inputs(nb::module_& m) {
    nb::class_<Reference>(m, "MatchReference", "The photograph that gets planes.")
        .def(nb::init<Srgb, Srgb, Matrix, std::optional<Gray>, std::optional<Planes>, std::optional<Layers>>(), nb::kw_only(),
             "srgb"_a, "tint"_a, "pixel_from_ray"_a, "mask"_a.none() = nb::none(), "segment_planes"_a.none() = nb::none(),
             "proposals"_a.none() = nb::none());
    nb::class_<Source>(m, "MatchSource", "A photograph that it is matched with, of any size.")
        .def(nb::init<Gray, Srgb, Warps, std::optional<Gray>, std::optional<Depth>>(), nb::kw_only(), "gray"_a, "tint"_a,
             "warps"_a, "open"_a.none() = nb::none(), "depth_m"_a.none() = nb::none());
    nb::class_<DepthSource>(m, "DepthSource", "Another depth map, of any size.")
        .def(nb::init<Depth, Warps, std::optional<Gray>>(), nb::kw_only(), "depth_m"_a, "warps"_a,
             "open"_a.none() = nb::none());
    nb::class_<PlaneSource>(m, "PlaneSource", "The planes of a photograph, of any size.")
        .def(nb::init<Planes, Depth, Warps, Matrix, Turn>(), nb::kw_only(), "planes"_a, "cost"_a, "warps"_a,
             "pixel_from_ray"_a, "turn"_a);
}

}  // namespace

void bind_patch_match(nb::module_& m) {
    bind_match_settings(m);
    bind_inputs(m);
    bind_settings(m, "AgreementSettings", "When two depths agree.",
                  field("agree_px", &AgreementSettings::agree_px, "Between a pixel and where it comes back to."),
                  field("agree_share", &AgreementSettings::agree_share, "Between the two depths, of the depth."));
    bind_settings(
        m, "FringeSettings", "When a pixel's colour is that of what lies behind.",
        field("fringe_px", &FringeSettings::fringe_px, "Radius of the square in which colours are compared."),
        field("gap", &FringeSettings::gap, "Share of the depth by which other surfaces lie farther."),
        field("fringe_contrast", &FringeSettings::fringe_contrast, "Of 765: between mean colours that differ enough."),
        field("fringe_nearer", &FringeSettings::fringe_nearer,
              "Share of the distance to the own surface's mean colour, within which a colour is the background's."));
    bind_result(m, "MatchedPlanes", "The plane of each pixel.",
                field("planes", &MatchedPlanes::planes, "(H, W, 3): inverse depth, its change a pixel to the right and down."),
                field("cost", &MatchedPlanes::cost, "(H, W)."));
    bind_result(m, "AgreementCounts", "Other depth maps, by what they show where a pixel's depth is.",
                field("agreeing", &AgreementCounts::agreeing, "(H, W), those whose depth agrees."),
                field("through", &AgreementCounts::through, "(H, W), those that see something behind, or nothing."));
    m.def("match_planes", &match, "reference"_a, "sources"_a, "start"_a, nb::kw_only(), "offsets"_a, "settings"_a, "threads"_a,
          "Planes of a photograph by PatchMatch stereo, from those to start with (H, W, 3).");
    m.def("count_agreeing", &agreeing, "depth_m"_a, "sources"_a, nb::kw_only(), "settings"_a, "threads"_a,
          "How many other depth maps agree with each pixel's depth (H, W), and how many see through it.");
    m.def("show_planes", &show, "sources"_a, nb::kw_only(), "pixel_from_ray"_a, "width"_a, "height"_a, "max_cost"_a,
          "Planes of photographs as another one sees them, the best of those that meet.");
    m.def("find_fringe", &fringe, "depth_m"_a, "srgb"_a, nb::kw_only(), "settings"_a, "threads"_a,
          "(H, W): 1 for pixels with the depth of what is in front of them, else 0.");
}
