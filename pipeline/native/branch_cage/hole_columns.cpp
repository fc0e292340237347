#include "branch_cage/hole_columns.h"

#include <algorithm>
#include <cmath>

namespace usdfoliage {
namespace {

constexpr double kTurn = 2 * 3.141592653589793;

// The remainder that has the sign of the divisor.
double wrapped(double angle) {
    const double rest = std::fmod(angle, kTurn);
    return rest != 0 && rest < 0 ? rest + kTurn : rest;
}

using Ranked = std::vector<std::size_t>;

// Angles between the sectors of members in order, each to the next.
std::vector<double> gaps_between(const std::vector<HoleWant>& wants, const Ranked& ranked, double HoleWant::* half) {
    std::vector<double> gaps(ranked.size());
    for (std::size_t k = 0; k < ranked.size(); ++k) {
        const HoleWant &one = wants[ranked[k]], &next = wants[ranked[(k + 1) % ranked.size()]];
        const double apart = ranked.size() > 1 ? wrapped(next.azimuth - one.azimuth) : kTurn;
        gaps[k] = apart - one.*half - next.*half;
    }
    return gaps;
}

// Whether the other columns have room between the sectors.
bool fits(const std::vector<double>& gaps, double min_column) {
    long columns = 0;
    for (const double gap : gaps) {
        if (gap < 0) return false;
        columns += static_cast<long>(gap / min_column);
    }
    return columns >= kCageSides - static_cast<long>(gaps.size());
}

// Six ascending angles, the first the left edge of the first member's sector.
Columns6 share_out(const std::vector<HoleWant>& wants, const Ranked& ranked, const std::vector<double>& halves,
                   const std::vector<int>& extra) {
    const std::size_t count = ranked.size();
    std::vector<double> gaps(count);
    for (std::size_t k = 0; k < count; ++k) {
        const std::size_t next = (k + 1) % count;
        const double apart = count > 1 ? wrapped(wants[ranked[next]].azimuth - wants[ranked[k]].azimuth) : kTurn;
        gaps[k] = apart - halves[k] - halves[next];
    }
    Columns6 angles{};
    std::size_t at = 0;
    for (std::size_t k = 0; k < count; ++k) {
        const std::size_t before = (k + count - 1) % count;
        const double azimuth = wants[ranked[k]].azimuth, left = azimuth - halves[k];
        angles[at++] = extra[before] ? left : left - gaps[before] / 2;
        for (int j = 0; j < extra[k]; ++j) angles[at++] = azimuth + halves[k] + gaps[k] / extra[k] * j;
    }
    return angles;
}

}  // namespace

bool has_room(const std::vector<HoleWant>& wants, const std::vector<std::size_t>& members, std::size_t want,
              double min_column) {
    if (members.empty() || members.size() >= kCageSides) return false;
    Ranked ranked = members;
    ranked.push_back(want);
    std::stable_sort(ranked.begin(), ranked.end(), [&](std::size_t a, std::size_t b) {
        return wrapped(wants[a].azimuth) < wrapped(wants[b].azimuth);
    });
    return fits(gaps_between(wants, ranked, &HoleWant::tight), min_column);
}

BlockColumns arrange_columns(std::vector<HoleWant>& wants, const std::vector<std::size_t>& members, double phase,
                             double min_column) {
    const std::size_t count = members.size();
    std::vector<std::size_t> order(count);
    for (std::size_t k = 0; k < count; ++k) order[k] = k;
    std::stable_sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) {
        return wrapped(wants[members[a]].azimuth) < wrapped(wants[members[b]].azimuth);
    });
    Ranked ranked(count);
    for (std::size_t k = 0; k < count; ++k) ranked[k] = members[order[k]];
    double HoleWant::* half = &HoleWant::half;
    std::vector<double> gaps = gaps_between(wants, ranked, half);
    if (!fits(gaps, min_column)) {
        half = &HoleWant::tight;
        gaps = gaps_between(wants, ranked, half);
    }
    std::vector<int> extra(count, 0);
    for (std::size_t k = count; k < kCageSides; ++k) {
        std::size_t widest = 0;
        for (std::size_t j = 1; j < count; ++j)
            if (gaps[j] / (extra[j] + 1) > gaps[widest] / (extra[widest] + 1)) widest = j;
        ++extra[widest];
    }
    double azimuth = wants[ranked[0]].azimuth;
    for (std::size_t k = 0; k < count; ++k) {
        const double apart = wrapped(wants[ranked[(k + 1) % count]].azimuth - azimuth);
        wants[ranked[k]].azimuth = azimuth;
        azimuth += apart;
    }
    std::vector<double> halves(count), end_halves(count);
    for (std::size_t k = 0; k < count; ++k) {
        halves[k] = wants[ranked[k]].*half;
        end_halves[k] = std::min(halves[k], wants[ranked[k]].end_half);
    }
    const Columns6 middle = share_out(wants, ranked, halves, extra), ends = share_out(wants, ranked, end_halves, extra);
    const double aim = std::isnan(phase) ? mean_turn(middle) : phase;
    // Column k becomes column k + shift: its angle then belongs to shift sixths of a turn more.
    const long sixths = std::lrint((mean_turn(middle) - aim) / (kTurn / kCageSides));
    const long shift = ((sixths % kCageSides) + kCageSides) % kCageSides, turns = (sixths - shift) / kCageSides;
    BlockColumns result;
    for (int k = 0; k < kCageSides; ++k) {
        const auto from = static_cast<std::size_t>((k - shift + kCageSides) % kCageSides);
        const double back = k < shift ? kTurn : 0.0;
        result.middle[static_cast<std::size_t>(k)] = middle[from] - back - static_cast<double>(turns) * kTurn;
        result.ends[static_cast<std::size_t>(k)] = ends[from] - back - static_cast<double>(turns) * kTurn;
    }
    result.sectors.resize(count);
    long sector = shift;
    for (std::size_t k = 0; k < count; ++k) {
        const auto own = static_cast<std::size_t>(sector % kCageSides);
        result.sectors[order[k]] = static_cast<int>(own);
        const double left = result.middle[own], right = result.middle[(own + 1) % kCageSides];
        const double center = (left + right + (own == kCageSides - 1 ? kTurn : 0.0)) / 2;
        double& angle = wants[ranked[k]].azimuth;
        angle += kTurn * std::nearbyint((center - angle) / kTurn);
        sector += 1 + extra[k];
    }
    return result;
}

double mean_turn(const Columns6& angles) {
    double sum = 0;
    for (const double angle : angles) sum += angle;
    return sum / kCageSides - kTurn / kCageSides * (kCageSides - 1) / 2;
}

Columns6 even_columns(double phase) {
    Columns6 angles;
    for (int k = 0; k < kCageSides; ++k) angles[static_cast<std::size_t>(k)] = phase + kTurn / kCageSides * k;
    return angles;
}

}  // namespace usdfoliage
