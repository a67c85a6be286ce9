// Copyright 2026 tp_controller contributors
// SPDX-License-Identifier: Apache-2.0

// Dual active-set method of Goldfarb and Idnani for the nearest point of a polytope.
// Reference: tp_controller/solver/active_set.py

#pragma once

#include "arena.h"

namespace {

// Constants of the reference.
constexpr double DEPENDENT = 1e-15, LAST_DIGIT = 1e-15;

// lower ≤ A a ≤ upper, A (rows, k) row by row.
struct Program {
  int rows, k;
  double *A, *lower, *upper;
};

struct Answer {
  double *a, *multipliers;
};

// The nearest point of a polytope, by the dual active-set method of Goldfarb and Idnani: from the
// point itself, the bound that is violated most becomes active, and bounds whose multipliers
// would turn negative on the way are dropped. The normals of the active ones are Q R.
class ActiveSet {
 public:
  // In coordinates a = scale z.
  ActiveSet(Arena &arena, const Program &program, const double *scale, const double *point)
      : rows_(program.rows), k_(program.k), most_(std::min(program.rows, program.k)),
        point_(point) {
    const int k = k_;
    A_ = arena.take(size_t(rows_) * k);
    lower_ = arena.take(rows_);
    upper_ = arena.take(rows_);
    length_ = arena.take(rows_);
    slack_ = arena.take(rows_);
    is_active_ = arena.integers(rows_);
    Q_ = arena.take(size_t(most_) * k);
    R_ = arena.take(size_t(most_) * most_);
    multiplier_ = arena.take(most_ + 1);
    side_ = arena.take(most_);
    active_ = arena.integers(most_);
    d_ = arena.take(most_);
    e_ = arena.take(most_);
    normal_ = arena.take(k);
    rest_ = arena.take(k);
    z = arena.take(k);
    for (int i = 0; i < rows_; ++i) set_row(i, program, scale);
  }

  // Say whether there is a point within the bounds, and find it.
  bool solve(double tolerance) {
    tolerance_ = tolerance;
    count_ = 0;
    std::fill(is_active_, is_active_ + rows_, 0);
    start();
    steps_ = 10 * (rows_ + k_) + 20;
    bool settled = false;
    for (int row; steps_-- > 0; settled = row < 0) {
      row = worst();
      if (row >= 0) {
        if (!enter(row)) return false;
      } else if (count_ == 0 || settled) {
        return true;
      } else {
        settle();
      }
    }
    return false;
  }

  void multipliers(double unit, double *found) const {
    std::fill(found, found + rows_, 0.0);
    for (int i = 0; i < count_; ++i)
      if (multiplier_[i] > 0.0)
        found[active_[i]] = unit * side_[i] * multiplier_[i] / length_[active_[i]];
  }

  double *z;

 private:
  // Make a row as long as 1; what is next to nothing cannot help, and is met or not. A single number
  // is exactly as long: where z is at several bounds, the first of them acts, whatever the rounding.
  void set_row(int i, const Program &program, const double *scale) {
    double *row = A_ + size_t(i) * k_;
    const double *given = program.A + size_t(i) * k_;
    if (scale) for (int j = 0; j < k_; ++j) row[j] = given[j] * scale[j];
    else std::copy(given, given + k_, row);
    const double square = dot(row, row, k_), length = std::sqrt(square);
    // Tolerances are those of rows as they were given, or less where their bounds are near.
    const double far = std::max(std::fabs(program.lower[i]), std::fabs(program.upper[i]));
    const double reach = far > 0.0 ? std::min(far, 1.0) : 1.0;
    if (length < ROUNDING) {
      std::fill(row, row + k_, 0.0);
      length_[i] = 1.0;
      slack_[i] = reach;
      lower_[i] = program.lower[i];
      upper_[i] = program.upper[i];
      return;
    }
    const double f = 1.0 / length;
    for (int j = 0; j < k_; ++j) row[j] *= f;
    if (k_ == 1) row[0] = std::copysign(1.0, row[0]);
    lower_[i] = f * program.lower[i];
    upper_[i] = f * program.upper[i];
    length_[i] = length;
    slack_[i] = f * reach;
  }

  int worst() {
    int found = -1;
    double most = 0.0;
    for (int i = 0; i < rows_; ++i) {
      if (is_active_[i]) continue;
      const double value = dot(A_ + size_t(i) * k_, z, k_);
      const double beyond = std::max(value - upper_[i], lower_[i] - value);
      if (beyond > most && beyond > std::max(tolerance_ * slack_[i], rounding_)) {
        most = beyond;
        found = i;
        entering_ = value > upper_[i] ? 1.0 : -1.0;
      }
    }
    violation_ = most;
    return found;
  }

  // Make a row active; say whether that is possible.
  bool enter(int row) {
    const int k = k_;
    for (int j = 0; j < k; ++j) normal_[j] = entering_ * A_[size_t(row) * k + j];
    double gained = 0.0;
    while (steps_-- > 0) {
      const double square = split();
      // How far until a multiplier is zero.
      double t = INF;
      int leaving = -1;
      for (int i = 0; i < count_; ++i)
        if (e_[i] > 0.0 && std::max(multiplier_[i], 0.0) < t * e_[i]) {
          t = std::max(multiplier_[i], 0.0) / e_[i];
          leaving = i;
        }
      const bool free = count_ < most_ && square > DEPENDENT;
      if (leaving < 0 && !free) return false;
      const bool whole = free && violation_ <= t * square;
      if (whole) t = violation_ / square;
      if (free) {
        add(-t, rest_, z, k);
        violation_ -= t * square;
      }
      add(-t, e_, multiplier_, count_);
      gained += t;
      if (whole) {
        append(row, std::sqrt(square), gained);
        return true;
      }
      drop(leaving);
    }
    return false;
  }

  // normal = N e + rest, with N = Q R and e = R⁻¹ d; return ‖rest‖².
  double split() {
    std::copy(normal_, normal_ + k_, rest_);
    std::fill(d_, d_ + count_, 0.0);
    subtract(rest_, d_);
    back(d_, e_);
    return dot(rest_, rest_, k_);
  }

  // x ← R⁻¹ b
  void back(const double *b, double *x) const {
    std::copy(b, b + count_, x);
    for (int j = count_ - 1; j >= 0; --j) {
      const double *column = R_ + size_t(j) * most_;
      x[j] /= column[j];
      add(-x[j], column, x, j);
    }
  }

  void append(int row, double length, double multiplier) {
    double *column = R_ + size_t(count_) * most_, *q = Q_ + size_t(count_) * k_;
    std::copy(d_, d_ + count_, column);
    column[count_] = length;
    for (int j = 0; j < k_; ++j) q[j] = rest_[j] / length;
    active_[count_] = row;
    side_[count_] = entering_;
    multiplier_[count_] = multiplier;
    is_active_[row] = 1;
    ++count_;
  }

  void drop(int leaving) {
    is_active_[active_[leaving]] = 0;
    --count_;
    for (int j = leaving; j < count_; ++j) {
      active_[j] = active_[j + 1];
      side_[j] = side_[j + 1];
      multiplier_[j] = multiplier_[j + 1];
      const double *from = R_ + size_t(j + 1) * most_;
      std::copy(from, from + j + 2, R_ + size_t(j) * most_);
    }
    // What is left has one number below its diagonal in each column.
    for (int j = leaving; j < count_; ++j) {
      double *column = R_ + size_t(j) * most_;
      const double h = std::hypot(column[j], column[j + 1]);
      const double c = column[j] / h, s = column[j + 1] / h;
      for (int i = j; i < count_; ++i) {
        double *each = R_ + size_t(i) * most_;
        rotate(c, -s, each + j, each + j + 1, 1);
      }
      rotate(c, -s, Q_ + size_t(j) * k_, Q_ + size_t(j + 1) * k_, k_);
    }
  }

  void start() {
    std::copy(point_, point_ + k_, z);
    rounding_ = LAST_DIGIT * (1.0 + norm(z, k_));
  }

  // Once more, from the active set alone: steps add up roundings, those of a point that may be far
  // off. z = Q y + r, with Rᵀ y = b and r what Q leaves of the point. Where roundings hid that a
  // multiplier is negative, its bound is dropped.
  void settle() {
    while (count_ > 0) {
      for (int i = 0; i < count_; ++i) {
        const int row = active_[i];
        const double *column = R_ + size_t(i) * most_;
        const double b = side_[i] > 0.0 ? upper_[row] : -lower_[row];
        d_[i] = (b - dot(column, d_, i)) / column[i];
        e_[i] = -d_[i];
      }
      std::copy(point_, point_ + k_, z);
      if (count_ == k_) {
        for (int i = 0; i < count_; ++i) e_[i] += dot(Q_ + size_t(i) * k_, z, k_);
        std::fill(z, z + k_, 0.0);
      } else {
        subtract(z, e_);
      }
      for (int i = 0; i < count_; ++i) add(d_[i], Q_ + size_t(i) * k_, z, k_);
      back(e_, multiplier_);
      const int least = int(std::min_element(multiplier_, multiplier_ + count_) - multiplier_);
      if (!(multiplier_[least] < -ROUNDING)) {
        rounding_ = LAST_DIGIT * (1.0 + norm(z, k_));
        return;
      }
      drop(least);
    }
    start();
  }

  // Subtract from w what lies along Q, and add that to c; twice, or rounding would leave a share.
  void subtract(double *w, double *c) const {
    for (int twice = 0; twice < 2; ++twice)
      for (int i = 0; i < count_; ++i) {
        const double *q = Q_ + size_t(i) * k_, share = dot(q, w, k_);
        c[i] += share;
        add(-share, q, w, k_);
      }
  }

  int rows_, k_, most_, count_ = 0, steps_ = 0;
  const double *point_;
  double *A_, *lower_, *upper_, *length_, *slack_, *Q_, *R_, *multiplier_, *side_;
  double *d_, *e_, *normal_, *rest_;
  int *is_active_, *active_;
  double tolerance_ = 0.0, rounding_ = 0.0, violation_ = 0.0, entering_ = 1.0;
};

}  // namespace
