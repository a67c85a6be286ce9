// Copyright 2026 tp_controller contributors
// SPDX-License-Identifier: Apache-2.0

// Regions that frames stay inside or outside of.
// Reference: tp_controller/tasks/region.py

#pragma once

#include "bounded_task.h"
#include "frame_task.h"
#include "shapes.h"

namespace {

// A frame that stays inside or outside of a shape, which has a place in the reference frame.
struct Region {
  int frame, reference;
  bool inside;
  Shape shape;
  double R[9], p[3];

  int rows() const { return inside ? shape.rows() : 1; }
};

class RegionTask : public BoundedTask {
 public:
  RegionTask(Law law, ValueBounds bounds, Kept history, const Region &region)
      : BoundedTask(std::move(law), std::move(bounds), history), region_(region) {}

  bool fits(const Motion &motion) const override {
    return BoundedTask::fits(motion)
        && std::max(region_.frame, region_.reference) < int(motion.frames.size());
  }

  bool evaluate(const Situation &at, const Rows &out) override {
    const bool moves = !law_.feed_forward.empty();
    if (moves && !law_.feeds(at.now)) return false;
    const int n = at.motion->n;
    double *J = at.motion->jacobians();
    const Placement its = placed(*at.motion, region_.frame, region_.reference, J);
    double offset[3], point[3], values[3], gradients[9], normal[3], motion[3] = {};
    subtract(its.p, region_.p, offset);
    apply_transposed(region_.R, offset, point);
    if (region_.inside) region_.shape.within(point, values, gradients);
    else values[0] = region_.shape.distance(point, gradients);
    for (int i = 0; i < rows(); ++i) {
      apply(region_.R, gradients + 3 * i, normal);
      for (int c = 0; c < n; ++c)
        out.J[i * n + c] = normal[0] * J[c] + normal[1] * J[n + c] + normal[2] * J[2 * n + c];
      if (moves) motion[i] = own_motion(normal, offset);
    }
    bound(at, values, motion, out);
    return true;
  }

 private:
  // The velocity of a value due to the motion of the shape.
  double own_motion(const double *normal, const double *offset) const {
    const double *twist = law_.feed_forward.data();
    double v[3];
    cross(twist + 3, offset, v);
    for (int i = 0; i < 3; ++i) v[i] += twist[i];
    return -dot(normal, v);
  }

  Region region_;
};

}  // namespace
