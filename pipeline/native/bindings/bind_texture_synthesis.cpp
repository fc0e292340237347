#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/optional.h>

#include <optional>

#include "bindings/bindings.h"
#include "bindings/structs.h"
#include "crown/texture_synthesis.h"

namespace nb = nanobind;
using namespace nb::literals;

namespace {

template <typename T, typename Shape>
using Array = nb::ndarray<T, Shape, nb::c_contig, nb::device::cpu>;
using Colors = Array<const std::int16_t, nb::shape<-1, -1, 4>>;
using Mask = Array<const std::uint8_t, nb::shape<-1, -1>>;
using SourceOut = Array<std::int32_t, nb::shape<-1, -1, 2>>;
using ColorsOut = Array<std::int16_t, nb::shape<-1, -1, 4>>;
using usdfoliage::PlaceSettings;
using usdfoliage::RefineSettings;

struct Exemplar {
    Colors color;
    Mask valid;
    std::optional<Colors> guide;

    usdfoliage::Exemplar read() const {
        return {color.data(), guide ? guide->data() : nullptr, valid.data(), static_cast<std::int32_t>(valid.shape(0)),
                static_cast<std::int32_t>(valid.shape(1))};
    }
};

struct Synthesis {
    SourceOut source;
    ColorsOut color;
    Mask known;
    std::optional<Colors> guide;

    usdfoliage::Synthesis read() const {
        return {source.data(), color.data(), guide ? guide->data() : nullptr, known.data(),
                static_cast<std::int32_t>(known.shape(0)), static_cast<std::int32_t>(known.shape(1))};
    }
};

std::int32_t place(const Exemplar& exemplar, const Synthesis& synthesis, const PlaceSettings& settings, int threads) {
    nb::gil_scoped_release unlocked;
    return usdfoliage::place_patches(exemplar.read(), synthesis.read(), settings, threads);
}

void refine(const Exemplar& exemplar, const Synthesis& synthesis, const RefineSettings& settings, int threads) {
    nb::gil_scoped_release unlocked;
    usdfoliage::refine_sources(exemplar.read(), synthesis.read(), settings, threads);
}

}  // namespace

void bind_texture_synthesis(nb::module_& m) {
    bind_settings(m, "PlaceSettings", "Which patches are laid.",
                  field("patch_px", &PlaceSettings::patch_px, "Side of a patch."),
                  field("overlap_px", &PlaceSettings::overlap_px, "With its neighbours."),
                  field("usage_weight", &PlaceSettings::usage_weight, "How much dearer a place gets by every use."),
                  field("near_weight", &PlaceSettings::near_weight, "And by every use within two patches."),
                  field("candidate_share", &PlaceSettings::candidate_share, "Of all places, how many are tried for a patch."),
                  field("max_places", &PlaceSettings::max_places, "So many are tried on a grid at most, then those around the best."),
                  field("cuts", &PlaceSettings::cuts, "Of the places that match best, how many are compared by their seam."),
                  field("seed", &PlaceSettings::seed, "Of the choice."));
    bind_settings(m, "RefineSettings", "How neighbourhoods are compared.",
                  field("radius", &RefineSettings::radius, "Of the neighbourhoods, in pixels."),
                  field("guide_weight", &RefineSettings::guide_weight, "Of the guide's colour, in pixels."),
                  field("random_tries", &RefineSettings::random_tries, "Random places a pixel."),
                  field("seed", &RefineSettings::seed, "Of the random places."));
    nb::class_<Exemplar>(m, "Exemplar", "What may be copied.")
        .def(nb::init<Colors, Mask, std::optional<Colors>>(), nb::kw_only(), "color"_a, "valid"_a, "guide"_a.none() = nb::none());
    // Written in place: a converted copy would be lost.
    nb::class_<Synthesis>(m, "Synthesis", "What is made of it, changed in place.")
        .def(nb::init<SourceOut, ColorsOut, Mask, std::optional<Colors>>(), nb::kw_only(), "source"_a.noconvert(),
             "color"_a.noconvert(), "known"_a, "guide"_a.none() = nb::none());
    m.def("place_patches", &place, "exemplar"_a, "synthesis"_a, nb::kw_only(), "settings"_a, "threads"_a,
          "Fill what is free with patches of the exemplar; their number.");
    m.def("refine_sources", &refine, "exemplar"_a, "synthesis"_a, nb::kw_only(), "settings"_a, "threads"_a,
          "One pass towards neighbourhoods of the exemplar; both need a guide.");
}
