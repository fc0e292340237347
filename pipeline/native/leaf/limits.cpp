#include "leaf/limits.h"

namespace usdfoliage {

LeafLimits leaf_limits(double half_width) {
    LeafLimits limits;
    const auto set = [&](int number, double low, double high) {
        limits.low[number] = low;
        limits.high[number] = high;
    };
    for (int k = 0; k < 2; ++k) {
        set(3 * k, -0.5, 0.5);
        set(3 * k + 1, k == 0 ? 0.1 : 0.4, k == 0 ? 0.6 : 0.9);
        set(3 * k + 2, -1.5, 1.5);
    }
    for (int i = 0; i < 3; ++i) {
        set(6 + 3 * i, 0.25 * i + 0.05, 0.25 * i + 0.45);
        set(7 + 3 * i, 0.0, 4 * half_width);
        set(8 + 3 * i, -1.5, 1.5);
        set(15 + i, -1.5, 1.5);
        set(18 + i, -1.5, 1.5);
    }
    return limits;
}

bool silhouette_in_order(const double* leaf) {
    return leaf[1] < leaf[4] && leaf[6] < leaf[9] && leaf[9] < leaf[12];
}

}  // namespace usdfoliage
