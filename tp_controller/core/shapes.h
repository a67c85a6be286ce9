// Copyright 2026 tp_controller contributors
// SPDX-License-Identifier: Apache-2.0

// Shapes of regions, centred at their own origins.
// Reference: tp_controller/model/shapes.py

#pragma once

#include "spatial.h"

namespace {

// Constant of the reference.
constexpr double CENTRE_RADIUS = 1e-9;

// The distance of a point from the origin, and the direction away from it.
double from_centre(const double *point, double *direction) {
  const double distance = std::sqrt(dot(point, point));
  const bool defined = distance > CENTRE_RADIUS;
  for (int i = 0; i < 3; ++i) direction[i] = defined ? point[i] / distance : i == 0;
  return distance;
}

// The signed distance from a shape whose k sides are at right angles, and its gradient.
// `directions` (k, 3): outward normals.
double outside(int k, const double *excess, const double *directions, double *gradient) {
  double square = 0.0, beyond[3] = {};
  int nearest = 0;
  for (int i = 0; i < k; ++i) {
    beyond[i] = std::max(excess[i], 0.0);
    square += beyond[i] * beyond[i];
    if (excess[i] > excess[nearest]) nearest = i;
  }
  const double distance = std::sqrt(square);
  if (distance > CENTRE_RADIUS) {
    // Beyond an edge or a corner the nearest point is on it.
    for (int j = 0; j < 3; ++j) {
      double sum = 0.0;
      for (int i = 0; i < k; ++i) sum += beyond[i] * directions[3 * i + j];
      gradient[j] = sum / distance;
    }
    return distance;
  }
  std::copy(directions + 3 * nearest, directions + 3 * nearest + 3, gradient);
  return excess[nearest];
}

struct Shape {
  // In the order of `KINDS` of the reference.
  enum Kind { BOX, SPHERE, CYLINDER, HALF_SPACE };

  Kind kind;
  double sizes[3];

  static int size_count(int kind) {
    constexpr int counts[] = {3, 1, 2, 0};
    return counts[kind];
  }

  // Number of the values of `within`.
  int rows() const { return kind == BOX ? 3 : kind == CYLINDER ? 2 : 1; }

  // The values that are bounded if a point is inside, and their gradients (rows, 3).
  void within(const double *point, double *values, double *gradients) const {
    std::fill(gradients, gradients + 3 * rows(), 0.0);
    if (kind == SPHERE) {
      values[0] = from_centre(point, gradients);
    } else if (kind == CYLINDER) {
      const double across[3] = {point[0], point[1], 0.0};
      values[0] = from_centre(across, gradients);
      values[1] = point[2];
      gradients[5] = 1.0;
    } else if (kind == HALF_SPACE) {
      values[0] = point[2];
      gradients[2] = 1.0;
    } else {
      std::copy(point, point + 3, values);
      for (int i = 0; i < 3; ++i) gradients[4 * i] = 1.0;
    }
  }

  // The signed distance of a point from the surface, negative inside, and its gradient.
  double distance(const double *point, double *gradient) const {
    double values[3], normals[9];
    within(point, values, normals);
    if (kind == SPHERE || kind == HALF_SPACE) {
      std::copy(normals, normals + 3, gradient);
      return kind == SPHERE ? values[0] - sizes[0] : values[0];
    }
    // Both sides of a box, and both ends of a cylinder, are alike.
    for (int i = kind == BOX ? 0 : 1; i < rows(); ++i) {
      const double side = values[i] < 0.0 ? -1.0 : 1.0;
      values[i] *= side;
      for (int j = 0; j < 3; ++j) normals[3 * i + j] *= side;
    }
    for (int i = 0; i < rows(); ++i) values[i] -= sizes[i];
    return outside(rows(), values, normals, gradient);
  }
};

}  // namespace
