#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>

#include "bindings/bindings.h"
#include "crown/texture_synthesis.h"

namespace nb = nanobind;
using namespace nb::literals;

namespace {

template <typename T, typename Shape>
using Input = nb::ndarray<const T, Shape, nb::c_contig, nb::device::cpu>;
template <typename T, typename Shape>
using InPlace = nb::ndarray<T, Shape, nb::c_contig, nb::device::cpu>;

using Colors = Input<std::int16_t, nb::shape<-1, -1, 4>>;
using Mask = Input<std::uint8_t, nb::shape<-1, -1>>;

usdfoliage::Exemplar exemplar_of(const Colors& color, const Colors& guide, const Mask& valid) {
    return {color.data(), guide.data(), valid.data(), static_cast<std::int32_t>(valid.shape(0)),
            static_cast<std::int32_t>(valid.shape(1))};
}

usdfoliage::Synthesis synthesis_of(const InPlace<std::int32_t, nb::shape<-1, -1, 2>>& source,
                                   const InPlace<std::int16_t, nb::shape<-1, -1, 4>>& color, const Colors& guide,
                                   const Mask& known) {
    return {source.data(), color.data(), guide.data(), known.data(), static_cast<std::int32_t>(known.shape(0)),
            static_cast<std::int32_t>(known.shape(1))};
}

std::int32_t place(const Colors& exemplar, const Mask& valid, const InPlace<std::int32_t, nb::shape<-1, -1, 2>>& source,
                   const InPlace<std::int16_t, nb::shape<-1, -1, 4>>& color, const Mask& known, std::int32_t patch,
                   std::int32_t overlap, float usage_weight, float near_weight, float candidate_share, std::int32_t cuts, std::uint32_t seed,
                   int threads) {
    const usdfoliage::Exemplar from = exemplar_of(exemplar, exemplar, valid);
    const usdfoliage::Synthesis to{source.data(), color.data(), nullptr, known.data(),
                                   static_cast<std::int32_t>(known.shape(0)), static_cast<std::int32_t>(known.shape(1))};
    nb::gil_scoped_release unlocked;
    return usdfoliage::place_patches(from, to, {patch, overlap, usage_weight, near_weight, candidate_share, cuts, seed, threads});
}

void refine(const Colors& exemplar, const Colors& exemplar_guide, const Mask& valid,
            const InPlace<std::int32_t, nb::shape<-1, -1, 2>>& source, const InPlace<std::int16_t, nb::shape<-1, -1, 4>>& color,
            const Colors& guide, const Mask& known, std::int32_t radius, std::int32_t guide_weight, std::int32_t random_tries,
            std::uint32_t seed, int threads) {
    const usdfoliage::Exemplar from = exemplar_of(exemplar, exemplar_guide, valid);
    const usdfoliage::Synthesis to = synthesis_of(source, color, guide, known);
    nb::gil_scoped_release unlocked;
    usdfoliage::refine_sources(from, to, {radius, guide_weight, random_tries, seed, threads});
}

}  // namespace

void bind_texture_synthesis(nb::module_& m) {
    m.def("place_patches", &place, "exemplar"_a, "valid"_a, "source"_a, "color"_a, "known"_a, "patch"_a, "overlap"_a,
          "usage_weight"_a, "near_weight"_a, "candidate_share"_a, "cuts"_a, "seed"_a, "threads"_a,
          "Fill source (H, W, 2) and color (H, W, 4) in place with patches of the exemplar (h, w, 4); their number.");
    m.def("refine_sources", &refine, "exemplar"_a, "exemplar_guide"_a, "valid"_a, "source"_a, "color"_a, "guide"_a, "known"_a,
          "radius"_a, "guide_weight"_a, "random_tries"_a, "seed"_a, "threads"_a,
          "One pass over source (H, W, 2) and color (H, W, 4), in place, towards neighbourhoods of the exemplar.");
}
