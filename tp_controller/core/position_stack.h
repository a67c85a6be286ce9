// Copyright 2026 tp_controller contributors
// SPDX-License-Identifier: Apache-2.0

// Tasks of a stack at a configuration: errors in place of demands.
// Reference: tp_controller/positions/position_stack.py

#pragma once

#include "stack_levels.h"

namespace {

// A configuration, with the tasks evaluated there.
struct Point {
  std::vector<double> q, positions;
  std::vector<Level> levels;
  std::vector<const double *> errors;    // of each level: its demand, or the way back to its bounds
  std::vector<double> costs;
  Arena arena;                           // what levels and errors point to

  // The sum of the costs of the levels `first` to `last` − 1.
  double cost(size_t first, size_t last) const {
    double sum = 0.0;
    for (size_t l = first; l < last; ++l) sum += costs[l];
    return sum;
  }
};

// The squared norm of an error (m,) of a level, with its weights.
double cost(const Level &level, const double *error, Arena &arena) {
  if (!level.weights) return dot(error, error, level.m);
  const double *root = level.root(arena);
  double sum = 0.0;
  for (int i = 0; i < level.m; ++i) sum += root[i] * error[i] * (root[i] * error[i]);
  return sum;
}

class PositionStack {
 public:
  // `limits` of the positions.
  PositionStack(std::vector<double> lower, std::vector<double> upper)
      : lower_(std::move(lower)), upper_(std::move(upper)), still_(lower_.size(), 0.0) {}

  size_t n() const { return lower_.size(); }
  size_t nq() const { return motion_->q().size(); }
  const std::vector<Group> &groups() const { return groups_; }

  // Whether a level is made of objectives.
  bool is_objective(size_t level) const {
    const Group &group = groups_[level];
    return std::all_of(group.begin(), group.end(), [](const Task *t) { return t->is_objective(); });
  }

  void set_tasks(Motion &motion, std::vector<Group> groups) {
    motion_ = &motion;
    groups_ = std::move(groups);
  }

  // Joints, of which the first follows the base, their row in a configuration, and whether one may be
  // at a position.
  size_t first_joint() const { return size_t(motion_->first_column); }
  size_t row(size_t j) const { return size_t(motion_->first_row) + j - first_joint(); }
  bool allows(size_t j, double position) const {
    return position >= lower_[j] && position <= upper_[j];
  }
  // The number of coordinates that are the position of a base.
  size_t place_size() const { return motion_->first_row == 7 ? 3 : motion_->first_row ? 2 : 0; }

  double to_lower(const Point &point, size_t j) const { return lower_[j] - point.positions[j]; }
  double to_upper(const Point &point, size_t j) const { return upper_[j] - point.positions[j]; }

  // Evaluate the tasks at the configuration of a point.
  void evaluate(Point &point) {
    std::copy(point.q.begin(), point.q.end(), motion_->q().begin());
    double placement[7];
    motion_->move(place(point.q.data(), placement) ? placement : nullptr);
    const size_t first = size_t(motion_->first_column), row = size_t(motion_->first_row);
    point.positions.assign(n(), 0.0);
    std::copy(point.q.begin() + long(row), point.q.end(), point.positions.begin() + long(first));
    point.arena.reset();
    point.levels.clear();
    point.errors.clear();
    point.costs.clear();
    for (const Group &group : groups_) evaluate(group, point);
  }

  // The point after a change of the positions.
  void move(const Point &from, const double *step, Point &to) {
    to.q = from.q;
    if (motion_->first_row) move_base(step, to.q.data());
    const size_t first = size_t(motion_->first_column), row = size_t(motion_->first_row);
    for (size_t j = first; j < n(); ++j) {
      double &q = to.q[row + j - first];
      q = clip(q + step[j], lower_[j], upper_[j]);
    }
    evaluate(to);
  }

 private:
  void evaluate(const Group &group, Point &point) {
    evaluations_.clear();
    size_t next = 0;
    for (Task *task : group) task->begin();
    if (!join(point.arena, {motion_, point.positions.data(), still_.data(), 0.0}, group, {}, next,
              point.levels, evaluations_)) throw Unsolved();
    const Level &level = point.levels.back();
    const double *error = level.bounded ? evaluations_[0].error : level.v;
    point.errors.push_back(error);
    point.costs.push_back(is_objective(point.costs.size()) ? 0.0
                              : cost(level, error, point.arena));
  }

  // The placement of a base, x, y, z and a quaternion, from its coordinates; false where it is fixed.
  bool place(const double *q, double *placement) const {
    if (!motion_->first_row) return false;
    if (motion_->first_row == 7) {
      std::copy(q, q + 7, placement);
    } else {
      const double its[7] = {q[0], q[1], 0.0, 0.0, 0.0, std::sin(0.5 * q[2]), std::cos(0.5 * q[2])};
      std::copy(its, its + 7, placement);
    }
    return true;
  }

  // Along the arc of a constant twist in the axes of the base.
  void move_base(const double *step, double *q) const {
    double twist[6] = {}, placement[7], R[9], way[3], turned[3], twice[3];
    for (size_t i = 0; i < motion_->base.size(); ++i) twist[motion_->base[i]] = step[i];
    const double *w = twist + 3, angle = std::sqrt(dot(w, w));
    // (1 − cos θ)/θ² and (θ − sin θ)/θ³; before their last digits are lost, their series.
    const bool small = angle < SMALL_TURN;
    const double of_first = small ? 0.5 - angle * angle / 24.0 : (1.0 - std::cos(angle)) / (angle * angle);
    const double of_second = small ? 1.0 / 6.0 - angle * angle / 120.0
                                   : (angle - std::sin(angle)) / (angle * angle * angle);
    cross(w, twist, turned);
    cross(w, turned, twice);
    for (int i = 0; i < 3; ++i) way[i] = twist[i] + of_first * turned[i] + of_second * twice[i];
    place(q, placement);
    rotation_of(placement + 3, R);
    double moved[3];
    apply(R, way, moved);
    if (motion_->first_row == 3) {
      q[0] += moved[0];
      q[1] += moved[1];
      q[2] += twist[5];
      return;
    }
    for (int i = 0; i < 3; ++i) q[i] += moved[i];
    turn_base(w, angle, q + 3);
  }

  // The quaternion xyzw after a turn in its own axes.
  static void turn_base(const double *w, double angle, double *xyzw) {
    const double share = angle < SMALL_TURN ? 0.5 : std::sin(0.5 * angle) / angle;
    const double v[3] = {share * w[0], share * w[1], share * w[2]}, real = std::cos(0.5 * angle);
    double crossed[3], its[4];
    cross(xyzw, v, crossed);
    for (int i = 0; i < 3; ++i) its[i] = xyzw[3] * v[i] + real * xyzw[i] + crossed[i];
    its[3] = xyzw[3] * real - dot(xyzw, v);
    const double size = std::sqrt(dot(its, its, 4));
    for (int i = 0; i < 4; ++i) xyzw[i] = its[i] / size;
  }

  static constexpr double SMALL_TURN = 1e-4;

  const std::vector<double> lower_, upper_, still_;
  Motion *motion_ = nullptr;
  std::vector<Group> groups_;
  std::vector<Rows> evaluations_;
};

// The cost of a level after a change of the positions, if J were constant.
double linear_cost(const Level &level, const double *error, const double *step, Arena &arena) {
  Arena::Frame frame(arena);
  double *moved = arena.take(size_t(level.m));
  level.times(step, moved);
  for (int i = 0; i < level.m; ++i) {
    double left = error[i] - moved[i];
    if (level.bounded) {
      // Outside, the distance back counts, not the part of it that one step may go.
      const double lower = error[i] > 0.0 ? error[i] : level.lower[i];
      const double upper = error[i] < 0.0 ? error[i] : level.upper[i];
      left = std::min(std::max(moved[i], lower), upper) - moved[i];
    }
    moved[i] = left;
  }
  return cost(level, moved, arena);
}

}  // namespace
