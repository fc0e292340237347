#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>

#include <cstdint>
#include <utility>
#include <vector>

#include "bindings/arrays.h"
#include "bindings/bindings.h"
#include "bindings/structs.h"
#include "branch_cage/fork_crossings.h"
#include "branch_cage/hole_places.h"
#include "branch_cage/limit_pull.h"

namespace nb = nanobind;
using namespace nb::literals;

namespace {

template <typename T, typename Shape>
using Input = nb::ndarray<const T, Shape, nb::c_contig, nb::device::cpu>;
using Numbers = Input<double, nb::shape<-1>>;
using Pairs = Input<double, nb::shape<-1, 2>>;
using Integers = Input<std::int64_t, nb::shape<-1>>;
using Flags = Input<std::uint8_t, nb::shape<-1>>;
using Vectors = Input<double, nb::shape<-1, 3>>;
using Quads = Input<std::int64_t, nb::shape<-1, 4>>;
using usdfoliage::HoleSettings;

struct HoleTubes {
    Numbers start_m, end_m, length_m, phase_rad;
    Pairs steep_m;
    Integers steep_first;
    Flags gone;
};

struct HoleWants {
    Integers tube, first;
    Numbers arc_m, azimuth_rad, half_rad, tight_rad, end_half_rad, half_block_m, half_along_m, half_across_m, parent_radius_m;

    std::vector<usdfoliage::HoleWant> read() const {
        std::vector<usdfoliage::HoleWant> wants(tube.shape(0));
        for (std::size_t k = 0; k < wants.size(); ++k)
            wants[k] = {arc_m.data()[k],        azimuth_rad.data()[k],  half_rad.data()[k],
                        tight_rad.data()[k],    end_half_rad.data()[k], half_block_m.data()[k],
                        half_along_m.data()[k], half_across_m.data()[k], parent_radius_m.data()[k]};
        return wants;
    }
};

struct HolePlaces {
    nb::object block_tube, block_arcs_m, want, block, sector, arc_m, azimuth_rad, half_along_m, half_across_m, turn_tube, turn_arc_m,
        turn_angles_rad, homeless;
};

struct LimitAims {
    Vectors aims_m, tangents;
    Pairs swell;
    Vectors center_m;
    Numbers gain;
};

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

nb::ndarray<nb::numpy, double> pull(const Quads& faces, const LimitAims& aims, int rounds, double farthest, int threads) {
    std::vector<double> points;
    {
        nb::gil_scoped_release unlocked;
        const usdfoliage::LimitAims given{aims.aims_m.data(),   aims.tangents.data(), aims.swell.data(),
                                          aims.center_m.data(), aims.gain.data(),     aims.aims_m.shape(0)};
        points = usdfoliage::pull_limit(faces.data(), faces.shape(0), given, rounds, farthest, threads);
    }
    const std::size_t count = points.size() / 3;
    return to_numpy(std::move(points), {count, 3});
}

HolePlaces place(const HoleTubes& given, const HoleWants& wants, const HoleSettings& settings) {
    usdfoliage::HolePlacement found;
    {
        nb::gil_scoped_release unlocked;
        const usdfoliage::HoleTubes tubes{given.start_m.data(), given.end_m.data(),   given.length_m.data(),    given.phase_rad.data(),
                                          given.steep_m.data(), given.steep_first.data(), wants.first.data(), wants.tube.data(),
                                          given.gone.data(),    given.start_m.shape(0)};
        found = usdfoliage::place_holes(tubes, wants.read(), settings);
    }
    const std::size_t blocks = found.block_tube.size(), holes = found.want.size(), turns = found.turn_tube.size(),
                      homeless = found.homeless.size();
    return {to_array(std::move(found.block_tube), {blocks}),     to_array(std::move(found.block_arcs), {blocks, 3}),
            to_array(std::move(found.want), {holes}),            to_array(std::move(found.block), {holes}),
            to_array(std::move(found.sector), {holes}),          to_array(std::move(found.arc), {holes}),
            to_array(std::move(found.azimuth), {holes}),         to_array(std::move(found.half_along), {holes}),
            to_array(std::move(found.half_across), {holes}),     to_array(std::move(found.turn_tube), {turns}),
            to_array(std::move(found.turn_arc), {turns}),        to_array(std::move(found.turn_angles), {turns, 6}),
            to_array(std::move(found.homeless), {homeless})};
}

void bind_holes(nb::module_& m) {
    nb::class_<HoleTubes>(m, "HoleTubes", "T tubes, parents before children.")
        .def(nb::init<Numbers, Numbers, Numbers, Numbers, Pairs, Integers, Flags>(), nb::kw_only(), "start_m"_a, "end_m"_a,
             "length_m"_a, "phase_rad"_a, "steep_m"_a, "steep_first"_a, "gone"_a);
    nb::class_<HoleWants>(m, "HoleWants", "W holes that look for a place, by parent.")
        .def(nb::init<Integers, Integers, Numbers, Numbers, Numbers, Numbers, Numbers, Numbers, Numbers, Numbers, Numbers>(),
             nb::kw_only(), "tube"_a, "first"_a, "arc_m"_a, "azimuth_rad"_a, "half_rad"_a, "tight_rad"_a, "end_half_rad"_a,
             "half_block_m"_a, "half_along_m"_a, "half_across_m"_a, "parent_radius_m"_a);
    bind_settings(m, "HoleSettings", "How close holes may be.",
                  field("tightest", &HoleSettings::tightest, "Share of its length that a hole may be pressed to."),
                  field("relaxed", &HoleSettings::relaxed, "Parent radii behind a block, in which columns go back to even ones."),
                  field("min_column_rad", &HoleSettings::min_column_rad, "Between neighbouring columns."));
    bind_result(m, "HolePlaces", "Blocks of rows, holes in them, angles of columns.",
                field("block_tube", &HolePlaces::block_tube, "(K,)."),
                field("block_arcs_m", &HolePlaces::block_arcs_m, "(K, 3), of the three rings."),
                field("want", &HolePlaces::want, "(H,), of each hole."), field("block", &HolePlaces::block, "(H,)."),
                field("sector", &HolePlaces::sector, "(H,)."), field("arc_m", &HolePlaces::arc_m, "(H,), on the parent."),
                field("azimuth_rad", &HolePlaces::azimuth_rad, "(H,)."),
                field("half_along_m", &HolePlaces::half_along_m, "(H,)."),
                field("half_across_m", &HolePlaces::half_across_m, "(H,)."),
                field("turn_tube", &HolePlaces::turn_tube, "(A,)."), field("turn_arc_m", &HolePlaces::turn_arc_m, "(A,)."),
                field("turn_angles_rad", &HolePlaces::turn_angles_rad, "(A, 6)."),
                field("homeless", &HolePlaces::homeless, "(D,), wants without a place."));
    m.def("place_holes", &place, "tubes"_a, "wants"_a, nb::kw_only(), "settings"_a,
          "A place for every hole, blocks and column angles of branches along their parents.");
}

}  // namespace

void bind_branch_cage(nb::module_& m) {
    bind_holes(m);
    nb::class_<LimitAims>(m, "LimitAims", "Where the limits of V vertices are to be.")
        .def(nb::init<Vectors, Vectors, Pairs, Vectors, Numbers>(), nb::kw_only(), "aims_m"_a, "tangents"_a, "swell"_a,
             "center_m"_a, "gain"_a);
    m.def("find_fork_crossings", &crossings, "points_m"_a, "faces"_a, nb::kw_only(), "fork_faces"_a, "fork_first"_a, "threads"_a,
          "Places (N, 2) in fork_faces whose quads cross, each pair of faces once.");
    m.def("pull_limit", &pull, "faces"_a, "aims"_a, nb::kw_only(), "rounds"_a, "farthest"_a, "threads"_a,
          "Vertices (V, 3) of a closed mesh of quads whose Catmull-Clark limits are at their aims, nearly.");
}
