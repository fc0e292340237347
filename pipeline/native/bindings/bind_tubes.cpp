#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>

#include <cstdint>
#include <utility>
#include <vector>

#include "bindings/arrays.h"
#include "bindings/bindings.h"
#include "bindings/structs.h"
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
using Angles = Input<double, nb::shape<-1, 6>>;
using usdfoliage::ExitWalkSettings;
using usdfoliage::RingSpacingSettings;
using usdfoliage::StartBendSettings;

struct TubeAxes {
    Vectors points_m;
    Numbers radius_m, arc_m;
    Vectors direction;
    Integers first, counts;

    usdfoliage::TubeAxes read() const {
        return {points_m.data(), radius_m.data(), arc_m.data(), direction.data(), first.data(), counts.data()};
    }
};

struct ExitWalks {
    Integers tube, parent;
    Numbers clearance;
    Integers at;
    Numbers start_m;
};

struct RingGaps {
    Integers tube;
    Numbers low_m, length_m, below_m, above_m;
};

struct RingCircles {
    Integers tube;
    Vectors center_m, tangent, first, second;
    Angles angles_rad;
    Numbers radius_m;
};

struct TubePlaces {
    nb::object points_m, radius_m;
};

struct TubeFrames {
    nb::object first, second;
};

struct NearestPlaces {
    nb::object points_m, arc_m, radius_m, at;
};

struct TubeExits {
    nb::object arc_m, done, at;
};

struct AddedRings {
    nb::object gap, arc_m;
};

struct RoundRings {
    nb::object points_m, radius_m;
};

struct BentAxis {
    nb::object old_arc_m, points_m, radius_m, moved_m, new_arc_m;
};

TubePlaces axis(const TubeAxes& axes, const Integers& tube, const Numbers& arc, int threads) {
    const std::size_t n = tube.shape(0);
    std::vector<double> found(3 * n), found_radius(n);
    {
        nb::gil_scoped_release unlocked;
        usdfoliage::find_axis(axes.read(), tube.data(), arc.data(), n, found.data(), found_radius.data(), threads);
    }
    return {to_array(std::move(found), {n, 3}), to_array(std::move(found_radius), {n})};
}

nb::ndarray<nb::numpy, double> tangents(const TubeAxes& axes, const Integers& tube, const Numbers& arc, const Numbers& reach,
                                        int threads) {
    const std::size_t n = tube.shape(0);
    std::vector<double> found(3 * n);
    {
        nb::gil_scoped_release unlocked;
        usdfoliage::find_tangents(axes.read(), tube.data(), arc.data(), reach.data(), n, found.data(), threads);
    }
    return to_numpy(std::move(found), {n, 3});
}

TubeFrames frames(const TubeAxes& axes, const Integers& tube, const Numbers& arc, const Vectors& tangent,
                  const Vectors& reference, int threads) {
    const std::size_t n = tube.shape(0);
    std::vector<double> one(3 * n), two(3 * n);
    {
        nb::gil_scoped_release unlocked;
        usdfoliage::find_frames(axes.read(), reference.data(), tube.data(), arc.data(), tangent.data(), n, one.data(), two.data(),
                                threads);
    }
    return {to_array(std::move(one), {n, 3}), to_array(std::move(two), {n, 3})};
}

NearestPlaces nearest(const TubeAxes& axes, const Integers& tube, const Integers& at, const Vectors& places, int max_steps,
                      int threads) {
    const std::size_t n = tube.shape(0);
    std::vector<std::int64_t> found_at(at.data(), at.data() + n);
    std::vector<double> found(3 * n), found_arc(n), found_radius(n);
    {
        nb::gil_scoped_release unlocked;
        usdfoliage::find_nearest(axes.read(), tube.data(), places.data(), n, max_steps, found_at.data(), found.data(),
                                 found_arc.data(), found_radius.data(), threads);
    }
    return {to_array(std::move(found), {n, 3}), to_array(std::move(found_arc), {n}), to_array(std::move(found_radius), {n}),
            to_array(std::move(found_at), {n})};
}

TubeExits walk(const TubeAxes& axes, const ExitWalks& walks, const ExitWalkSettings& settings, int threads) {
    const std::size_t n = walks.tube.shape(0);
    std::vector<std::int64_t> found_at(walks.at.data(), walks.at.data() + n);
    std::vector<double> found_arc(walks.start_m.data(), walks.start_m.data() + n);
    std::vector<std::uint8_t> done(n);
    {
        nb::gil_scoped_release unlocked;
        const usdfoliage::TubeAxes all = axes.read();
        usdfoliage::walk_out(all, walks.tube.data(), walks.parent.data(), walks.clearance.data(), n, settings, found_at.data(),
                             found_arc.data(), done.data(), threads);
    }
    return {to_array(std::move(found_arc), {n}), to_array(std::move(done), {n}), to_array(std::move(found_at), {n})};
}

AddedRings fill(const TubeAxes& axes, const RingGaps& gaps, const Numbers& turned, const RingSpacingSettings& settings,
                int threads) {
    usdfoliage::AddedRings added;
    {
        nb::gil_scoped_release unlocked;
        std::vector<usdfoliage::RingGap> given(gaps.tube.shape(0));
        for (std::size_t k = 0; k < given.size(); ++k)
            given[k] = {gaps.tube.data()[k], gaps.low_m.data()[k], gaps.length_m.data()[k], gaps.below_m.data()[k],
                        gaps.above_m.data()[k]};
        added = usdfoliage::fill_gaps(axes.read(), turned.data(), given.data(), given.size(), settings, threads);
    }
    const std::size_t n = added.arc.size();
    return {to_array(std::move(added.gap), {n}), to_array(std::move(added.arc), {n})};
}

RoundRings circles(const RingCircles& given, double at_vertices, int threads) {
    const std::size_t n = given.tube.shape(0);
    std::vector<double> radius(given.radius_m.data(), given.radius_m.data() + n), points(18 * n);
    {
        nb::gil_scoped_release unlocked;
        const usdfoliage::RingCircles rings{given.tube.data(),   given.center_m.data(),   given.tangent.data(), given.first.data(),
                                            given.second.data(), given.angles_rad.data(), n};
        usdfoliage::round_rings(rings, at_vertices, radius.data(), points.data(), threads);
    }
    return {to_array(std::move(points), {n, 6, 3}), to_array(std::move(radius), {n})};
}

BentAxis bend(const Vectors& points, const Numbers& radius, const Input<double, nb::shape<3>>& step,
              const StartBendSettings& settings) {
    usdfoliage::BentAxis bent = usdfoliage::bend_start(points.data(), radius.data(), radius.shape(0), step.data(), settings);
    const std::size_t n = bent.old_arc.size();
    return {to_array(std::move(bent.old_arc), {n}), to_array(std::move(bent.points), {n, 3}),
            to_array(std::move(bent.radius), {n}), to_array(std::move(bent.moved), {n, 3}),
            to_array(std::move(bent.new_arc), {n})};
}

void carry(const Vectors& direction, const Integers& first, const Integers& counts,
           const nb::ndarray<double, nb::shape<-1, 3>, nb::c_contig, nb::device::cpu>& reference, int threads) {
    nb::gil_scoped_release unlocked;
    usdfoliage::carry_references(direction.data(), first.data(), counts.data(), first.shape(0), reference.data(), threads);
}

void bind_tube_inputs(nb::module_& m) {
    nb::class_<TubeAxes>(m, "TubeAxes", "The axes of T tubes, one after another.")
        .def(nb::init<Vectors, Numbers, Numbers, Vectors, Integers, Integers>(), nb::kw_only(), "points_m"_a, "radius_m"_a,
             "arc_m"_a, "direction"_a, "first"_a, "counts"_a);
    nb::class_<ExitWalks>(m, "ExitWalks", "Tubes that walk on until they are outside their parents.")
        .def(nb::init<Integers, Integers, Numbers, Integers, Numbers>(), nb::kw_only(), "tube"_a, "parent"_a, "clearance"_a,
             "at"_a, "start_m"_a);
    nb::class_<RingGaps>(m, "RingGaps", "Stretches between two rings that are given.")
        .def(nb::init<Integers, Numbers, Numbers, Numbers, Numbers>(), nb::kw_only(), "tube"_a, "low_m"_a, "length_m"_a,
             "below_m"_a, "above_m"_a);
    nb::class_<RingCircles>(m, "RingCircles", "Rings of six along tubes.")
        .def(nb::init<Integers, Vectors, Vectors, Vectors, Vectors, Angles, Numbers>(), nb::kw_only(), "tube"_a, "center_m"_a,
             "tangent"_a, "first"_a, "second"_a, "angles_rad"_a, "radius_m"_a);
}

void bind_tube_settings(nb::module_& m) {
    using Exit = ExitWalkSettings;
    using Spacing = RingSpacingSettings;
    using Bend = StartBendSettings;
    bind_settings(m, "ExitWalkSettings", "When a tube is outside its parent.",
                  field("whole_disc", &Exit::whole_disc, "Whether the whole disc is to be outside, or the axis alone."),
                  field("cage_factor", &Exit::cage_factor, "How much farther from its axis a cage is than its limit."),
                  field("thickest", &Exit::thickest, "Of its parent's radius, a branch where it leaves."),
                  field("skin", &Exit::skin, "Radii that do not matter."), field("max_steps", &Exit::max_steps, "Of a walk."));
    bind_settings(m, "RingSpacingSettings", "How far rings are apart.",
                  field("tolerance", &Spacing::tolerance, "Of its radius, by how much a tube may leave its axis."),
                  field("longest", &Spacing::longest, "Spacing, in radii."),
                  field("growth", &Spacing::growth, "Of the spacing, per length away from the ends of a gap."),
                  field("steady", &Spacing::steady, "Spacing in radii on segments that are long."),
                  field("long_segment", &Spacing::long_segment, "Radii: its corners have rings of their own."),
                  field("max_reach_m", &Spacing::max_reach_m, "Over which bends are measured."),
                  field("min_samples", &Spacing::min_samples, "Of the spacing in a gap."),
                  field("max_samples", &Spacing::max_samples, "Of the spacing in a gap."));
    bind_settings(m, "StartBendSettings", "How the start of an axis is moved.",
                  field("kept_m", &Bend::kept_m, "Arc up to which all is moved by the same step."),
                  field("fade_m", &Bend::fade_m, "Length over which that fades."),
                  field("samples", &Bend::samples, "Stretches that the fading is cut into."),
                  field("min_apart", &Bend::min_apart, "Of fade_m, between added points and those that are there."));
}

void bind_tube_results(nb::module_& m) {
    bind_result(m, "TubePlaces", "Places on axes.", field("points_m", &TubePlaces::points_m, "(N, 3)."),
                field("radius_m", &TubePlaces::radius_m, "(N,)."));
    bind_result(m, "TubeFrames", "Two unit vectors, right-handed with a tangent.",
                field("first", &TubeFrames::first, "(N, 3)."), field("second", &TubeFrames::second, "(N, 3)."));
    bind_result(m, "NearestPlaces", "Places of tubes next to points.",
                field("points_m", &NearestPlaces::points_m, "(N, 3)."), field("arc_m", &NearestPlaces::arc_m, "(N,)."),
                field("radius_m", &NearestPlaces::radius_m, "(N,)."), field("at", &NearestPlaces::at, "(N,), segments."));
    bind_result(m, "TubeExits", "Where tubes are outside their parents.",
                field("arc_m", &TubeExits::arc_m, "(C,), at most at the tip."),
                field("done", &TubeExits::done, "(C,), 1 where they are outside."),
                field("at", &TubeExits::at, "(C,), segments of the parents there."));
    bind_result(m, "AddedRings", "Rings in gaps.", field("gap", &AddedRings::gap, "(R,)."),
                field("arc_m", &AddedRings::arc_m, "(R,)."));
    bind_result(m, "RoundRings", "Rings of six points.", field("points_m", &RoundRings::points_m, "(N, 6, 3)."),
                field("radius_m", &RoundRings::radius_m, "(N,), less where neighbouring rings would cross."));
    bind_result(m, "BentAxis", "An axis whose start is moved.", field("old_arc_m", &BentAxis::old_arc_m, "(N,), before."),
                field("points_m", &BentAxis::points_m, "(N, 3), now."), field("radius_m", &BentAxis::radius_m, "(N,)."),
                field("moved_m", &BentAxis::moved_m, "(N, 3), by how much."),
                field("new_arc_m", &BentAxis::new_arc_m, "(N,), now."));
}

}  // namespace

void bind_tubes(nb::module_& m) {
    bind_tube_inputs(m);
    bind_tube_settings(m);
    bind_tube_results(m);
    m.def("tube_axis", &axis, "axes"_a, "tube"_a, "arc_m"_a, nb::kw_only(), "threads"_a,
          "Points and radii at arcs of tubes, those of the ends beyond them.");
    m.def("tube_tangents", &tangents, "axes"_a, "tube"_a, "arc_m"_a, nb::kw_only(), "reach_m"_a, "threads"_a,
          "Unit chords (N, 3) over the axes from reach before arcs of tubes to reach after them.");
    m.def("tube_frames", &frames, "axes"_a, "tube"_a, "arc_m"_a, nb::kw_only(), "tangents"_a, "reference"_a, "threads"_a,
          "Two unit vectors each, right-handed with the tangents at arcs of tubes.");
    m.def("tube_nearest", &nearest, "axes"_a, "tube"_a, "at"_a, nb::kw_only(), "places_m"_a, "max_steps"_a, "threads"_a,
          "Places of tubes next to points, from the segments where they were.");
    m.def("walk_out", &walk, "axes"_a, "walks"_a, nb::kw_only(), "settings"_a, "threads"_a,
          "Arcs at which tubes are outside their parents.");
    m.def("fill_gaps", &fill, "axes"_a, "gaps"_a, nb::kw_only(), "turned_rad"_a, "settings"_a, "threads"_a,
          "Rings in gaps, so many as bends ask for.");
    m.def("round_rings", &circles, "rings"_a, nb::kw_only(), "at_vertices"_a, "threads"_a,
          "Six points of each ring, and radii, less where rings would cross.");
    m.def("bend_start", &bend, "points_m"_a, "radius_m"_a, nb::kw_only(), "step_m"_a, "settings"_a,
          "An axis whose start is moved by a step.");
    m.def("carry_references", &carry, "direction"_a, "first"_a, "counts"_a, nb::kw_only(), "reference"_a.noconvert(), "threads"_a,
          "Fill reference (V, 3): unit normals carried along tubes, given at the first point of each.");
}
