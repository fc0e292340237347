// Small symmetric matrices: principal axes, linear equations. Eigen was measured in their place: it gives other bits in
// nearly every solve and is no faster at these sizes, so results would change for nothing.

#pragma once

#include <cmath>
#include <utility>

namespace usdfoliage {

// Principal axes of a symmetric 3 x 3 matrix, the largest value first; vectors[k] belongs to values[k]. Jacobi's rotations.
inline void principal_axes_3(double matrix[3][3], double values[3], double vectors[3][3]) {
    for (int i = 0; i < 3; ++i)
        for (int k = 0; k < 3; ++k) vectors[i][k] = i == k ? 1.0 : 0.0;
    constexpr int kSweeps = 32;
    for (int sweep = 0; sweep < kSweeps; ++sweep) {
        const double off = std::abs(matrix[0][1]) + std::abs(matrix[0][2]) + std::abs(matrix[1][2]);
        const double trace = std::abs(matrix[0][0]) + std::abs(matrix[1][1]) + std::abs(matrix[2][2]);
        if (!(off > 1e-16 * trace)) break;
        for (int p = 0; p < 2; ++p) {
            for (int q = p + 1; q < 3; ++q) {
                if (matrix[p][q] == 0) continue;
                const double ratio = (matrix[q][q] - matrix[p][p]) / (2 * matrix[p][q]);
                const double t = (ratio >= 0 ? 1.0 : -1.0) / (std::abs(ratio) + std::sqrt(ratio * ratio + 1));
                const double c = 1 / std::sqrt(t * t + 1), s = t * c;
                for (int k = 0; k < 3; ++k) {
                    const double a = matrix[k][p], b = matrix[k][q];
                    matrix[k][p] = c * a - s * b;
                    matrix[k][q] = s * a + c * b;
                }
                for (int k = 0; k < 3; ++k) {
                    const double a = matrix[p][k], b = matrix[q][k];
                    matrix[p][k] = c * a - s * b;
                    matrix[q][k] = s * a + c * b;
                }
                for (int k = 0; k < 3; ++k) {
                    const double a = vectors[p][k], b = vectors[q][k];
                    vectors[p][k] = c * a - s * b;
                    vectors[q][k] = s * a + c * b;
                }
            }
        }
    }
    for (int i = 0; i < 3; ++i) values[i] = matrix[i][i];
    for (int i = 0; i < 2; ++i) {
        for (int k = 0; k < 2 - i; ++k) {
            if (values[k] >= values[k + 1]) continue;
            std::swap(values[k], values[k + 1]);
            for (int c = 0; c < 3; ++c) std::swap(vectors[k][c], vectors[k + 1][c]);
        }
    }
}

// Solve a symmetric positive definite system by Cholesky's factors, in place: right becomes the solution.
//
// @return  false where the matrix is not positive definite
template <int N>
bool solve_positive(double (&matrix)[N][N], double (&right)[N]) {
    // Column by column, so that the numbers of a row do not wait for each other.
    for (int m = 0; m < N; ++m) {
        if (!(matrix[m][m] > 0)) return false;
        const double pivot = matrix[m][m] = std::sqrt(matrix[m][m]);
        double column[N];
        for (int i = m + 1; i < N; ++i) column[i] = matrix[i][m] = matrix[i][m] / pivot;
        for (int i = m + 1; i < N; ++i)
            for (int k = m + 1; k <= i; ++k) matrix[i][k] -= column[i] * column[k];
    }
    for (int i = 0; i < N; ++i) {
        for (int m = 0; m < i; ++m) right[i] -= matrix[i][m] * right[m];
        right[i] /= matrix[i][i];
    }
    for (int i = N; i-- > 0;) {
        for (int m = i + 1; m < N; ++m) right[i] -= matrix[m][i] * right[m];
        right[i] /= matrix[i][i];
    }
    return true;
}

}  // namespace usdfoliage
