#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/vector.h>

#include <algorithm>
#include <cstdint>
#include <optional>
#include <tuple>
#include <vector>

#include "bindings.h"
#include "patch_match.h"

namespace nb = nanobind;
using namespace nb::literals;

namespace {

using Picture = nb::ndarray<const float, nb::shape<-1, -1>, nb::c_contig, nb::device::cpu>;
using Valid = nb::ndarray<const std::uint8_t, nb::shape<-1, -1>, nb::c_contig, nb::device::cpu>;
using Planes = nb::ndarray<const float, nb::shape<-1, -1, 3>, nb::c_contig, nb::device::cpu>;
using PlanesOut = nb::ndarray<float, nb::shape<-1, -1, 3>, nb::c_contig, nb::device::cpu>;
using CostsOut = nb::ndarray<float, nb::shape<-1, -1>, nb::c_contig, nb::device::cpu>;
using Mapping = nb::ndarray<const double, nb::shape<3, 4>, nb::c_contig, nb::device::cpu>;  // A and, in the last column, b
using Source = std::tuple<Picture, Mapping, Mapping, std::optional<Planes>>;

usdfoliage::GreyPicture to_picture(const Picture& picture) {
    return {picture.data(), static_cast<int>(picture.shape(1)), static_cast<int>(picture.shape(0))};
}

void split(const Mapping& mapping, double* linear, double* offset) {
    for (std::size_t row = 0; row < 3; ++row) {
        std::copy(mapping.data() + 4 * row, mapping.data() + 4 * row + 3, linear + 3 * row);
        offset[row] = mapping.data()[4 * row + 3];
    }
}

void match(const Picture& reference, const std::optional<Valid>& valid, const std::vector<Source>& sources,
           const PlanesOut& planes, const CostsOut& costs, int radius, int step, double color_sigma, double nearest,
           double farthest, double steepest, int best, int iterations, double coherence_weight, double coherence_most,
           double focal, std::uint64_t seed, int threads) {
    std::vector<usdfoliage::SourcePicture> pictures(sources.size());
    for (std::size_t k = 0; k < sources.size(); ++k) {
        const auto& [picture, there, back, its_planes] = sources[k];
        pictures[k].picture = to_picture(picture);
        split(there, pictures[k].linear, pictures[k].offset);
        split(back, pictures[k].back_linear, pictures[k].back_offset);
        pictures[k].planes = its_planes ? its_planes->data() : nullptr;
    }
    nb::gil_scoped_release unlocked;
    usdfoliage::match_patches(to_picture(reference), valid ? valid->data() : nullptr, pictures.data(), pictures.size(),
                              {radius, step, color_sigma, nearest, farthest, steepest, best, iterations, coherence_weight,
                               coherence_most, focal, seed, threads},
                              planes.data(), costs.data());
}

}  // namespace

void bind_patch_match(nb::module_& m) {
    m.def("match_patches", &match, "reference"_a, "valid"_a.none(), "sources"_a, "planes"_a, "costs"_a, "radius"_a, "step"_a,
          "color_sigma"_a, "nearest"_a, "farthest"_a, "steepest"_a, "best"_a, "iterations"_a, "coherence_weight"_a,
          "coherence_most"_a, "focal"_a, "seed"_a, "threads"_a,
          "Improve planes (H, W, 3) of a picture (H, W) in place by what sources show; costs (H, W) are written.");
}
