#include "branch_cage/tube_rings.h"

#include <array>

#include "parallel.h"

namespace usdfoliage {
namespace {

constexpr std::size_t kBlock = 64;  // gaps or tubes of one task
constexpr std::size_t kSides = 6;
constexpr double kMinSpacing = 0.9;  // radii
constexpr int kMaxTurns = 8;  // of making rings smaller that cross
constexpr double kThinner = 0.8;
constexpr double kMinForward = 0.2;  // of the way between two rings, twice, that each vertex must go on by

double turned_at(const TubeAxes& axes, const double* turned, std::int64_t tube, double arc) {
    const std::int64_t at = tube_segment(axes, tube, arc);
    return turned[at] + (turned[at + 1] - turned[at]) / (axes.arc[at + 1] - axes.arc[at]) * (arc - axes.arc[at]);
}

// Spacing at which a chord of the axis stays within the tolerance, where bends are spread over short segments.
double bend_spacing(const TubeAxes& axes, const double* turned, std::int64_t tube, double arc, double radius,
                    const RingSpacingSettings& settings) {
    const std::int64_t at = tube_segment(axes, tube, arc);
    if (axes.arc[at + 1] - axes.arc[at] > settings.long_segment * radius) return settings.steady * radius;
    const double reach = std::min(radius, settings.max_reach_m);
    const double ahead = turned_at(axes, turned, tube, std::min(arc + reach, tube_length(axes, tube)));
    const double behind = turned_at(axes, turned, tube, std::max(arc - reach, 0.0));
    return std::sqrt(8 * settings.tolerance * radius / std::max((ahead - behind) / (2 * reach), 1e-12));
}

void fill_gap(const TubeAxes& axes, const double* turned, const RingGap& gap, const RingSpacingSettings& settings,
              std::vector<double>& walked, std::vector<double>& added) {
    const double thinnest = std::min(tube_axis(axes, gap.tube, gap.low).radius,
                                     tube_axis(axes, gap.tube, gap.low + gap.length).radius);
    const double samples = std::clamp(std::ceil(gap.length / thinnest), static_cast<double>(settings.min_samples),
                                      static_cast<double>(settings.max_samples));
    const auto count = static_cast<std::size_t>(samples);
    walked.assign(count + 1, 0.0);
    for (std::size_t k = 0; k < count; ++k) {
        const double arc = gap.low + (static_cast<double>(k) + 0.5) / samples * gap.length;
        const double local = tube_axis(axes, gap.tube, arc).radius;
        double wanted = std::min(gap.below + settings.growth * (arc - gap.low),
                                 gap.above + settings.growth * (gap.low + gap.length - arc));
        wanted = std::min({wanted, settings.longest * local, bend_spacing(axes, turned, gap.tube, arc, local, settings)});
        walked[k + 1] = walked[k] + gap.length / samples / std::max(wanted, kMinSpacing * local);
    }
    // Where the spacing asks for little more than none, one row is stretched rather than two pressed.
    const double rows = std::max(std::nearbyint(walked[count]), 1.0);
    std::size_t at = 0;
    for (double rank = 1; rank < rows; ++rank) {
        const double aim = walked[count] * rank / rows;
        while (at + 1 < count && walked[at + 1] < aim) ++at;
        const double inside = 1 - (walked[at + 1] - aim) / (walked[at + 1] - walked[at]);
        added.push_back(gap.low + (static_cast<double>(at) + inside) * gap.length / samples);
    }
}

// The rings of one tube.
class Rounding {
  public:
    Rounding(const RingCircles& rings, std::size_t first, std::size_t end, double at_vertices, double* radius, double* points)
        : rings_(rings), first_(first), end_(end), at_vertices_(at_vertices), radius_(radius), points_(points) {}

    void run() {
        std::vector<std::uint8_t> changed(end_ - first_, 1), thin(end_ - first_);
        for (int turn = 0; turn < kMaxTurns; ++turn) {
            for (std::size_t k = first_; k < end_; ++k)
                if (changed[k - first_]) place(k);
            bool any = false;
            std::fill(thin.begin(), thin.end(), std::uint8_t{0});
            for (std::size_t k = first_; k + 1 < end_; ++k) {
                if (!(changed[k - first_] || changed[k + 1 - first_]) || !folded(k)) continue;
                thin[k - first_] = thin[k + 1 - first_] = 1;
                any = true;
            }
            if (!any) return;
            for (std::size_t k = first_; k < end_; ++k)
                if (thin[k - first_]) radius_[k] *= kThinner;
            changed.swap(thin);
        }
    }

  private:
    void place(std::size_t k) const {
        const double reach = at_vertices_ * radius_[k];
        for (std::size_t side = 0; side < kSides; ++side) {
            const double angle = rings_.angles[kSides * k + side], cosine = std::cos(angle), sine = std::sin(angle);
            for (std::size_t axis = 0; axis < 3; ++axis)
                points_[3 * (kSides * k + side) + axis] =
                    rings_.center[3 * k + axis] +
                    reach * (cosine * rings_.first[3 * k + axis] + sine * rings_.second[3 * k + axis]);
        }
    }

    // Whether a ring and the next one cross, nearly.
    bool folded(std::size_t k) const {
        const auto at = static_cast<std::int64_t>(k);
        const TubeVector low = vector_at(rings_.tangent, at), high = vector_at(rings_.tangent, at + 1),
                         ahead{low[0] + high[0], low[1] + high[1], low[2] + high[2]};
        const double min_dot = kMinForward * length(between(vector_at(rings_.center, at), vector_at(rings_.center, at + 1)));
        const auto vertex = static_cast<std::int64_t>(kSides);
        for (std::int64_t side = 0; side < vertex; ++side)
            if (dot(between(vector_at(points_, vertex * at + side), vector_at(points_, vertex * (at + 1) + side)), ahead) < min_dot)
                return true;
        return false;
    }

    const RingCircles& rings_;
    std::size_t first_, end_;
    double at_vertices_;
    double *radius_, *points_;
};

}  // namespace

AddedRings fill_gaps(const TubeAxes& axes, const double* turned, const RingGap* gaps, std::size_t n, const RingSpacingSettings& settings,
                     int threads) {
    const std::size_t blocks = (n + kBlock - 1) / kBlock;
    std::vector<AddedRings> by_block(blocks);
    parallel_for(blocks, threads, [&](std::size_t block) {
        std::vector<double> walked;
        AddedRings& own = by_block[block];
        for (std::size_t k = block * kBlock; k < std::min(n, (block + 1) * kBlock); ++k) {
            fill_gap(axes, turned, gaps[k], settings, walked, own.arc);
            own.gap.resize(own.arc.size(), static_cast<std::int64_t>(k));
        }
    });
    AddedRings all;
    for (const AddedRings& some : by_block) {
        all.gap.insert(all.gap.end(), some.gap.begin(), some.gap.end());
        all.arc.insert(all.arc.end(), some.arc.begin(), some.arc.end());
    }
    return all;
}

void round_rings(const RingCircles& rings, double at_vertices, double* radius, double* points, int threads) {
    std::vector<std::size_t> first;
    for (std::size_t k = 0; k < rings.n; ++k)
        if (k == 0 || rings.tube[k] != rings.tube[k - 1]) first.push_back(k);
    const std::size_t tubes = first.size();
    first.push_back(rings.n);
    parallel_for((tubes + kBlock - 1) / kBlock, threads, [&](std::size_t block) {
        for (std::size_t k = block * kBlock; k < std::min(tubes, (block + 1) * kBlock); ++k)
            Rounding(rings, first[k], first[k + 1], at_vertices, radius, points).run();
    });
}

}  // namespace usdfoliage
