// Copyright 2026 tp_controller contributors
// SPDX-License-Identifier: Apache-2.0

// A task: error, Jacobian, and the control law from error to velocity.
// Reference: tp_controller/tasks/task.py

#pragma once

#include "kinematics.h"

namespace {

// State of the robot in a cycle.
struct Situation {
  Motion *motion;
  const double *positions, *velocity;    // velocity: commanded since the cycle before
  double now;
};

// Where a task writes its rows; a demand has v, bounds have lower and upper. J is not written
// where it is the identity.
struct Rows {
  double *error, *J, *v, *lower, *upper;
};

// The part of the demand that all types of tasks have.
struct Law {
  int rows = 0;
  bool scale = false;
  std::vector<double> gain;              // one for each row
  std::vector<double> feed_forward;      // one for each row, or a twist; none where empty
  double fed = 0.0, timeout = 0.0;       // time of arrival of the feed-forward velocity
  std::vector<double> joints, weights;   // see `Level`; none where empty

  // v = K error + feed-forward, here in rows; false where that has timed out: the reference drops it.
  bool demand(double now, const double *error, const double *added, double *v) const {
    for (int i = 0; i < rows; ++i) v[i] = gain[i] * error[i];
    if (feed_forward.empty()) return true;
    for (int i = 0; i < rows; ++i) v[i] += added[i];
    return feeds(now);
  }

  bool demand(double now, const double *error, double *v) const {
    return demand(now, error, feed_forward.data(), v);
  }

  // Whether the feed-forward velocity is in force.
  bool feeds(double now) const { return std::fabs(now - fed) <= timeout; }
};

// Numbers that a task leaves to its next cycle, where Python has them.
struct Kept {
  double *numbers = nullptr;
  size_t size = 0;
};

// These numbers during a cycle.
class Memory {
 public:
  explicit Memory(Kept kept) : numbers_(kept.size), kept_(kept.numbers) {}

  // Read what the cycle before left, and keep what the next one needs.
  void begin() { if (kept_) std::copy(kept_, kept_ + size(), data()); }
  void keep() const { std::copy(numbers_.begin(), numbers_.end(), kept_); }

  size_t size() const { return numbers_.size(); }
  double *data() { return numbers_.data(); }
  double &operator[](size_t i) { return numbers_[i]; }

 private:
  std::vector<double> numbers_;
  double *kept_;
};

class Task {
 public:
  explicit Task(Law law, Kept kept = {}) : law_(std::move(law)), memory_(kept) {}
  virtual ~Task() = default;

  // Rows of the last evaluation, and the most that there may be.
  int rows() const { return keys() ? int(keys()->size()) : most_rows(); }
  int most_rows() const { return law_.rows; }
  // Identifiers of the rows, where these change from cycle to cycle.
  virtual const std::vector<double> *keys() const { return nullptr; }
  bool scale() const { return law_.scale; }
  const double *joints() const { return law_.joints.empty() ? nullptr : law_.joints.data(); }
  const double *weights() const { return law_.weights.empty() ? nullptr : law_.weights.data(); }
  // The number of joints of its mask, or `n` without one.
  int joint_count(int n) const { return law_.joints.empty() ? n : int(law_.joints.size()); }
  virtual bool bounded() const { return false; }
  virtual bool is_identity() const { return false; }
  virtual bool is_objective() const { return false; }

  // Whether the task is one of this robot.
  virtual bool fits(const Motion &motion) const = 0;
  virtual void begin() { memory_.begin(); }
  virtual void keep() const { memory_.keep(); }
  // Set a goal, its numbers row by row; false, and nothing has changed, where it is none of the task.
  virtual bool set_goal(const double *, size_t) { return false; }
  // Set a goal that moves, and its velocity, both as before; false, and nothing has changed, where
  // they are none of the task.
  bool move_goal(const std::vector<double> &goal, const std::vector<double> &velocity, double fed) {
    if (velocity.empty() || velocity.size() != law_.feed_forward.size()
        || !set_goal(goal.data(), goal.size())) return false;
    std::copy(velocity.begin(), velocity.end(), law_.feed_forward.begin());
    law_.fed = fed;
    return true;
  }
  // Evaluate the task; false where the reference has to.
  virtual bool evaluate(const Situation &at, const Rows &out) = 0;

 protected:
  Law law_;
  Memory memory_;
};

}  // namespace
