#include "forest/crown_answers.h"

#include <algorithm>
#include <cmath>

#include "parallel.h"
#include "vector_clones.h"

namespace usdfoliage {
namespace {

constexpr std::size_t kLanes = 8;  // places that are asked together
constexpr std::size_t kPairs = kCrownAngles / 2 - 1;
constexpr std::size_t kSides = kPairs + 2;  // of a ring: to the light, the pairs, away from it
constexpr std::size_t kOutside = 4;         // the first ring that is outside a crown
constexpr std::size_t kMaxNumbers = 128;   // facts, or outputs of a layer
constexpr std::size_t kTogether = 4;        // outputs of a layer that are summed together
constexpr std::size_t kBlock = 64;          // groups of places in a task
constexpr float kNoLight = 0.05f, kNoHeightM = 0.3f;  // spread, below which all is noise
constexpr float kNoColor = 0.02f;                        // distance of two colours, likewise
constexpr float kWidestSpreads = 4;                           // that a fact may be off its middle

typedef float Lanes __attribute__((vector_size(32)));
typedef float Unaligned __attribute__((vector_size(32), aligned(4), may_alias));

static_assert(sizeof(Lanes) == kLanes * sizeof(float));

// A group of places, all of one channel.
struct Group {
    const float* channel;
    const std::int32_t* places;  // kLanes
    bool every_second;           // places are every second pixel of a row
};

inline void fill(float value, Lanes& to) { to = Lanes{} + value; }

inline void read(const Group& group, std::int32_t offset, Lanes& to) {
    if (group.every_second) {
        const float* from = group.channel + group.places[0] + offset;
        const Lanes low = *reinterpret_cast<const Unaligned*>(from);
        const Lanes high = *reinterpret_cast<const Unaligned*>(from + kLanes - 1);
        to = __builtin_shufflevector(low, high, 0, 2, 4, 6, 9, 11, 13, 15);
        return;
    }
    for (std::size_t lane = 0; lane < kLanes; ++lane) to[lane] = group.channel[group.places[lane] + offset];
}

inline void magnitude(Lanes& value) {
    const Lanes zero = {};
    value = value < zero ? -value : value;
}

inline void raise_to(float lowest, Lanes& value) {
    const Lanes low = Lanes{} + lowest;
    value = value < low ? low : value;
}

inline void square_root(Lanes& value) {
    for (std::size_t lane = 0; lane < kLanes; ++lane) value[lane] = std::sqrt(value[lane]);
}

inline void logarithm(Lanes& value) {
    for (std::size_t lane = 0; lane < kLanes; ++lane) value[lane] = std::log(value[lane]);
}

// The sides and the mean of every ring.
struct Rings {
    Lanes side[kCrownRings][kSides], mean[kCrownRings];
};

// @param uneven  kCrownRings means of how the two of a pair differ; nullptr: not asked
inline void read_rings(const Group& group, const std::int32_t* offsets, Rings& rings, Lanes* uneven) {
    constexpr float share = 1.0f / kCrownAngles;
    for (std::size_t ring = 0; ring < kCrownRings; ++ring) {
        const std::int32_t* turn = offsets + ring * kCrownAngles;
        Lanes(&side)[kSides] = rings.side[ring];
        read(group, turn[0], side[0]);
        read(group, turn[kCrownAngles / 2], side[kSides - 1]);
        Lanes total = side[0] + side[kSides - 1], differ = {};
        for (std::size_t pair = 1; pair <= kPairs; ++pair) {
            Lanes left, right;
            read(group, turn[pair], left);
            read(group, turn[kCrownAngles - pair], right);
            side[pair] = left + right;
            total += side[pair];
            side[pair] *= 0.5f;
            left -= right;
            magnitude(left);
            differ += left;
        }
        rings.mean[ring] = total * share;
        if (uneven != nullptr) uneven[ring] = differ * share;
    }
}

// Of a channel the middle of the crown that might stand at a place, and what is around it.
inline void part(const Lanes& middle, const Rings& rings, Lanes& inside, Lanes& outside) {
    inside = (middle + 2.0f * rings.mean[0] + 3.0f * rings.mean[1]) * (1.0f / 6);
    outside = (rings.mean[kOutside] + rings.mean[kOutside + 1] + rings.mean[kOutside + 2]) * (1.0f / 3);
}

static_assert(kOutside + 3 == kCrownRings);

// @param facts  crown_fact_count numbers of each lane, written
void find_facts(const CrownPlaces& asked, const std::int32_t* places, Lanes* facts) {
    Group group{asked.channels, places, true};
    for (std::size_t lane = 1; lane < kLanes; ++lane) group.every_second &= places[lane] == places[lane - 1] + 2;
    const bool canopy = asked.count == 1;
    Rings light;
    Lanes uneven[kCrownRings], middle, inside, outside;
    read(group, 0, middle);
    read_rings(group, asked.offsets, light, uneven);
    part(middle, light, inside, outside);
    Lanes spread = {};
    for (std::size_t ring = 0; ring < kCrownRings; ++ring)
        for (const Lanes& side : light.side[ring]) spread += (side - inside) * (side - inside);
    spread *= 1.0f / (kCrownRings * kSides);
    square_root(spread);
    spread += canopy ? kNoHeightM : kNoLight;
    const Lanes scale = 1.0f / spread;
    *facts++ = (middle - inside) * scale;
    logarithm(spread);
    *facts++ = spread;
    for (std::size_t ring = 0; ring < kCrownRings; ++ring) {
        *facts++ = uneven[ring] * scale;
        for (const Lanes& side : light.side[ring]) *facts++ = (side - inside) * scale;
    }
    if (canopy) {
        raise_to(0, inside);
        inside += 1.0f;
        facts[1] = outside / inside;
        logarithm(inside);
        facts[0] = inside;
        return;
    }
    Rings red, blue, rough;
    Lanes middles[3], insides[3], outsides[3];
    Rings* const rings[3] = {&red, &blue, &rough};
    for (std::size_t channel = 0; channel < 3; ++channel) {
        group.channel += asked.size;
        read(group, 0, middles[channel]);
        read_rings(group, asked.offsets, *rings[channel], nullptr);
        part(middles[channel], *rings[channel], insides[channel], outsides[channel]);
    }
    Lanes across = insides[0] - outsides[0], along = insides[1] - outsides[1];
    Lanes distance = across * across + along * along;
    square_root(distance);
    Lanes length = distance;
    raise_to(kNoColor, length);
    across /= length;
    along /= length;
    const Lanes level = across * outsides[0] + along * outsides[1];
    distance += kNoColor;
    logarithm(distance);
    *facts++ = across * middles[0] + along * middles[1] - level;
    *facts++ = distance;
    *facts++ = middles[2] - outsides[2];
    for (std::size_t ring = 0; ring < kCrownRings; ++ring) {
        *facts++ = rough.mean[ring] - outsides[2];
        for (std::size_t side = 0; side < kSides; ++side)
            *facts++ = across * red.side[ring][side] + along * blue.side[ring][side] - level;
    }
}

// One layer for a group of places.
inline void pass(const CrownLayer& layer, const Lanes* inputs, bool last, Lanes* outputs) {
    const std::size_t width = layer.outputs;
    std::size_t first = 0;
    for (; first + kTogether <= width; first += kTogether) {
        Lanes sum[kTogether];
        for (std::size_t k = 0; k < kTogether; ++k) fill(layer.offset[first + k], sum[k]);
        const float* weight = layer.matrix + first;
        for (std::size_t i = 0; i < layer.inputs; ++i, weight += width)
            for (std::size_t k = 0; k < kTogether; ++k) sum[k] += weight[k] * inputs[i];
        for (std::size_t k = 0; k < kTogether; ++k) outputs[first + k] = sum[k];
    }
    for (; first < width; ++first) {
        Lanes sum;
        fill(layer.offset[first], sum);
        for (std::size_t i = 0; i < layer.inputs; ++i) sum += layer.matrix[i * width + first] * inputs[i];
        outputs[first] = sum;
    }
    if (last) return;
    for (std::size_t k = 0; k < width; ++k) raise_to(0, outputs[k]);
}

// The places of a group; beyond the last one it is asked again.
inline void take_places(const CrownPlaces& asked, std::size_t first, std::int32_t* places) {
    for (std::size_t lane = 0; lane < kLanes; ++lane) places[lane] = asked.places[std::min(first + lane, asked.n - 1)];
}

USDFOLIAGE_VECTOR_CLONES
void facts_of_group(const CrownPlaces& asked, std::size_t first, float* found) {
    std::int32_t places[kLanes];
    Lanes facts[kMaxNumbers];
    take_places(asked, first, places);
    find_facts(asked, places, facts);
    const std::size_t count = crown_fact_count(asked.count);
    for (std::size_t lane = 0; lane < std::min(kLanes, asked.n - first); ++lane)
        for (std::size_t k = 0; k < count; ++k) found[(first + lane) * count + k] = facts[k][lane];
}

USDFOLIAGE_VECTOR_CLONES
void answers_of_group(const CrownPlaces& asked, const CrownNetwork& network, std::size_t first, float* found) {
    std::int32_t places[kLanes];
    Lanes one[kMaxNumbers], other[kMaxNumbers], high;
    take_places(asked, first, places);
    find_facts(asked, places, one);
    fill(kWidestSpreads, high);
    const std::size_t count = crown_fact_count(asked.count);
    for (std::size_t k = 0; k < count; ++k) {
        Lanes fact = (one[k] - network.middle[k]) / network.spread[k];
        raise_to(-kWidestSpreads, fact);
        one[k] = fact < high ? fact : high;
    }
    Lanes *from = one, *to = other;
    for (std::size_t number = 0; number < network.layers.size(); ++number) {
        pass(network.layers[number], from, number + 1 == network.layers.size(), to);
        std::swap(from, to);
    }
    for (std::size_t lane = 0; lane < std::min(kLanes, asked.n - first); ++lane)
        found[first + lane] = 1 / (1 + std::exp(-from[0][lane]));
}

template <typename Fn>
void each_group(std::size_t n, int threads, const Fn& fn) {
    parallel_blocks((n + kLanes - 1) / kLanes, kBlock, threads, [&](std::size_t group) { fn(group * kLanes); });
}

}  // namespace

std::size_t crown_fact_count(std::size_t channels) {
    const std::size_t light = 2 + kCrownRings * (kSides + 1);
    return channels == 1 ? light + 2 : light + 3 + kCrownRings * (kSides + 1);
}

std::vector<float> crown_facts(const CrownPlaces& asked, int threads) {
    std::vector<float> found(asked.n * crown_fact_count(asked.count));
    each_group(asked.n, threads, [&](std::size_t first) { facts_of_group(asked, first, found.data()); });
    return found;
}

std::vector<float> crown_answers(const CrownPlaces& asked, const CrownNetwork& network, int threads) {
    std::vector<float> found(asked.n);
    each_group(asked.n, threads, [&](std::size_t first) { answers_of_group(asked, network, first, found.data()); });
    return found;
}

}  // namespace usdfoliage
