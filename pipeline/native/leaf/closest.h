// The closest places of a leaf's surface to points, many points at once.
//
// Points of the interior may be closest to any place of the surface, those of the edge to places of the silhouette. All is
// in leaf space, one array a quantity, so that loops over points become vector instructions.

#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "leaf/curves.h"

namespace usdfoliage {

// Points of one leaf and what is closest to them.
//
// What of the offset from its place to a point counts is, for a place inside, the part along the normal; on the silhouette,
// the parts along the normal and outwards; at base and apex, where neither may exist, all of it.
//
// The points of the interior come first, then those of the edge, either with as many more as fill up a vector; those lie at
// the origin and are for the caller to leave out.
class ClosestPlaces {
   public:
    ClosestPlaces(std::size_t inside, std::size_t edge)
        : inside_(filled_up(inside)), size_(inside_ + filled_up(edge)), numbers_(kArrays * size_) {}

    // Where the points of the edge begin, and how many there are of both.
    std::size_t inside() const { return inside_; }
    std::size_t size() const { return size_; }

    double* point(std::size_t c) { return array(c); }  // to be written by the caller
    const double* point(std::size_t c) const { return array(c); }
    const double* u() const { return array(3); }
    const double* v() const { return array(4); }
    const double* place(std::size_t c) const { return array(5 + c); }
    const double* offset(std::size_t c) const { return array(8 + c); }    // from the place to the point
    const double* normal(std::size_t c) const { return array(11 + c); }   // unit, but at base and apex
    const double* outward(std::size_t c) const { return array(14 + c); }  // likewise
    const double* parts() const { return array(17); }                     // of the offset that count: 1, 2 or 3
    const double* square() const { return array(18); }                    // of what counts

    // Begin at the closest of some places spread over the surface.
    void search(const LeafCurves& curves);
    // Begin at other places of the same points.
    void begin_at(const ClosestPlaces& other);
    // Go towards the closest places in so many steps, then look at the offsets.
    void approach(const LeafCurves& curves, int steps);

   private:
    static constexpr std::size_t kArrays = 19;
    static std::size_t filled_up(std::size_t n) { return (n + 3) / 4 * 4; }
    double* array(std::size_t k) { return numbers_.data() + size_ * k; }
    const double* array(std::size_t k) const { return numbers_.data() + size_ * k; }

    std::size_t inside_, size_;
    std::vector<double> numbers_;
};

// The closest places of leaves to their points.
//
// Fit i has the points offsets[i] to offsets[i + 1].
//
// @param points     3 a point
// @param edge       whether the leaf ends at a point, so that its place is on the silhouette
// @param axes       9 a leaf: matrix with the leaf's x, y and z in the columns
// @param uv         2 a point, written
// @param distances  1 a point, written
void project_to_leaves(const double* points, const std::uint8_t* edge, const std::int64_t* offsets, const double* parameters,
                       const double* axes, const double* bases, const double* lengths, std::size_t n, double* uv,
                       double* distances, int threads);

}  // namespace usdfoliage
