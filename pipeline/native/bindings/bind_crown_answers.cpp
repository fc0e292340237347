#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/vector.h>

#include <tuple>

#include "bindings/arrays.h"
#include "bindings/bindings.h"
#include "forest/crown_answers.h"

namespace nb = nanobind;
using namespace nb::literals;

namespace {

template <typename T, typename Shape>
using Input = nb::ndarray<const T, Shape, nb::c_contig, nb::device::cpu>;
using Channels = Input<float, nb::shape<-1, -1, -1>>;
using Places = Input<std::int32_t, nb::shape<-1>>;
using Offsets = Input<std::int32_t, nb::shape<usdfoliage::kCrownRings, usdfoliage::kCrownAngles>>;
using Vector = Input<float, nb::shape<-1>>;
using Layer = std::tuple<Input<float, nb::shape<-1, -1>>, Vector>;

usdfoliage::CrownPlaces asked_places(const Channels& channels, const Places& places, const Offsets& offsets) {
    return {channels.data(), channels.shape(0), channels.shape(1) * channels.shape(2),
            places.data(),   places.shape(0),   offsets.data()};
}

nb::ndarray<nb::numpy, float> facts(const Channels& channels, const Places& places, const Offsets& offsets, int threads) {
    const usdfoliage::CrownPlaces asked = asked_places(channels, places, offsets);
    std::vector<float> found;
    {
        nb::gil_scoped_release unlocked;
        found = usdfoliage::crown_facts(asked, threads);
    }
    return to_numpy(std::move(found), {asked.n, usdfoliage::crown_fact_count(asked.count)});
}

nb::ndarray<nb::numpy, float> answers(const Channels& channels, const Places& places, const Offsets& offsets,
                                      const Vector& middle, const Vector& spread, const std::vector<Layer>& layers,
                                      int threads) {
    const usdfoliage::CrownPlaces asked = asked_places(channels, places, offsets);
    usdfoliage::CrownNetwork network{middle.data(), spread.data(), {}};
    for (const auto& [matrix, offset] : layers)
        network.layers.push_back({matrix.data(), offset.data(), matrix.shape(0), matrix.shape(1)});
    std::vector<float> found;
    {
        nb::gil_scoped_release unlocked;
        found = usdfoliage::crown_answers(asked, network, threads);
    }
    return to_numpy(std::move(found), {asked.n});
}

}  // namespace

void bind_crown_answers(nb::module_& m) {
    m.def("crown_facts", &facts, "channels"_a, "places"_a, "offsets"_a, nb::kw_only(), "threads"_a,
          "What is known (N, K) of places (N,), pixels of a channel of (C, H, W), C 4 or 1; offsets (7, 12) lead from a "
          "place to the rings around it, inside the picture. Arguments are trusted.");
    m.def("crown_answers", &answers, "channels"_a, "places"_a, "offsets"_a, nb::kw_only(), "middle"_a, "spread"_a,
          "layers"_a, "threads"_a,
          "A network's answers (N,) to the facts of places, 0 to 1: middle and spread (K,) of facts, matrix and offset of "
          "each layer, up to 128 wide. Arguments are trusted.");
}
