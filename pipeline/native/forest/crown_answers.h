// What a picture from above shows around places, and what a small network answers to it.

#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

namespace usdfoliage {

constexpr std::size_t kCrownRings = 7;    // around a place
constexpr std::size_t kCrownAngles = 12;  // of a ring, the first towards the sun

// A picture, and places in it.
struct CrownPlaces {
    const float* channels;  // count * size: of an orthophoto light, red, blue and how rough it is; of a canopy metres
    std::size_t count;      // of channels, 4 or 1
    std::size_t size;       // pixels of a channel
    const std::int32_t* places;  // n pixels
    std::size_t n;
    const std::int32_t* offsets;  // kCrownRings * kCrownAngles, from a place to those around it
};

// Numbers in and out of a layer; all but the last layer cut off what is below 0.
struct CrownLayer {
    const float* matrix;  // inputs * outputs
    const float* offset;  // outputs
    std::size_t inputs, outputs;
};

// How facts are answered.
struct CrownNetwork {
    const float* middle;  // of each fact
    const float* spread;  // likewise, above 0
    std::vector<CrownLayer> layers;
};

// How many facts are known of a place.
//
// @param channels  4 or 1
std::size_t crown_fact_count(std::size_t channels);

// Facts of places: light and colour on rings, against what is around. What lies to both sides of the light is the same,
// and is taken together. Colour is how far along the way from the outside to the inside a place is.
//
// @param threads  at most this many; the result does not depend on it
// @return         n * crown_fact_count numbers
std::vector<float> crown_facts(const CrownPlaces& asked, int threads);

// The network's answers to the facts of places.
//
// @param network  the first layer takes crown_fact_count numbers, the last one gives one
// @param threads  at most this many; the result does not depend on it
// @return         n numbers from 0 to 1
std::vector<float> crown_answers(const CrownPlaces& asked, const CrownNetwork& network, int threads);

}  // namespace usdfoliage
