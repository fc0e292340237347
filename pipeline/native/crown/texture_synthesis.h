// Example-based texture synthesis on coordinate maps: every output pixel carries the place in the exemplar it copies.

#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

namespace usdfoliage {

// Colours are integers so that sums are exact in any order: four per pixel, the last one 0, each 0..1023.
constexpr int kTextureChannels = 4;

// What may be copied.
struct Exemplar {
    const std::int16_t* color;  // rows * columns * 4, finite everywhere
    const std::int16_t* guide;  // the same, as the next coarser level shows it
    const std::uint8_t* valid;  // rows * columns, 1 where a pixel may be copied
    std::int32_t rows, columns;
};

// What is made of it, changed in place.
struct Synthesis {
    std::int32_t* source;      // rows * columns * 2, row and column in the exemplar; −1 where nothing is yet
    std::int16_t* color;       // rows * columns * 4
    const std::int16_t* guide;  // rows * columns * 4, the coarser level's result
    const std::uint8_t* known;  // rows * columns: 0 free; 1 colour given, source searched; 2 colour given, left alone
    std::int32_t rows, columns;
};

struct PlaceSettings {
    std::int32_t patch_px;         // side of a patch
    std::int32_t overlap_px;       // with its neighbours
    float usage_weight;            // how much dearer a place gets by every use
    float near_weight;             // and by every use within two patches
    float candidate_share;         // of all places, how many are looked at for a patch, 0..1
    std::int32_t max_places;       // looked at on a grid of the exemplar, and then all around the best of them
    std::int32_t cuts;             // of the places that match best, how many are tried by their cut
    std::uint32_t seed;
};

// Fill what is free and has no source with patches of the exemplar, growing from what is there, along minimum-cut seams.
// Where nothing is there the first patch lies anywhere.
//
// @param threads  at most so many, 0: one per core
// @return  the number of patches; 0 and nothing placed where no patch fits into the valid part of the exemplar
//
// Source: V. Kwatra et al., Graphcut Textures, SIGGRAPH 2003, sections 2 and 4 (sub-patch matching). That places are
// chosen by how little they were used is our own.
std::int32_t place_patches(const Exemplar& exemplar, const Synthesis& synthesis, const PlaceSettings& settings,
                           int threads);

struct RefineSettings {
    std::int32_t radius;        // of the neighbourhood that is compared
    std::int32_t guide_weight;  // of the 3×3 neighbourhood of the guide
    std::int32_t random_tries;  // places looked at in the whole exemplar and, half as far each time, around the best
    std::uint32_t seed;
};

// Give every pixel the source whose neighbourhood looks most like its own, among those that continue its neighbours'
// and a few random ones. Four sub-passes, each over one pixel of every 2×2 block, read what the ones before left, so
// the result does not depend on the number of threads. Pixels inside a verbatim copy are left alone.
//
// Source: S. Lefebvre and H. Hoppe, Parallel Controllable Texture Synthesis, SIGGRAPH 2005, sections 3.1 to 3.3; X. Tong
// et al., Synthesis of Bidirectional Texture Functions, 2002 (coherent candidates); C. Barnes et al., PatchMatch, 2009
// (random search).
void refine_sources(const Exemplar& exemplar, const Synthesis& synthesis, const RefineSettings& settings, int threads);

}  // namespace usdfoliage
