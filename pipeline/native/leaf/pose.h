// A leaf and where it is: from leaf space, in leaf lengths, to the world.

#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>

#include "leaf/curves.h"

namespace usdfoliage {

struct LeafPose {
    double parameters[kLeafNumbers];
    double axes[9];  // matrix with the leaf's x, y and z in the columns
    double base[3], length;
};

inline LeafPose leaf_pose(const double* parameters, const double* axes, const double* base, double length) {
    LeafPose pose;
    std::copy(parameters, parameters + kLeafNumbers, pose.parameters);
    std::copy(axes, axes + 9, pose.axes);
    std::copy(base, base + 3, pose.base);
    pose.length = length;
    return pose;
}

// A point of the world in leaf space.
inline void localize_point(const LeafPose& pose, const double* world, double* local) {
    const double x = world[0] - pose.base[0], y = world[1] - pose.base[1], z = world[2] - pose.base[2];
    for (int c = 0; c < 3; ++c) local[c] = (x * pose.axes[c] + y * pose.axes[3 + c] + z * pose.axes[6 + c]) / pose.length;
}

// The pose after a step in its leaf space.
//
// @param change  of the parameters, 21
// @param turn    about the leaf's axes, in radians
// @param shift   in leaf lengths
// @param growth  of the logarithm of the length
inline LeafPose moved_pose(const LeafPose& pose, const double* change, const double* turn, const double* shift, double growth) {
    LeafPose next = pose;
    for (std::size_t k = 0; k < kLeafNumbers; ++k) next.parameters[k] += change[k];
    const double angle = std::sqrt(turn[0] * turn[0] + turn[1] * turn[1] + turn[2] * turn[2]);
    double matrix[9] = {1, 0, 0, 0, 1, 0, 0, 0, 1};
    if (angle > 1e-15) {
        const double x = turn[0] / angle, y = turn[1] / angle, z = turn[2] / angle;
        const double s = std::sin(angle), c = std::cos(angle), t = 1 - c;
        const double turned[9] = {c + t * x * x, t * x * y - s * z, t * x * z + s * y, t * x * y + s * z, c + t * y * y,
                                  t * y * z - s * x, t * x * z - s * y, t * y * z + s * x, c + t * z * z};
        std::copy(turned, turned + 9, matrix);
    }
    for (int i = 0; i < 3; ++i) {
        const double* row = pose.axes + 3 * i;
        for (int k = 0; k < 3; ++k) next.axes[3 * i + k] = row[0] * matrix[k] + row[1] * matrix[3 + k] + row[2] * matrix[6 + k];
        next.base[i] += pose.length * (row[0] * shift[0] + row[1] * shift[1] + row[2] * shift[2]);
    }
    next.length = pose.length * std::exp(growth);
    return next;
}

}  // namespace usdfoliage
