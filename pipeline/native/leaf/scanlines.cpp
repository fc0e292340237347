#include "leaf/scanlines.h"

#include <algorithm>
#include <cmath>

namespace usdfoliage {
namespace {

constexpr int kFootSteps = 12;
constexpr double kFootExact = 1e-9;
constexpr double kFewest = 4.0;     // points, from which the silhouette is guessed
constexpr double kMaxRatio = 2.0;  // of two half widths within one strip; near base and apex they have none

// v of the foot of the perpendicular from a point to the axis, seen from above.
double axis_foot(const double* leaf, const double* point, double v) {
    for (int step = 0; step < kFootSteps; ++step) {
        const AxisAt at = axis_at(leaf, v);
        const double x = point[0] - at.point[0], y = point[1] - at.point[1];
        const double speed = at.slope[0] * at.slope[0] + at.slope[1] * at.slope[1];
        const double bent = speed - x * at.bend[0] - y * at.bend[1];
        const double change = (x * at.slope[0] + y * at.slope[1]) / (bent > 0.25 * speed ? bent : speed);
        const double next = std::clamp(v + change, -0.5, 1.5);
        const bool there = std::abs(next - v) <= kFootExact;
        v = next;
        if (there) break;
    }
    return v;
}

// Distance from a point inside the ellipse to it, in a direction of unit length; 0 from outside.
double ellipse_distance(const LeafEllipse& ellipse, const double* from, double x, double y) {
    const double px = from[0] / ellipse.half_width, py = (from[1] - 0.5) / ellipse.half_length;
    const double dx = x / ellipse.half_width, dy = y / ellipse.half_length;
    const double a = dx * dx + dy * dy, b = px * dx + py * dy, c = px * px + py * py - 1;
    return c < 0 ? (-b + std::sqrt(b * b - a * c)) / a : 0.0;
}

}  // namespace

double half_width_at(const double* leaf, const LeafCurves& curves, double v) {
    const AxisFrame frame = axis_frame(axis_at(leaf, v));
    const LeafRow row = leaf_row(curves, along_at(v));
    return row.step[0] * frame.normal[0] + row.step[1] * frame.normal[1];
}

void map_points(const double* leaf, const LeafEllipse& ellipse, const double* points, const std::vector<unsigned char>& kept,
                std::vector<Mapped>* mapped, std::vector<Scanline>* scanlines) {
    const std::size_t n = mapped->size(), lines = scanlines->size();
    const LeafCurves curves = leaf_curves(leaf);
    std::vector<double> width(lines);
    for (std::size_t j = 0; j < lines; ++j) {
        (*scanlines)[j] = {scanline_place(j, lines), {0, 0}, {0, 0}, {0, 0}, {0, 0}, {0, 0}};
        width[j] = half_width_at(leaf, curves, (*scanlines)[j].v);
    }
    for (std::size_t i = 0; i < n; ++i) {
        Mapped& place = (*mapped)[i];
        const double* point = points + 3 * i;
        place.v = axis_foot(leaf, point, place.v);
        const AxisAt at = axis_at(leaf, place.v);
        const AxisFrame frame = axis_frame(at);
        double distance = (point[0] - at.point[0]) * frame.normal[0] + (point[1] - at.point[1]) * frame.normal[1];
        if (!(place.v >= 0 && place.v <= 1)) {
            place.line = -1;
            place.u = distance;
            continue;
        }
        const std::size_t line = std::min(static_cast<std::size_t>(place.v * static_cast<double>(lines)), lines - 1);
        place.line = static_cast<int>(line);
        const double here = half_width_at(leaf, curves, place.v);
        if (here > 0 && width[line] > 0) distance *= std::clamp(width[line] / here, 1 / kMaxRatio, kMaxRatio);
        place.u = distance;
        if (!kept[i]) continue;
        double& reach = (*scanlines)[line].reach[distance < 0];
        reach = std::max(reach, std::abs(distance));
        (*scanlines)[line].points[distance < 0] += 1;
    }
    for (Scanline& scanline : *scanlines) {
        const AxisAt at = axis_at(leaf, scanline.v);
        const AxisFrame frame = axis_frame(at);
        for (int side = 0; side < 2; ++side) {
            const double sign = side == 0 ? 1.0 : -1.0;
            if (scanline.points[side] > 0) scanline.reach[side] *= 1 + 1 / std::max(scanline.points[side], kFewest);
            scanline.room[side] = std::max(
                scanline.reach[side], ellipse_distance(ellipse, at.point, sign * frame.normal[0], sign * frame.normal[1]));
            scanline.weight[side] = scanline.room[side] > 0 ? scanline.reach[side] / scanline.room[side] : 0.0;  // eq. 10
        }
        const double best = std::max(scanline.weight[0], scanline.weight[1]);
        for (int side = 0; side < 2; ++side) {
            const double share = best > 0 ? scanline.weight[side] / best : 1.0;
            const double hidden = std::max(scanline.reach[side], best * scanline.room[side]);
            scanline.full[side] = share * scanline.reach[side] + (1 - share) * hidden;
        }
    }
    for (Mapped& place : *mapped) {
        const double side_full = place.line < 0 ? 0.0 : (*scanlines)[static_cast<std::size_t>(place.line)].full[place.u < 0];
        place.u = side_full > 0 ? std::clamp(place.u / side_full, -1.0, 1.0) : 0.0;
    }
}

}  // namespace usdfoliage
