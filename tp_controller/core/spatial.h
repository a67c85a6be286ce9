// Copyright 2026 tp_controller contributors
// SPDX-License-Identifier: Apache-2.0

// Vectors (3,), rotations (3, 3) row by row, and rotation vectors.
// Reference: tp_controller/model/spatial.py

#pragma once

#include <algorithm>
#include <cmath>

namespace {

// Constants of the reference.
constexpr double HALF_TURN_BAND = 0.1;
constexpr double SMALL_ANGLE = 1e-4;

constexpr double PI = 3.14159265358979323846;
// Half of an angle below which its sine is the angle, to the last digit.
constexpr double TINY_HALF_ANGLE = 1e-9;

inline double dot(const double *a, const double *b) {
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

inline void cross(const double *a, const double *b, double *c) {
  c[0] = a[1] * b[2] - a[2] * b[1];
  c[1] = a[2] * b[0] - a[0] * b[2];
  c[2] = a[0] * b[1] - a[1] * b[0];
}

inline void subtract(const double *a, const double *b, double *c) {
  for (int i = 0; i < 3; ++i) c[i] = a[i] - b[i];
}

// y = A x
inline void apply(const double *A, const double *x, double *y) {
  for (int i = 0; i < 3; ++i) y[i] = dot(A + 3 * i, x);
}

// y = Aᵀ x
inline void apply_transposed(const double *A, const double *x, double *y) {
  for (int i = 0; i < 3; ++i) y[i] = A[i] * x[0] + A[3 + i] * x[1] + A[6 + i] * x[2];
}

// C = A B
inline void multiply(const double *A, const double *B, double *C) {
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j)
      C[3 * i + j] = A[3 * i] * B[j] + A[3 * i + 1] * B[3 + j] + A[3 * i + 2] * B[6 + j];
}

// C = Aᵀ B
inline void multiply_transposed(const double *A, const double *B, double *C) {
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j)
      C[3 * i + j] = A[i] * B[j] + A[3 + i] * B[3 + j] + A[6 + i] * B[6 + j];
}

// The rotation by an angle about an axis of length 1 (Rodrigues).
void rotation_about(const double *a, double angle, double *R) {
  const double s = std::sin(angle), c = std::cos(angle), t = 1.0 - c;
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j) R[3 * i + j] = t * a[i] * a[j] + (i == j ? c : 0.0);
  R[1] -= s * a[2];
  R[2] += s * a[1];
  R[3] += s * a[2];
  R[5] -= s * a[0];
  R[6] -= s * a[1];
  R[7] += s * a[0];
}

void rotation_of(const double *quat_xyzw, double *R) {
  const double x = quat_xyzw[0], y = quat_xyzw[1], z = quat_xyzw[2], w = quat_xyzw[3];
  const double rows[9] = {1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - z * w), 2.0 * (x * z + y * w),
                          2.0 * (x * y + z * w), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - x * w),
                          2.0 * (x * z - y * w), 2.0 * (y * z + x * w), 1.0 - 2.0 * (x * x + y * y)};
  std::copy(rows, rows + 9, R);
}

// The rotation vector of a matrix, by its quaternion: exact for small and for half turns, too.
void rotation_vector(const double *R, double *vector) {
  const double trace = R[0] + R[4] + R[8];
  int i = 0;
  for (int k = 1; k < 3; ++k)
    if (R[4 * k] > R[4 * i]) i = k;
  double w, v[3];
  // Four times the largest component of the quaternion, squared, is at least 1.
  if (trace > R[4 * i]) {
    w = 1.0 + trace;
    v[0] = R[7] - R[5];
    v[1] = R[2] - R[6];
    v[2] = R[3] - R[1];
  } else {
    const int j = (i + 1) % 3, k = (i + 2) % 3;
    w = R[3 * k + j] - R[3 * j + k];
    v[i] = 1.0 + R[4 * i] - R[4 * j] - R[4 * k];
    v[j] = R[3 * i + j] + R[3 * j + i];
    v[k] = R[3 * i + k] + R[3 * k + i];
  }
  const double size = std::sqrt(dot(v, v)), sign = w < 0.0 ? -1.0 : 1.0;
  const double share = size > TINY_HALF_ANGLE * std::fabs(w) ? 2.0 * std::atan2(size, std::fabs(w)) / size
                                                  : 2.0 / std::fabs(w);
  for (int k = 0; k < 3; ++k) vector[k] = sign * share * v[k];
}

// The matrix from an angular velocity to the rate of a rotation vector.
void vector_rate_matrix(const double *r, double *L) {
  const double square = dot(r, r), angle = std::sqrt(square), half = 0.5 * angle;
  const double share = angle > SMALL_ANGLE ? (1.0 - half / std::tan(half)) / square : 1.0 / 12.0;
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j)
      L[3 * i + j] = share * r[i] * r[j] + (i == j ? 1.0 - share * square : 0.0);
  L[1] += 0.5 * r[2];
  L[2] -= 0.5 * r[1];
  L[3] -= 0.5 * r[2];
  L[5] += 0.5 * r[0];
  L[6] += 0.5 * r[1];
  L[7] -= 0.5 * r[0];
}

// In place.
void shorter_rotation(const double *previous, double *vector) {
  if (dot(vector, previous) >= 0.0) return;
  const double angle = std::sqrt(dot(vector, vector));
  if (angle < PI - HALF_TURN_BAND) return;
  for (int i = 0; i < 3; ++i) vector[i] *= (angle - 2.0 * PI) / angle;
}

}  // namespace
