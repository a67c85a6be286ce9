// Copyright 2026 tp_controller contributors
// SPDX-License-Identifier: Apache-2.0

// Frames of a robot, and their Jacobians.
// Reference: tp_controller/model/state.py

#pragma once

#include "spatial.h"

#include <cstdint>
#include <vector>

namespace {

// Constant of the reference.
constexpr double LARGEST = 1e9;

enum Kind { STILL, FREE, TURNS, SLIDES };

// A body: how it hangs on the one before, and the joint between them.
struct Body {
  Kind kind;
  int parent, column;                    // −1: no velocity moves the joint
  double share;                          // of the position in that column (mimic)
  double axis[3], R[9], p[3];
  double mass, center[3];                // the mass as a share of that of the robot
};

struct Frame {
  int body;
  double R[9], p[3];
};

struct Placement {
  double R[9], p[3];
};

class Motion {
 public:
  int n = 0, first_row = 0, first_column = 0;
  std::vector<Body> bodies;              // the first is the root
  std::vector<Frame> frames;
  std::vector<int> base;                 // rows of the twist of the base that are velocities

  void prepare() {
    const Placement still = {{1, 0, 0, 0, 1, 0, 0, 0, 1}, {0, 0, 0}};
    placed_.assign(bodies.size(), still);
    axes_.assign(3 * bodies.size(), 0.0);
    J_.assign(12 * size_t(n), 0.0);
    carried_.assign(4 * bodies.size(), 0.0);
    q_.assign(size_t(first_row + columns()), 0.0);
    offset_.assign(size_t(std::count_if(bodies.begin(), bodies.end(), [](const Body &body) {
      return body.kind == TURNS || body.kind == SLIDES;
    })), 0.0);
  }

  int columns() const { return n - first_column; }

  // Where arguments of `move` are read to.
  std::vector<double> &q() { return q_; }
  const std::vector<double> &q() const { return q_; }
  std::vector<double> &offset() { return offset_; }

  // Move to q; `offset` is what is added to the position of each joint.
  void move(const double *placement) {
    const double *driven = q_.data() + first_row;
    size_t joint = 0;
    for (size_t b = 1; b < bodies.size(); ++b) {
      const Body &body = bodies[b];
      Placement &at = placed_[b];
      if (body.kind == FREE) {
        std::copy(placement, placement + 3, at.p);
        rotation_of(placement + 3, at.R);
        continue;
      }
      const double value = offset_[joint++]
          + (body.column < 0 ? 0.0 : body.share * driven[body.column]);
      const Placement &on = placed_[body.parent];
      double R[9], turned[9], p[3];
      multiply(on.R, body.R, R);
      apply(on.R, body.p, p);
      double *axis = &axes_[3 * b];
      apply(R, body.axis, axis);
      if (body.kind == TURNS) {
        rotation_about(body.axis, value, turned);
        multiply(R, turned, at.R);
      } else {
        std::copy(R, R + 9, at.R);
      }
      for (int i = 0; i < 3; ++i)
        at.p[i] = on.p[i] + p[i] + (body.kind == SLIDES ? value * axis[i] : 0.0);
    }
  }

  Placement placement(int frame) const {
    const Frame &its = frames[frame];
    const Placement &on = placed_[its.body];
    Placement found;
    multiply(on.R, its.R, found.R);
    apply(on.R, its.p, found.p);
    for (int i = 0; i < 3; ++i) found.p[i] += on.p[i];
    return found;
  }

  // J (6, n) of a frame that is at p, in the axes of the root.
  void jacobian(int frame, const double *p, double *J) const {
    std::fill(J, J + 6 * size_t(n), 0.0);
    for (int b = frames[frame].body; b > 0; b = bodies[b].parent) add(b, p, 1.0, J);
  }

  // The centre of mass, and its Jacobian in the first three rows of J (6, n).
  void center_of_mass(double *center, double *J) {
    std::fill(J, J + 6 * size_t(n), 0.0);
    for (size_t b = 0; b < bodies.size(); ++b) {
      const Body &body = bodies[b];
      double arm[3];
      apply(placed_[b].R, body.center, arm);
      carried_[4 * b] = body.mass;
      for (int i = 0; i < 3; ++i) carried_[4 * b + 1 + i] = body.mass * (placed_[b].p[i] + arm[i]);
    }
    // A joint moves all that hangs on it.
    for (size_t b = bodies.size() - 1; b > 0; --b) {
      const double *its = &carried_[4 * b];
      for (int i = 0; i < 4; ++i) carried_[4 * bodies[b].parent + i] += its[i];
      if (its[0] == 0.0) continue;
      const double p[3] = {its[1] / its[0], its[2] / its[0], its[3] / its[0]};
      add(int(b), p, its[0], J);
    }
    std::copy(&carried_[1], &carried_[4], center);
  }

  // Memory for two Jacobians (6, n).
  double *jacobians() { return J_.data(); }

 private:
  // Add to J a share of what the joint of a body does at p.
  void add(int b, const double *p, double share, double *J) const {
    const Body &body = bodies[b];
    if (body.kind == FREE) {
      add_base(placed_[b], p, share, J);
    } else if (body.column >= 0) {
      const int column = first_column + body.column;
      const double *axis = &axes_[3 * b];
      if (body.kind == TURNS) turn(axis, placed_[b].p, p, share * body.share, J + column);
      else slide(axis, share * body.share, J + column);
    }
  }

  void turn(const double *axis, const double *at, const double *p, double share, double *J) const {
    double arm[3], v[3];
    subtract(p, at, arm);
    cross(axis, arm, v);
    for (int i = 0; i < 3; ++i) {
      J[i * n] += share * v[i];
      J[(3 + i) * n] += share * axis[i];
    }
  }

  void slide(const double *axis, double share, double *J) const {
    for (int i = 0; i < 3; ++i) J[i * n] += share * axis[i];
  }

  // The base moves and turns about axes of its own.
  void add_base(const Placement &at, const double *p, double share, double *J) const {
    for (size_t c = 0; c < base.size(); ++c) {
      const int row = base[c] % 3;
      const double axis[3] = {at.R[row], at.R[3 + row], at.R[6 + row]};
      if (base[c] < 3) slide(axis, share, J + c);
      else turn(axis, at.p, p, share, J + c);
    }
  }

  std::vector<Placement> placed_;
  std::vector<double> axes_, J_, q_, offset_, carried_;
};

}  // namespace
