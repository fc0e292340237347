#include "mvs/patch_match.h"

#include <algorithm>
#include <array>
#include <cassert>
#include <cmath>

#include "parallel.h"
#include "mvs/patch_match_window.h"
#include "vector_clones.h"

namespace usdfoliage {

namespace {

constexpr int kRegions = 8;
constexpr int kProposedIterations = 1;  // in which suggestions are tried; then they have spread or not
constexpr std::size_t kMinSeeing = 2;  // photographs that count at least
constexpr float kSamePlane = 0.04f;  // in pixels of the most moving photograph: another plane as near is the same

// Places whose planes a pixel tries, one of each region: near ones in a V on each side, far ones along a line. All are of
// the other half of the checkerboard.
struct Place {
    int right;
    int down;
};
constexpr int kNearPlaces = 7;
constexpr int kFarPlaces = 11;
constexpr Place kNear[kNearPlaces] = {{0, -1}, {-1, -2}, {1, -2}, {-2, -3}, {2, -3}, {-3, -4}, {3, -4}};  // upwards

// A region's k-th place, turned by quarters.
inline Place place_of(int region, int k) {
    const Place up = region < 4 ? kNear[k] : Place{0, -(3 + 2 * k)};
    switch (region & 3) {
        case 0: return up;
        case 1: return {-up.right, -up.down};
        case 2: return {up.down, up.right};
        default: return {-up.down, -up.right};
    }
}

// Random numbers by counting: the same for a seed, pixel and iteration, in any order of pixels.
class Random {
public:
    Random(std::uint64_t seed, std::size_t pixel, int iteration)
        : state_(mix(seed + 0x9e3779b97f4a7c15ull * (static_cast<std::uint64_t>(iteration) + 1)) ^ mix(pixel + 0x632be59bd9b4e019ull)) {}

    // In [0, 1).
    float uniform() {
        state_ += 0x9e3779b97f4a7c15ull;
        return static_cast<float>(mix(state_) >> 40) * 0x1p-24f;
    }

    // In [-1, 1).
    float both_sides() { return 2 * uniform() - 1; }

private:
    static std::uint64_t mix(std::uint64_t x) {
        x = (x ^ (x >> 30)) * 0xbf58476d1ce4e5b9ull;
        x = (x ^ (x >> 27)) * 0x94d049bb133111ebull;
        return x ^ (x >> 31);
    }

    std::uint64_t state_;
};

// The warps to up to kLanes photographs, side by side.
struct Warps {
    Lanes homography[9];
    Lanes epipole[3];
};

constexpr std::size_t kGroups = (kMaxSources + kLanes - 1) / kLanes;

// What all pixels share.
struct Match {
    const MatchReference& reference;
    const std::vector<MatchSource>& sources;
    const std::vector<PackedPicture>& pictures;
    const WindowPattern& pattern;
    const PatchMatchSettings& settings;
    double focal[2];
    double center[2];
    Warps warps[kGroups];
    float pixels_an_inverse;  // movement in the most moving photograph, for inverse depth that differs by 1
};

struct Plane {
    float inverse;
    float right;
    float down;
};

// The slant stays below the limit and the depth in the range; inverse depth is linear over rays as well, with the
// gradient (right fx, down fy) there, so that the tangent to the axis is gradient / (value on the axis).
bool usable(const Match& match, const Plane& plane, int column, int row) {
    if (!(plane.inverse >= match.settings.farthest_inverse && plane.inverse <= match.settings.nearest_inverse)) return false;
    const float x = static_cast<float>((column - match.center[0]) / match.focal[0]);
    const float y = static_cast<float>((row - match.center[1]) / match.focal[1]);
    const float across = plane.right * static_cast<float>(match.focal[0]);
    const float along = plane.down * static_cast<float>(match.focal[1]);
    const float axis = plane.inverse - x * across - y * along;
    // The cosine between line of sight and normal is inverse / (|gradient, axis| |x, y, 1|).
    const float square = (across * across + along * along + axis * axis) * (x * x + y * y + 1);
    const float limit = plane.inverse * plane.inverse * (1 + match.settings.max_slant * match.settings.max_slant);
    return square <= limit;
}

// The plane of an inverse depth at a pixel, and of a normal in camera axes, of any length and away from the camera.
Plane with_normal(const Match& match, float inverse, float nx, float ny, float nz, int column, int row) {
    const float x = static_cast<float>((column - match.center[0]) / match.focal[0]);
    const float y = static_cast<float>((row - match.center[1]) / match.focal[1]);
    const float toward = nx * x + ny * y + nz;  // above 0 by how the callers choose it
    const float scale = inverse / toward;
    return {inverse, nx * scale / static_cast<float>(match.focal[0]), ny * scale / static_cast<float>(match.focal[1])};
}

// A plane of an inverse depth at a pixel whose normal is another plane's, changed by up to `tilt` of its length.
Plane tilted(const Match& match, const Plane& plane, float inverse, float tilt, Random& random, int column, int row) {
    const float x = static_cast<float>((column - match.center[0]) / match.focal[0]);
    const float y = static_cast<float>((row - match.center[1]) / match.focal[1]);
    float nx = plane.right * static_cast<float>(match.focal[0]);
    float ny = plane.down * static_cast<float>(match.focal[1]);
    float nz = plane.inverse - x * nx - y * ny;
    const float length = std::sqrt(nx * nx + ny * ny + nz * nz);
    nx = nx / length + tilt * random.both_sides();
    ny = ny / length + tilt * random.both_sides();
    nz = nz / length + tilt * random.both_sides();
    if (!(nx * x + ny * y + nz > 0.02f)) return plane;
    return with_normal(match, inverse, nx, ny, nz, column, row);
}

Plane random_slant(const Match& match, float inverse, Random& random, int column, int row) {
    const float x = static_cast<float>((column - match.center[0]) / match.focal[0]);
    const float y = static_cast<float>((row - match.center[1]) / match.focal[1]);
    const float length = std::sqrt(x * x + y * y + 1);
    // A point of the disc across the line of sight, as far as the greatest slant.
    float right = random.both_sides();
    float down = random.both_sides();
    const float square = right * right + down * down;
    if (square > 1) {
        right /= square;
        down /= square;
    }
    const float slant = std::min(match.settings.max_slant, 2.0f);
    right *= slant;
    down *= slant;
    // Two directions across the line of sight.
    const float ax = 1 / std::sqrt(1 + x * x);
    const float az = -x * ax;
    const float bx = -x * y;
    const float by = 1 + x * x;
    const float bz = -y;
    const float b_length = std::sqrt(bx * bx + by * by + bz * bz);
    return with_normal(match, inverse, x / length + right * ax + down * bx / b_length, y / length + down * by / b_length,
                       1 / length + right * az + down * bz / b_length, column, row);
}

// Cost of a plane at a pixel: the mean over the photographs that fit best.
//
// A plane that is where the surface is mostly fits somewhere among as many photographs as may be hidden from it: if none of
// these, two of which see it, fits as well as `bound`, the others are not asked. They are asked from `first` on, so that it
// is not always the same ones that decide.
inline float plane_cost(const Match& match, const Window& window, const Plane& plane, int column, int row, float bound,
                        std::size_t first) {
    const std::size_t pixel = static_cast<std::size_t>(row) * match.reference.width + static_cast<std::size_t>(column);
    float apart_cost = 0;
    if (match.reference.segment_planes != nullptr) {
        const float segment = match.reference.segment_planes[3 * pixel];
        const float moved_px = std::abs(plane.inverse - segment) * match.pixels_an_inverse;
        const float texture = match.settings.segment_texture * match.settings.segment_texture;
        const float plain = texture / (texture + window.variance);
        if (segment > 0) apart_cost = plain * match.settings.segment_weight * std::min(1.0f, moved_px / match.settings.segment_limit_px);
    }
    bound -= apart_cost;
    const std::size_t count = match.sources.size();
    std::array<WindowPlaces, kGroups> places;
    for (std::size_t group = 0; group * kLanes < count; ++group) {
        const Lanes* h = match.warps[group].homography;
        const Lanes* e = match.warps[group].epipole;
        const float x = static_cast<float>(column);
        const float y = static_cast<float>(row);
        const Lanes z = h[6] * x + h[7] * y + h[8] + e[2] * plane.inverse;
        const Lanes z_right = h[6] + e[2] * plane.right;
        const Lanes z_down = h[7] + e[2] * plane.down;
        const Lanes inverse = 1 / z;
        WindowPlaces& to = places[group];
        to.u = (h[0] * x + h[1] * y + h[2] + e[0] * plane.inverse) * inverse;
        to.v = (h[3] * x + h[4] * y + h[5] + e[1] * plane.inverse) * inverse;
        to.u_right = (h[0] + e[0] * plane.right - to.u * z_right) * inverse;
        to.u_down = (h[1] + e[0] * plane.down - to.u * z_down) * inverse;
        to.v_right = (h[3] + e[1] * plane.right - to.v * z_right) * inverse;
        to.v_down = (h[4] + e[1] * plane.down - to.v * z_down) * inverse;
        const Lanes change = (z_right > 0 ? z_right : -z_right) + (z_down > 0 ? z_down : -z_down);
        to.depth = z - match.pattern.reach_px * change > 0.2f * z ? z : Lanes{};
    }
    const std::uint8_t* own_tint = match.reference.tint + 3 * pixel;
    std::array<float, kMaxSources> best;
    const std::size_t wanted = std::min(count, static_cast<std::size_t>(match.settings.best_sources));
    const std::size_t enough = count - wanted;
    best.fill(2 * kWorstCost);
    int open = 0;
    std::size_t seeing = 0;
    for (std::size_t n = 0; n < count; ++n) {
        const std::size_t k = first + n < count ? first + n : first + n - count;
        const WindowPlaces& to = places[k / kLanes];
        const std::size_t lane = k % kLanes;
        const MatchSource& source = match.sources[k];
        float cost = window_cost(match.pattern, window, match.pictures[k], to, lane, own_tint, source.tint);
        if (cost < kWorstCost) ++seeing;
        if (source.open != nullptr && cost < kWorstCost) {
            const int at = static_cast<int>(to.v[lane] + 0.5f) * source.width + static_cast<int>(to.u[lane] + 0.5f);
            if (source.open[at] != 0) {
                ++open;
                cost = kWorstCost;
            }
        }
        if (source.depth_m != nullptr && cost < kWorstCost && cost < best[wanted - 1]) {
            cost += match.settings.geometric_weight *
                    disagreement_px(source, to.u[lane], to.v[lane], column, row, match.settings.geometric_limit_px);
        }
        for (std::size_t i = 0; i < wanted; ++i) {
            const float low = std::min(best[i], cost);
            cost = std::max(best[i], cost);
            best[i] = low;
        }
        const bool asked = enough > 0 && n + 1 >= enough && seeing >= std::min(enough, kMinSeeing);
        if (asked && best[0] >= bound) return 2 * kWorstCost;
    }
    // A plane outside a photograph is no evidence against it; one photograph alone is too little evidence for it.
    const std::size_t counted = std::clamp(seeing, std::min(wanted, kMinSeeing), wanted);
    float sum = 0;
    for (std::size_t i = 0; i < counted; ++i) sum += best[i];
    return sum / static_cast<float>(counted) + apart_cost + match.settings.open_weight * static_cast<float>(open);
}

inline bool same(const Match& match, const Plane& one, const Plane& other) {
    const float scale = match.pixels_an_inverse;
    const float reach = match.pattern.reach_px;
    return std::abs(one.inverse - other.inverse) * scale < kSamePlane &&
           std::abs(one.right - other.right) * scale * reach < kSamePlane &&
           std::abs(one.down - other.down) * scale * reach < kSamePlane;
}

inline Plane load(const float* planes, std::size_t pixel) {
    return {planes[3 * pixel], planes[3 * pixel + 1], planes[3 * pixel + 2]};
}

inline void store(float* planes, std::size_t pixel, const Plane& plane) {
    planes[3 * pixel] = plane.inverse;
    planes[3 * pixel + 1] = plane.right;
    planes[3 * pixel + 2] = plane.down;
}

// Give every pixel of a row a plane and its cost.
USDFOLIAGE_VECTOR_CLONES
void start_row(const Match& match, int row, float* planes, float* cost) {
    const MatchReference& photo = match.reference;
    for (int column = 0; column < photo.width; ++column) {
        const std::size_t pixel = static_cast<std::size_t>(row) * photo.width + column;
        if (photo.mask != nullptr && photo.mask[pixel] == 0) {
            store(planes, pixel, {0, 0, 0});
            cost[pixel] = kWorstCost;
            continue;
        }
        Plane plane = load(planes, pixel);
        if (!usable(match, plane, column, row)) {
            Random random(match.settings.seed, pixel, 0);
            const float range = match.settings.nearest_inverse - match.settings.farthest_inverse;
            plane = random_slant(match, match.settings.farthest_inverse + range * random.uniform(), random, column, row);
            if (!usable(match, plane, column, row)) {
                plane = {match.settings.farthest_inverse + range * random.uniform(), 0, 0};
            }
            store(planes, pixel, plane);
        }
        Window window;
        cut_window(match.pattern, photo.srgb, photo.width, photo.height, column, row, window);
        cost[pixel] = plane_cost(match, window, plane, column, row, 2 * kWorstCost, 0);
    }
}

// Improve half of the pixels of a row by the planes of the other half and by chance.
USDFOLIAGE_VECTOR_CLONES
void improve_row(const Match& match, int row, int half, int iteration, float* planes, float* cost) {
    const MatchReference& photo = match.reference;
    const PatchMatchSettings& settings = match.settings;
    const float range = settings.nearest_inverse - settings.farthest_inverse;
    const bool settled = match.sources.front().depth_m != nullptr;  // most planes are found: what is left is to be finer
    for (int column = (row + half) & 1; column < photo.width; column += 2) {
        const std::size_t pixel = static_cast<std::size_t>(row) * photo.width + column;
        if (photo.mask != nullptr && photo.mask[pixel] == 0) continue;
        Window window;
        cut_window(match.pattern, photo.srgb, photo.width, photo.height, column, row, window);
        Plane best = load(planes, pixel);
        float lowest = cost[pixel];

        const auto attempt = [&](const Plane& plane, std::size_t first) {
            const float its = plane_cost(match, window, plane, column, row, lowest, first);
            if (its < lowest) {
                lowest = its;
                best = plane;
            }
        };

        std::array<Plane, kRegions + 1> tried;
        std::size_t tries = 0;
        tried[tries++] = best;
        for (int region = 0; region < kRegions; ++region) {
            if (settled && region >= 4 && region - 4 != ((column / 2 + row + iteration) & 3)) continue;  // by turns
            const int places = region < 4 ? kNearPlaces : kFarPlaces;
            std::size_t chosen = pixel;
            float chosen_cost = kWorstCost;
            for (int k = 0; k < places; ++k) {
                const Place place = place_of(region, k);
                const int x = column + place.right;
                const int y = row + place.down;
                if (x < 0 || y < 0 || x >= photo.width || y >= photo.height) continue;
                const std::size_t other = static_cast<std::size_t>(y) * photo.width + x;
                if (cost[other] < chosen_cost) {
                    chosen_cost = cost[other];
                    chosen = other;
                }
            }
            if (chosen == pixel) continue;
            Plane plane = load(planes, chosen);
            const int x = static_cast<int>(chosen % static_cast<std::size_t>(photo.width));
            const int y = static_cast<int>(chosen / static_cast<std::size_t>(photo.width));
            plane.inverse += plane.right * static_cast<float>(column - x) + plane.down * static_cast<float>(row - y);
            if (!usable(match, plane, column, row)) continue;
            bool known = false;
            for (std::size_t i = 0; i < tries; ++i) known = known || same(match, plane, tried[i]);
            if (known) continue;
            tried[tries++] = plane;
            attempt(plane, tries % match.sources.size());
        }

        // The plane of its segment, and what other photographs suggest.
        const auto suggest = [&](const Plane& plane) {
            if (usable(match, plane, column, row) && !same(match, plane, best)) attempt(plane, 0);
        };
        if (photo.segment_planes != nullptr) suggest(load(photo.segment_planes, pixel));
        for (int layer = 0; layer < photo.proposal_layers && iteration < kProposedIterations; ++layer) {
            const std::size_t pixels = static_cast<std::size_t>(photo.width) * photo.height;
            suggest(load(photo.proposals, static_cast<std::size_t>(layer) * pixels + pixel));
        }

        // By chance: anywhere, and around the best with steps that shrink from one iteration to the next.
        Random random(settings.seed, pixel, iteration + 1);
        const float step = settings.step * range * std::pow(0.5f, static_cast<float>(iteration));
        const float tilt = 0.5f * std::pow(0.6f, static_cast<float>(iteration));
        for (int k = 0; k < 5; ++k) {
            if (settled && (k < 2 || k == 3)) continue;
            Plane plane = best;
            switch (k) {
                case 0:
                    plane = random_slant(match, settings.farthest_inverse + range * random.uniform(), random, column, row);
                    break;
                case 1: plane = random_slant(match, best.inverse, random, column, row); break;
                case 2: plane.inverse += step * random.both_sides(); break;
                case 3: plane = tilted(match, best, best.inverse, tilt, random, column, row); break;
                default:
                    plane = tilted(match, best, best.inverse + 0.25f * step * random.both_sides(), 0.3f * tilt, random,
                                   column, row);
                    break;
            }
            if (!usable(match, plane, column, row)) continue;
            attempt(plane, (pixel + static_cast<std::size_t>(iteration + k)) % match.sources.size());
        }
        store(planes, pixel, best);
        cost[pixel] = lowest;
    }
}

// How far the middle of the picture moves in the most moving photograph over the range of inverse depth.
float movement_px(const MatchReference& reference, const std::vector<MatchSource>& sources, const PatchMatchSettings& settings) {
    double max_px = 0;
    const double u = 0.5 * reference.width;
    const double v = 0.5 * reference.height;
    for (const MatchSource& source : sources) {
        double at[2][2];
        const double inverse[2] = {settings.nearest_inverse, settings.farthest_inverse};
        bool ahead = true;
        for (int k = 0; k < 2; ++k) {
            double seen[3];
            for (int i = 0; i < 3; ++i) {
                const double* h = source.homography + 3 * i;
                seen[i] = h[0] * u + h[1] * v + h[2] + source.epipole[i] * inverse[k];
            }
            ahead = ahead && seen[2] > 0;
            at[k][0] = seen[0] / seen[2];
            at[k][1] = seen[1] / seen[2];
        }
        if (ahead) max_px = std::max(max_px, std::hypot(at[0][0] - at[1][0], at[0][1] - at[1][1]));
    }
    return static_cast<float>(std::max(max_px, 1.0));
}

}  // namespace

void match_planes(const MatchReference& reference, const std::vector<MatchSource>& sources, const int* offsets,
                  std::size_t samples, const PatchMatchSettings& settings, int threads, float* planes, float* cost) {
    assert(!sources.empty() && sources.size() <= kMaxSources && samples >= 1 && samples <= kMaxSamples);
    std::vector<PackedPicture> pictures;
    for (const MatchSource& source : sources) pictures.emplace_back(source.gray, source.width, source.height);
    const WindowPattern pattern(offsets, samples, settings);
    const double* k = reference.pixel_from_ray;
    const float range = settings.nearest_inverse - settings.farthest_inverse;
    Match match{reference, sources, pictures, pattern, settings, {k[0], k[4]}, {k[2], k[5]}, {},
                movement_px(reference, sources, settings) / range};
    for (std::size_t n = 0; n < kGroups * kLanes; ++n) {
        // Lanes without a photograph repeat the first one, and are not looked at.
        const MatchSource& source = sources[n < sources.size() ? n : 0];
        Warps& warps = match.warps[n / kLanes];
        for (std::size_t i = 0; i < 9; ++i) warps.homography[i][n % kLanes] = static_cast<float>(source.homography[i]);
        for (std::size_t i = 0; i < 3; ++i) warps.epipole[i][n % kLanes] = static_cast<float>(source.epipole[i]);
    }

    const auto rows = static_cast<std::size_t>(reference.height);
    parallel_for(rows, threads, [&](std::size_t row) { start_row(match, static_cast<int>(row), planes, cost); });
    for (int iteration = 0; iteration < settings.iterations; ++iteration) {
        for (int half = 0; half < 2; ++half) {
            parallel_for(rows, threads,
                         [&](std::size_t row) { improve_row(match, static_cast<int>(row), half, iteration, planes, cost); });
        }
    }
}

}  // namespace usdfoliage
