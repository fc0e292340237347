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
#include "mvs/depth_fringe.h"
#include "mvs/patch_match.h"
#include "mvs/view_agreement.h"

namespace nb = nanobind;
using namespace nb::literals;

namespace {

using Srgb = nb::ndarray<const std::uint8_t, nb::shape<-1, -1, 3>, nb::c_contig, nb::device::cpu>;
using Gray = nb::ndarray<const std::uint8_t, nb::shape<-1, -1>, nb::c_contig, nb::device::cpu>;
using Depth = nb::ndarray<const float, nb::shape<-1, -1>, nb::c_contig, nb::device::cpu>;
using Warps = nb::ndarray<const double, nb::shape<-1, 2, 3, 4>, nb::c_contig, nb::device::cpu>;
using Planes = nb::ndarray<const float, nb::shape<-1, -1, 3>, nb::c_contig, nb::device::cpu>;
using Layers = nb::ndarray<const float, nb::shape<-1, -1, -1, 3>, nb::c_contig, nb::device::cpu>;
using Turn = nb::ndarray<const double, nb::shape<3, 4>, nb::c_contig, nb::device::cpu>;
using Offsets = nb::ndarray<const int, nb::shape<-1, 2>, nb::c_contig, nb::device::cpu>;
using Matrix = nb::ndarray<const double, nb::shape<3, 3>, nb::c_contig, nb::device::cpu>;

// The last column of a warp is its epipole, the others its homography.
void split_warp(const double* warp, double* homography, double* epipole) {
    for (int i = 0; i < 3; ++i) {
        for (int j = 0; j < 3; ++j) homography[3 * i + j] = warp[4 * i + j];
        epipole[i] = warp[4 * i + 3];
    }
}

usdfoliage::MatchSource source_of(const double* warps) {
    usdfoliage::MatchSource source{};
    split_warp(warps, source.homography, source.epipole);
    split_warp(warps + 12, source.back_homography, source.back_epipole);
    return source;
}

nb::tuple match(const Srgb& srgb, const Srgb& tint, const std::optional<Gray>& mask, const Matrix& pixel_from_ray,
                const std::vector<Gray>& grays, const std::vector<Srgb>& tints, const std::optional<Planes>& segment_planes,
                const std::optional<Layers>& proposals, const std::vector<Gray>& opens, const std::vector<Depth>& depths,
                const Warps& warps, const Offsets& offsets, const Planes& start, int iterations, int best_sources,
                float nearest_inverse, float farthest_inverse, float color_scale, float distance_scale_px, float noise,
                float brightness_weight, float brightness_scale, float tint_weight, float tint_scale, float geometric_weight,
                float geometric_limit_px, float open_weight, float segment_weight, float segment_limit_px,
                float segment_texture, float step,
                float most_slant, std::uint64_t seed, int threads) {
    usdfoliage::MatchReference reference{srgb.data(),
                                         tint.data(),
                                         mask ? mask->data() : nullptr,
                                         segment_planes ? segment_planes->data() : nullptr,
                                         proposals ? proposals->data() : nullptr,
                                         proposals ? static_cast<int>(proposals->shape(0)) : 0,
                                         static_cast<int>(srgb.shape(1)),
                                         static_cast<int>(srgb.shape(0)),
                                         {}};
    std::copy_n(pixel_from_ray.data(), 9, reference.pixel_from_ray);
    std::vector<usdfoliage::MatchSource> sources;
    for (std::size_t k = 0; k < grays.size(); ++k) {
        usdfoliage::MatchSource source = source_of(warps.data() + 24 * k);
        source.gray = grays[k].data();
        source.tint = tints[k].data();
        source.open = opens.empty() ? nullptr : opens[k].data();
        source.depth_m = depths.empty() ? nullptr : depths[k].data();
        source.height = static_cast<int>(grays[k].shape(0));
        source.width = static_cast<int>(grays[k].shape(1));
        sources.push_back(source);
    }
    std::vector<float> planes(start.data(), start.data() + start.size());
    std::vector<float> cost(srgb.shape(0) * srgb.shape(1));
    {
        nb::gil_scoped_release unlocked;
        usdfoliage::match_planes(reference, sources, offsets.data(), offsets.shape(0),
                                 {iterations, best_sources, nearest_inverse, farthest_inverse, color_scale, distance_scale_px, noise,
                                  brightness_weight, brightness_scale, tint_weight, tint_scale, geometric_weight,
                                  geometric_limit_px, open_weight, segment_weight, segment_limit_px, segment_texture,
                                  step, most_slant, seed,
                                  threads},
                                 planes.data(), cost.data());
    }
    return nb::make_tuple(to_numpy(std::move(planes), {srgb.shape(0), srgb.shape(1), 3}),
                          to_numpy(std::move(cost), {srgb.shape(0), srgb.shape(1)}));
}

nb::ndarray<nb::numpy, std::uint8_t> agreeing(const Depth& depth_m, const std::vector<Depth>& depths, const std::vector<Gray>& opens,
                                              const Warps& warps, float most_px, float most_share, int threads) {
    std::vector<usdfoliage::MatchSource> sources;
    for (std::size_t k = 0; k < depths.size(); ++k) {
        usdfoliage::MatchSource source = source_of(warps.data() + 24 * k);
        source.depth_m = depths[k].data();
        source.open = opens.empty() ? nullptr : opens[k].data();
        source.height = static_cast<int>(depths[k].shape(0));
        source.width = static_cast<int>(depths[k].shape(1));
        sources.push_back(source);
    }
    std::vector<std::uint8_t> counts(2 * depth_m.size());
    {
        nb::gil_scoped_release unlocked;
        usdfoliage::count_agreeing(depth_m.data(), static_cast<int>(depth_m.shape(1)), static_cast<int>(depth_m.shape(0)), sources,
                                   {most_px, most_share, threads}, counts.data());
    }
    return to_numpy(std::move(counts), {depth_m.shape(0), depth_m.shape(1), 2});
}

nb::tuple show(const std::vector<Planes>& planes, const std::vector<Depth>& costs, const Warps& warps,
               const std::vector<Matrix>& pixel_from_ray, const Matrix& other_pixel_from_ray, const std::vector<Turn>& turns,
               int width, int height, float most_cost) {
    const std::size_t pixels = static_cast<std::size_t>(width) * static_cast<std::size_t>(height);
    std::vector<float> seen(3 * pixels);
    std::vector<float> seen_cost(pixels, most_cost);
    {
        nb::gil_scoped_release unlocked;
        for (std::size_t k = 0; k < planes.size(); ++k) {
            usdfoliage::MatchSource to = source_of(warps.data() + 24 * k);
            to.width = width;
            to.height = height;
            usdfoliage::show_planes(planes[k].data(), costs[k].data(), static_cast<int>(planes[k].shape(1)),
                                    static_cast<int>(planes[k].shape(0)), most_cost, to, pixel_from_ray[k].data(),
                                    other_pixel_from_ray.data(), turns[k].data(), seen.data(), seen_cost.data());
        }
    }
    return nb::make_tuple(to_numpy(std::move(seen), {static_cast<std::size_t>(height), static_cast<std::size_t>(width), 3}),
                          to_numpy(std::move(seen_cost), {static_cast<std::size_t>(height), static_cast<std::size_t>(width)}));
}

auto fringe(const Depth& depth_m, const Srgb& srgb, int radius_px, float gap, float least_contrast, float nearer, int threads) {
    std::vector<std::uint8_t> found(depth_m.size());
    {
        nb::gil_scoped_release unlocked;
        usdfoliage::find_fringe(depth_m.data(), srgb.data(), static_cast<int>(depth_m.shape(1)),
                                static_cast<int>(depth_m.shape(0)), {radius_px, gap, least_contrast, nearer, threads},
                                found.data());
    }
    return to_numpy(std::move(found), {depth_m.shape(0), depth_m.shape(1)});
}

}  // namespace

void bind_patch_match(nb::module_& m) {
    m.def("match_planes", &match, "srgb"_a, "tint"_a, "mask"_a.none(), "pixel_from_ray"_a, "grays"_a, "tints"_a,
          "segment_planes"_a.none(), "proposals"_a.none(), "opens"_a, "depths"_a, "warps"_a, "offsets"_a, "start"_a, "iterations"_a, "best_sources"_a, "nearest_inverse"_a, "farthest_inverse"_a, "color_scale"_a,
          "distance_scale_px"_a, "noise"_a, "brightness_weight"_a, "brightness_scale"_a, "tint_weight"_a,
          "tint_scale"_a, "geometric_weight"_a, "geometric_limit_px"_a, "open_weight"_a, "segment_weight"_a,
          "segment_limit_px"_a, "segment_texture"_a, "step"_a, "most_slant"_a, "seed"_a, "threads"_a,
          "Planes (H, W, 3) of a photograph by PatchMatch stereo, and their cost (H, W).");
    m.def("count_agreeing", &agreeing, "depth_m"_a, "depths"_a, "opens"_a, "warps"_a, "most_px"_a, "most_share"_a, "threads"_a,
          "How many other depth maps agree with each pixel's depth, and how many see through it (H, W, 2).");
    m.def("show_planes", &show, "planes"_a, "costs"_a, "warps"_a, "pixel_from_ray"_a, "other_pixel_from_ray"_a, "turns"_a,
          "width"_a, "height"_a, "most_cost"_a, "Planes (H, W, 3) of photographs as another one sees them, and their cost (H, W).");
    m.def("find_fringe", &fringe, "depth_m"_a, "srgb"_a, "radius_px"_a, "gap"_a, "least_contrast"_a, "nearer"_a, "threads"_a,
          "Pixels (H, W) with the depth of what stands before them.");
}
