#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>

#include <cstdint>
#include <utility>
#include <vector>

#include "bindings/arrays.h"
#include "bindings/bindings.h"
#include "branch_cage/fork_crossings.h"
#include "branch_cage/hole_places.h"
#include "branch_cage/limit_pull.h"
#include "branch_cage/tube_bend.h"
#include "branch_cage/tube_exits.h"
#include "branch_cage/tube_frames.h"
#include "branch_cage/tube_places.h"
#include "branch_cage/tube_rings.h"

namespace nb = nanobind;
using namespace nb::literals;

namespace {

template <typename T, typename Shape>
using Input = nb::ndarray<const T, Shape, nb::c_contig, nb::device::cpu>;
using Numbers = Input<double, nb::shape<-1>>;
using Integers = Input<std::int64_t, nb::shape<-1>>;
using Vectors = Input<double, nb::shape<-1, 3>>;
using Quads = Input<std::int64_t, nb::shape<-1, 4>>;

nb::ndarray<nb::numpy, std::int64_t> crossings(const Vectors& points, const Quads& faces, const Integers& fork_faces,
                                               const Integers& fork_first, int threads) {
    std::vector<std::int64_t> pairs;
    {
        nb::gil_scoped_release unlocked;
        pairs = usdfoliage::find_fork_crossings(points.data(), faces.data(), fork_faces.data(), fork_first.data(),
                                                fork_first.shape(0) - 1, threads);
    }
    const std::size_t count = pairs.size() / 2;
    return to_numpy(std::move(pairs), {count, 2});
}

nb::ndarray<nb::numpy, double> pull(const Quads& faces, const Vectors& aims, const Vectors& tangents,
                                    const Input<double, nb::shape<-1, 2>>& swell, const Vectors& center, const Numbers& gain,
                                    int rounds, double farthest, int threads) {
    std::vector<double> points;
    {
        nb::gil_scoped_release unlocked;
        const usdfoliage::LimitAims given{aims.data(),   tangents.data(), swell.data(),
                                          center.data(), gain.data(),     aims.shape(0)};
        points = usdfoliage::pull_limit(faces.data(), faces.shape(0), given, rounds, farthest, threads);
    }
    const std::size_t count = points.size() / 3;
    return to_numpy(std::move(points), {count, 3});
}

nb::tuple place(const Input<double, nb::shape<-1, 9>>& wants, const Integers& want_tube, const Integers& want_first,
                const Numbers& start, const Numbers& end, const Numbers& length, const Numbers& phase,
                const Input<double, nb::shape<-1, 2>>& steep, const Integers& steep_first,
                const Input<std::uint8_t, nb::shape<-1>>& gone, double tightest, double relaxed, double least_column) {
    usdfoliage::HolePlacement found;
    {
        nb::gil_scoped_release unlocked;
        std::vector<usdfoliage::HoleWant> given(wants.shape(0));
        for (std::size_t k = 0; k < given.size(); ++k) {
            const double* value = wants.data() + 9 * k;
            given[k] = {value[0], value[1], value[2], value[3], value[4], value[5], value[6], value[7], value[8]};
        }
        const usdfoliage::HoleTubes tubes{start.data(),       end.data(),        length.data(),    phase.data(), steep.data(),
                                          steep_first.data(), want_first.data(), want_tube.data(), gone.data(),  start.shape(0)};
        found = usdfoliage::place_holes(tubes, std::move(given), tightest, relaxed, least_column);
    }
    const std::size_t blocks = found.block_tube.size(), holes = found.want.size(), turns = found.turn_tube.size(),
                      homeless = found.homeless.size();
    return nb::make_tuple(to_numpy(std::move(found.block_tube), {blocks}), to_numpy(std::move(found.block_arcs), {blocks, 3}),
                          to_numpy(std::move(found.want), {holes}), to_numpy(std::move(found.block), {holes}),
                          to_numpy(std::move(found.sector), {holes}), to_numpy(std::move(found.hole), {holes, 4}),
                          to_numpy(std::move(found.turn_tube), {turns}), to_numpy(std::move(found.turn_arc), {turns}),
                          to_numpy(std::move(found.turn_angles), {turns, 6}), to_numpy(std::move(found.homeless), {homeless}));
}

// The axes of tubes as they come from Python.
struct GivenAxes {
    const Vectors& points;
    const Numbers& radius;
    const Numbers& arc;
    const Vectors& direction;
    const Integers& first;
    const Integers& counts;

    usdfoliage::TubeAxes read() const {
        return {points.data(), radius.data(), arc.data(), direction.data(), first.data(), counts.data()};
    }
};

nb::tuple axis(const Vectors& points, const Numbers& radius, const Numbers& arc, const Vectors& direction,
               const Integers& first, const Integers& counts, const Integers& tube, const Numbers& at, int threads) {
    const std::size_t n = tube.shape(0);
    std::vector<double> found(3 * n), found_radius(n);
    {
        nb::gil_scoped_release unlocked;
        usdfoliage::find_axis(GivenAxes{points, radius, arc, direction, first, counts}.read(), tube.data(), at.data(), n,
                              found.data(), found_radius.data(), threads);
    }
    return nb::make_tuple(to_numpy(std::move(found), {n, 3}), to_numpy(std::move(found_radius), {n}));
}

nb::ndarray<nb::numpy, double> tangents(const Vectors& points, const Numbers& radius, const Numbers& arc,
                                        const Vectors& direction, const Integers& first, const Integers& counts,
                                        const Integers& tube, const Numbers& at, const Numbers& reach, int threads) {
    const std::size_t n = tube.shape(0);
    std::vector<double> found(3 * n);
    {
        nb::gil_scoped_release unlocked;
        usdfoliage::find_tangents(GivenAxes{points, radius, arc, direction, first, counts}.read(), tube.data(), at.data(),
                                  reach.data(), n, found.data(), threads);
    }
    return to_numpy(std::move(found), {n, 3});
}

nb::tuple frames(const Vectors& points, const Numbers& radius, const Numbers& arc, const Vectors& direction,
                 const Integers& first, const Integers& counts, const Vectors& reference, const Integers& tube,
                 const Numbers& at, const Vectors& tangent, int threads) {
    const std::size_t n = tube.shape(0);
    std::vector<double> one(3 * n), two(3 * n);
    {
        nb::gil_scoped_release unlocked;
        usdfoliage::find_frames(GivenAxes{points, radius, arc, direction, first, counts}.read(), reference.data(), tube.data(),
                                at.data(), tangent.data(), n, one.data(), two.data(), threads);
    }
    return nb::make_tuple(to_numpy(std::move(one), {n, 3}), to_numpy(std::move(two), {n, 3}));
}

nb::tuple fill(const Vectors& points, const Numbers& radius, const Numbers& arc, const Vectors& direction,
               const Integers& first, const Integers& counts, const Numbers& turned, const Integers& tube,
               const Input<double, nb::shape<-1, 4>>& gaps, double tolerance, double longest, double growth, double steady,
               double long_segment, double most_reach, std::int64_t least_samples, std::int64_t most_samples, int threads) {
    usdfoliage::AddedRings added;
    {
        nb::gil_scoped_release unlocked;
        std::vector<usdfoliage::RingGap> given(tube.shape(0));
        for (std::size_t k = 0; k < given.size(); ++k) {
            const double* value = gaps.data() + 4 * k;
            given[k] = {tube.data()[k], value[0], value[1], value[2], value[3]};
        }
        added = usdfoliage::fill_gaps(GivenAxes{points, radius, arc, direction, first, counts}.read(), turned.data(),
                                      given.data(), given.size(),
                                      {tolerance, longest, growth, steady, long_segment, most_reach, least_samples,
                                       most_samples},
                                      threads);
    }
    const std::size_t n = added.arc.size();
    return nb::make_tuple(to_numpy(std::move(added.gap), {n}), to_numpy(std::move(added.arc), {n}));
}

nb::tuple circles(const Integers& tube, const Vectors& center, const Vectors& tangent, const Vectors& first,
                  const Vectors& second, const Input<double, nb::shape<-1, 6>>& angles, const Numbers& radius,
                  double at_vertices, int threads) {
    const std::size_t n = tube.shape(0);
    std::vector<double> found_radius(radius.data(), radius.data() + n), points(18 * n);
    {
        nb::gil_scoped_release unlocked;
        const usdfoliage::RingCircles rings{tube.data(),  center.data(), tangent.data(), first.data(),
                                            second.data(), angles.data(), n};
        usdfoliage::round_rings(rings, at_vertices, found_radius.data(), points.data(), threads);
    }
    return nb::make_tuple(to_numpy(std::move(points), {n, 6, 3}), to_numpy(std::move(found_radius), {n}));
}

nb::tuple bend(const Vectors& points, const Numbers& radius, const Numbers& step, double held, double fade, int samples,
               double least_apart) {
    const double* way = step.data();
    usdfoliage::BentAxis bent = usdfoliage::bend_start(points.data(), radius.data(), radius.shape(0),
                                                       {{way[0], way[1], way[2]}, held, fade, samples, least_apart});
    const std::size_t n = bent.old_arc.size();
    return nb::make_tuple(to_numpy(std::move(bent.old_arc), {n}), to_numpy(std::move(bent.points), {n, 3}),
                          to_numpy(std::move(bent.radius), {n}), to_numpy(std::move(bent.moved), {n, 3}),
                          to_numpy(std::move(bent.new_arc), {n}));
}

nb::tuple nearest(const Vectors& points, const Numbers& radius, const Numbers& arc, const Vectors& direction,
                  const Integers& first, const Integers& counts, const Integers& tube, const Integers& at,
                  const Vectors& places, int most_steps, int threads) {
    const std::size_t n = tube.shape(0);
    std::vector<std::int64_t> found_at(at.data(), at.data() + n);
    std::vector<double> found(3 * n), found_arc(n), found_radius(n);
    {
        nb::gil_scoped_release unlocked;
        usdfoliage::find_nearest(GivenAxes{points, radius, arc, direction, first, counts}.read(), tube.data(), places.data(), n,
                                 most_steps, found_at.data(), found.data(), found_arc.data(), found_radius.data(), threads);
    }
    return nb::make_tuple(to_numpy(std::move(found), {n, 3}), to_numpy(std::move(found_arc), {n}),
                          to_numpy(std::move(found_radius), {n}), to_numpy(std::move(found_at), {n}));
}

nb::tuple walk(const Vectors& points, const Numbers& radius, const Numbers& arc, const Vectors& direction,
               const Integers& first, const Integers& counts, const Integers& tube, const Integers& parent,
               const Numbers& clearance, const Integers& at, const Numbers& start, bool whole_disc, double cage_factor,
               double thickest, double skin, int most_steps, int threads) {
    const std::size_t n = tube.shape(0);
    std::vector<std::int64_t> found_at(at.data(), at.data() + n);
    std::vector<double> found_arc(start.data(), start.data() + n);
    std::vector<std::uint8_t> done(n);
    {
        nb::gil_scoped_release unlocked;
        const usdfoliage::TubeAxes axes = GivenAxes{points, radius, arc, direction, first, counts}.read();
        const usdfoliage::ExitWalk how{cage_factor, thickest, skin, most_steps, whole_disc};
        usdfoliage::walk_out(axes, tube.data(), parent.data(), clearance.data(), n, how, found_at.data(), found_arc.data(),
                             done.data(), threads);
    }
    return nb::make_tuple(to_numpy(std::move(found_arc), {n}), to_numpy(std::move(done), {n}), to_numpy(std::move(found_at), {n}));
}

void carry(const Vectors& direction, const Integers& first, const Integers& counts,
           const nb::ndarray<double, nb::shape<-1, 3>, nb::c_contig, nb::device::cpu>& reference, int threads) {
    nb::gil_scoped_release unlocked;
    usdfoliage::carry_references(direction.data(), first.data(), counts.data(), first.shape(0), reference.data(), threads);
}

}  // namespace

void bind_branch_cage(nb::module_& m) {
    m.def("find_fork_crossings", &crossings, "points"_a, "faces"_a, "fork_faces"_a, "fork_first"_a, "threads"_a,
          "Places (N, 2) in fork_faces whose quads cross, each pair of faces once.");
    m.def("pull_limit", &pull, "faces"_a, "aims"_a, "tangents"_a, "swell"_a, "center"_a, "gain"_a, "rounds"_a, "farthest"_a,
          "threads"_a, "Vertices (V, 3) of a closed mesh of quads whose Catmull-Clark limits are at their aims, nearly.");
    m.def("place_holes", &place, "wants"_a, "want_tube"_a, "want_first"_a, "start"_a, "end"_a, "length"_a, "phase"_a,
          "steep"_a, "steep_first"_a, "gone"_a, "tightest"_a, "relaxed"_a, "least_column"_a,
          "Blocks, holes and column angles of branches along their parents, and the wants that found no place.");
    m.def("walk_out", &walk, "points"_a, "radius"_a, "arc"_a, "direction"_a, "first"_a, "counts"_a, "tube"_a, "parent"_a,
          "clearance"_a, "at"_a, "start"_a, "whole_disc"_a, "cage_factor"_a, "thickest"_a, "skin"_a, "most_steps"_a,
          "threads"_a, "Arcs (C,) at which tubes are outside their parents, whether they are, and the parents' segments there.");
    m.def("bend_start", &bend, "points"_a, "radius"_a, "step"_a, "held"_a, "fade"_a, "samples"_a, "least_apart"_a,
          "An axis whose start is moved: old arcs (N,), points (N, 3), radii, by how much (N, 3), and arcs now.");
    m.def("tube_nearest", &nearest, "points"_a, "radius"_a, "arc"_a, "direction"_a, "first"_a, "counts"_a, "tube"_a, "at"_a,
          "places"_a, "most_steps"_a, "threads"_a,
          "Points (N, 3), arcs and radii of tubes next to places, and their segments, from those where they were.");
    m.def("tube_axis", &axis, "points"_a, "radius"_a, "arc"_a, "direction"_a, "first"_a, "counts"_a, "tube"_a, "at"_a,
          "threads"_a, "Points (N, 3) and radii (N,) at arcs of tubes, held at the ends.");
    m.def("tube_tangents", &tangents, "points"_a, "radius"_a, "arc"_a, "direction"_a, "first"_a, "counts"_a, "tube"_a, "at"_a,
          "reach"_a, "threads"_a, "Unit chords (N, 3) over the axes from reach before arcs of tubes to reach after them.");
    m.def("tube_frames", &frames, "points"_a, "radius"_a, "arc"_a, "direction"_a, "first"_a, "counts"_a, "reference"_a,
          "tube"_a, "at"_a, "tangents"_a, "threads"_a,
          "Two unit vectors (N, 3) each, right-handed with the tangents at arcs of tubes.");
    m.def("fill_gaps", &fill, "points"_a, "radius"_a, "arc"_a, "direction"_a, "first"_a, "counts"_a, "turned"_a, "tube"_a,
          "gaps"_a, "tolerance"_a, "longest"_a, "growth"_a, "steady"_a, "long_segment"_a, "most_reach"_a, "least_samples"_a, "most_samples"_a,
          "threads"_a, "Rings in gaps (low, length, spacing below and above): the gap and the arc of each.");
    m.def("round_rings", &circles, "tube"_a, "center"_a, "tangent"_a, "first"_a, "second"_a, "angles"_a, "radius"_a,
          "at_vertices"_a, "threads"_a, "Six points (N, 6, 3) of each ring, and radii (N,), less where rings would cross.");
    m.def("carry_references", &carry, "direction"_a, "first"_a, "counts"_a, "reference"_a, "threads"_a,
          "Fill reference (V, 3): unit normals carried along tubes, given at the first point of each.");
}
