// Copyright 2026 tp_controller contributors
// SPDX-License-Identifier: Apache-2.0

// Support polygon that the centre of mass stays above.
// Reference: tp_controller/tasks/com_polygon.py

#pragma once

#include "bounded_task.h"
#include "support_polygon.h"

namespace {

// Points of frames, each with its frame, and the horizontal axes.
struct Contacts {
  std::vector<int> frames;
  std::vector<double> points;
  double horizontal[6];
};

class ComPolygonTask : public BoundedTask {
 public:
  ComPolygonTask(Law law, ValueBounds bounds, Kept history, Contacts contacts)
      : BoundedTask(std::move(law), std::move(bounds), history), contacts_(std::move(contacts)),
        places_(contacts_.points.size()), shadows_(2 * contacts_.frames.size()) {}

  bool fits(const Motion &motion) const override {
    return BoundedTask::fits(motion)
        && *std::max_element(contacts_.frames.begin(), contacts_.frames.end())
            < int(motion.frames.size());
  }

  const std::vector<double> *keys() const override { return &keys_; }

  bool evaluate(const Situation &at, const Rows &out) override {
    Motion &motion = *at.motion;
    double *J = motion.jacobians(), center[3], seen[2];
    motion.center_of_mass(center, J);
    project(center, seen);
    for (size_t i = 0; i < contacts_.frames.size(); ++i) place(motion, i);
    polygon_.find(shadows_, seen);
    keys_.clear();
    for (const Edge &edge : polygon_.edges) {
      double *row = out.J + keys_.size() * size_t(motion.n);
      observe(motion, edge, J, row);
      keys_.push_back(key(edge));
    }
    bound(at, out);
    return true;
  }

 protected:
  // The last column has the key of the row.
  size_t width(const Motion &motion) const override { return size_t(motion.n) + 1; }

 private:
  int count() const { return most_rows(); }

  // The first end of an edge has a row of the history.
  double key(const Edge &edge) const {
    return edge.first * 2 * count() + edge.last + (polygon_.flat ? count() : 0);
  }

  void project(const double *point, double *shadow) const {
    for (int i = 0; i < 2; ++i) shadow[i] = dot(contacts_.horizontal + 3 * i, point);
  }

  void place(const Motion &motion, size_t i) {
    const Placement its = motion.placement(contacts_.frames[i]);
    double *point = &places_[3 * i];
    apply(its.R, &contacts_.points[3 * i], point);
    for (int k = 0; k < 3; ++k) point[k] += its.p[k];
    project(point, &shadows_[2 * i]);
  }

  // The row of an edge; `J` (3, n): that of the centre of mass.
  void observe(Motion &motion, const Edge &edge, const double *J, double *row) const {
    double normal[3];
    for (int k = 0; k < 3; ++k)
      normal[k] = edge.normal[0] * contacts_.horizontal[k]
          + edge.normal[1] * contacts_.horizontal[3 + k];
    std::fill(row, row + motion.n, 0.0);
    add(1.0, normal, J, motion.n, row);
    add_contact(motion, edge.first, edge.share - 1.0, normal, row);
    add_contact(motion, edge.last, -edge.share, normal, row);
  }

  void add_contact(Motion &motion, int i, double share, const double *normal, double *row) const {
    double *J = motion.jacobians() + 6 * size_t(motion.n);
    motion.jacobian(contacts_.frames[size_t(i)], &places_[3 * size_t(i)], J);
    add(share, normal, J, motion.n, row);
  }

  // Add a share of nᵀ J.
  static void add(double share, const double *normal, const double *J, int n, double *row) {
    for (int c = 0; c < n; ++c)
      row[c] += share * (normal[0] * J[c] + normal[1] * J[n + c] + normal[2] * J[2 * n + c]);
  }

  void bound(const Situation &at, const Rows &out) {
    const size_t n = size_t(at.motion->n);
    noted_.assign(size_t(count()) * (n + 1), -1.0);
    for (size_t i = 0; i < keys_.size(); ++i) {
      double *its = &noted_[size_t(polygon_.edges[i].first) * (n + 1)];
      std::copy(out.J + i * n, out.J + (i + 1) * n, its);
      its[n] = keys_[i];
    }
    const double *history = note(at, noted_.data());
    for (size_t i = 0; i < keys_.size(); ++i) {
      const Edge &edge = polygon_.edges[i];
      const double *before = history + size_t(edge.first) * (n + 1);
      BoundedTask::bound(at, int(i), edge.distance, 0.0,
                         before[n] == keys_[i] ? before : out.J + i * n, out);
    }
  }

  const Contacts contacts_;
  SupportPolygon polygon_;
  std::vector<double> places_, shadows_, keys_, noted_;
};

}  // namespace
