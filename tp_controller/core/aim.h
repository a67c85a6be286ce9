// Copyright 2026 tp_controller contributors
// SPDX-License-Identifier: Apache-2.0

// Turns of an axis of a frame, and the kinds of goals that it takes.
// Reference: tp_controller/tasks/aim.py

#pragma once

#include "task.h"

namespace {

// Constants of the reference.
constexpr double MIN_POINT_DISTANCE = 0.01;
constexpr double MIN_VECTOR_LENGTH = 1e-6;

// The rotation vector of the shortest turn from one unit vector to another.
void turn_between(const double *start, const double *end, double *turn) {
  cross(start, end, turn);
  const double sine = std::sqrt(dot(turn, turn)), cosine = dot(start, end);
  double share = 1.0;
  if (sine > MIN_VECTOR_LENGTH) {
    share = std::atan2(sine, cosine) / sine;
  } else if (cosine <= 0.0) {
    // Half a turn, about an axis at right angles (`across`).
    double other[3] = {};
    int least = 0;
    for (int i = 1; i < 3; ++i)
      if (std::fabs(start[i]) < std::fabs(start[least])) least = i;
    other[least] = 1.0;
    cross(start, other, turn);
    share = PI / std::sqrt(dot(turn, turn));
  }
  for (int i = 0; i < 3; ++i) turn[i] *= share;
}

// A direction or a point that belongs to a reference frame.
struct Aim {
  bool is_point;
  int reference;                         // −1: the root
  double goal[3];
};

// What a frame sees of the goal (`Aim.sight`, `Aim.turning`).
class Sight {
 public:
  double direction[3];

  // The frame is at p, with J (6, n).
  Sight(const Aim &aim, Motion &motion, const double *p, const double *J)
      : is_point_(aim.is_point), moves_(aim.reference >= 0), n_(motion.n), J_(J),
        J_reference_(motion.jacobians() + 6 * size_t(n_)) {
    if (moves_) {
      from_ = motion.placement(aim.reference);
      motion.jacobian(aim.reference, from_.p, motion.jacobians() + 6 * size_t(n_));
    }
    apply(from_.R, aim.goal, offset_);
    std::copy(offset_, offset_ + 3, direction);
    if (!is_point_) return;
    double line[3];
    for (int i = 0; i < 3; ++i) line[i] = from_.p[i] + offset_[i] - p[i];
    const double distance = std::sqrt(dot(line, line));
    for (int i = 0; i < 3; ++i) {
      // The direction to a coincident point is arbitrary.
      direction[i] = distance < MIN_VECTOR_LENGTH ? i == 2 : line[i] / distance;
      nearness_[i] = direction[i] / std::max(distance, MIN_POINT_DISTANCE);
    }
  }

  // The angular velocity of the direction in a column of J.
  void turning(int c, double *w) const {
    double v[3] = {}, of[3] = {}, carried[3] = {};
    if (moves_) {
      column(J_reference_, c, v);
      column(J_reference_ + 3 * size_t(n_), c, of);
    }
    if (!is_point_) {
      std::copy(of, of + 3, w);
      return;
    }
    cross(of, offset_, carried);
    for (int i = 0; i < 3; ++i) v[i] += carried[i] - J_[size_t(i) * n_ + c];
    cross(nearness_, v, w);
  }

  // The same due to a twist of the goal.
  void turning(const double *twist, double *w) const {
    if (!is_point_) return apply(from_.R, twist + 3, w);
    double v[3];
    apply(from_.R, twist, v);
    cross(nearness_, v, w);
  }

 private:
  void column(const double *rows, int c, double *found) const {
    for (int i = 0; i < 3; ++i) found[i] = rows[size_t(i) * n_ + c];
  }

  bool is_point_, moves_;
  int n_;
  const double *J_, *J_reference_;
  Placement from_ = {{1, 0, 0, 0, 1, 0, 0, 0, 1}, {0, 0, 0}};
  double offset_[3], nearness_[3];       // the direction per distance
};

}  // namespace
