// Copyright 2026 tp_controller contributors
// SPDX-License-Identifier: Apache-2.0

// Regularised quadratic programs: tolerances, and a primal active-set method for the last digits.
// Reference: tp_controller/solver/qp.py

#pragma once

#include "active_set.h"
#include "level.h"

namespace {

// Constants of the reference.
constexpr double TOLERANCES[] = {FEASIBLE, 1e-9, 1e-7, 1e-6};
constexpr double EXACT[] = {1e-2, 1e-6};

bool nearest_point(Arena &arena, const double *point, const Program &program, const double *scale,
                   double unit, const Answer &found, double loosest = INF) {
  Arena::Frame frame(arena);
  ActiveSet set(arena, program, scale, point);
  for (double tolerance : TOLERANCES)
    if (tolerance <= loosest && set.solve(tolerance)) {
      for (int j = 0; j < program.k; ++j) found.a[j] = scale ? scale[j] * set.z[j] : set.z[j];
      set.multipliers(unit, found.multipliers);
      return true;
    }
  return false;
}

// The answer for positive stiffnesses; none where rounding prevents a solution.
Answer nearest(Arena &arena, const double *stiffness, const double *centre,
               const Program &program) {
  const int k = program.k;
  const Answer found = {arena.take(k), arena.take(program.rows)};
  Arena::Frame frame(arena);
  double *point = arena.take(k), *scale = arena.take(k);
  const double unit = *std::max_element(stiffness, stiffness + k);
  for (int j = 0; j < k; ++j) {
    const double root = std::sqrt(stiffness[j] / unit);
    point[j] = root * centre[j];
    scale[j] = 1.0 / root;
  }
  return nearest_point(arena, point, program, scale, unit, found) ? found : Answer{};
}

// The exact minimum from an answer near it, by the primal active-set method.
class Refinement {
 public:
  Refinement(Arena &arena, const double *stiffness, const double *target, const Program &program)
      : arena_(arena), target_(target), rows_(program.rows), k_(program.k),
        A_(arena.copy(program.A, size_t(rows_) * k_)), lower_(arena.take(rows_)),
        upper_(arena.take(rows_)), length_(arena.take(rows_)), side_(arena.take(rows_)),
        root_(arena.take(k_)), everything_{arena.zeros(size_t(k_) * k_), k_, k_},
        tried_(arena.integers(rows_)) {
    for (int i = 0; i < rows_; ++i) {
      const double length = norm(row(i), k_);
      length_[i] = length > NEGLIGIBLE ? length : 1.0;
      for (int j = 0; j < k_; ++j) row(i)[j] /= length_[i];
      lower_[i] = program.lower[i] / length_[i];
      upper_[i] = program.upper[i] / length_[i];
    }
    for (int j = 0; j < k_; ++j) {
      root_[j] = std::sqrt(stiffness[j]);
      everything_[j][j] = 1.0;
    }
  }

  // Refine `answer` (in place).
  void run(const Answer &answer) {
    double *a = arena_.copy(answer.a, k_), *step = arena_.take(k_), *missed = arena_.take(k_);
    double least = INF;
    for (int i = 0; i < rows_; ++i) {
      side_[i] = double(answer.multipliers[i] > 0.0) - double(answer.multipliers[i] < 0.0);
      tried_[i] = 0;
    }
    for (int left = 10 * (rows_ + k_); left-- > 0;) {
      Arena::Frame frame(arena_);
      const Directions face = Decomposition(arena_, active(), everything_, true, true).found();
      minimise({face.Q[face.rank], k_, k_ - face.rank}, a, step);
      if (!advance(a, step)) continue;
      for (int j = 0; j < k_; ++j) missed[j] = root_[j] * (target_[j] - a[j]);
      if (norm(missed, k_) < (1.0 - ROUNDING) * least) {
        least = norm(missed, k_);
        std::fill(tried_, tried_ + rows_, 0);
      }
      std::copy(a, a + k_, answer.a);
      if (!drop(face, missed, answer.multipliers)) return;
    }
  }

 private:
  double *row(int i) const { return A_ + size_t(i) * k_; }

  // The rows with a side, as a level.
  Level active() const {
    int count = 0;
    for (int i = 0; i < rows_; ++i) count += side_[i] != 0.0;
    double *J = arena_.take(size_t(count) * k_);
    for (int i = 0, at = 0; i < rows_; ++i)
      if (side_[i] != 0.0) std::copy(row(i), row(i) + k_, J + size_t(at++) * k_);
    return {count, k_, false, false, false, J, nullptr, nullptr, nullptr};
  }

  // The step from a to the minimum on what Z spans.
  void minimise(const Columns &Z, const double *a, double *step) const {
    const Columns weighted = {arena_.take(size_t(k_) * Z.k), k_, Z.k};
    for (int i = 0; i < Z.k; ++i)
      for (int j = 0; j < k_; ++j) weighted[i][j] = root_[j] * Z[i][j];
    const Level columns = {Z.k, k_, false, false, false, weighted.p, nullptr, nullptr, nullptr};
    const Directions free = Decomposition(arena_, columns, everything_, true, true).found();
    double *missed = arena_.take(k_), *share = arena_.zeros(Z.k);
    for (int j = 0; j < k_; ++j) missed[j] = root_[j] * (target_[j] - a[j]);
    const double least = NEGLIGIBLE * norm(root_, k_);
    for (int i = 0; i < free.rank && free.s[i] > least; ++i)
      add(dot(free.Q[i], missed, k_) / free.s[i], free.task(i), share, Z.k);
    std::fill(step, step + k_, 0.0);
    add_columns(Z, share, Z.k, step);
  }

  // Go along a step, up to the first bound without a side; say whether there was none.
  bool advance(double *a, const double *step) {
    const double least = ROUNDING * norm(step, k_);
    double share = 1.0;
    int found = -1;
    for (int i = 0; i < rows_; ++i) {
      const double gained = dot(row(i), step, k_);
      if (side_[i] != 0.0 || !(std::abs(gained) > least)) continue;
      const double value = dot(row(i), a, k_);
      const double reach = ((gained > 0.0 ? upper_[i] : lower_[i]) - value) / gained;
      if (!(reach < share)) continue;
      share = reach;
      found = i;
    }
    add(std::max(share, 0.0), step, a, k_);
    if (found >= 0) side_[found] = dot(row(found), step, k_) > 0.0 ? 1.0 : -1.0;
    return found < 0;
  }

  // Find the multipliers of a face; drop its row whose multiplier has the wrong sign most, of
  // those that were not tried; say whether there was one.
  bool drop(const Directions &face, const double *missed, double *multipliers) {
    double *found = arena_.zeros(face.m), *force = arena_.take(k_);
    for (int j = 0; j < k_; ++j) force[j] = root_[j] * missed[j];
    for (int i = 0; i < face.rank; ++i)
      add(dot(face.Q[i], force, k_) / face.s[i], face.task(i), found, face.m);
    double least = 0.0;
    int wrong = -1;
    for (int i = 0, at = 0; i < rows_; ++i) {
      multipliers[i] = 0.0;
      if (side_[i] == 0.0) continue;
      const double outwards = side_[i] * found[at++];
      if (outwards > 0.0) multipliers[i] = side_[i] * outwards / length_[i];
      if (!tried_[i] && outwards < least) {
        least = outwards;
        wrong = i;
      }
    }
    if (wrong < 0) return false;
    side_[wrong] = 0.0;
    tried_[wrong] = 1;
    return true;
  }

  Arena &arena_;
  const double *target_;
  int rows_, k_;
  double *A_, *lower_, *upper_, *length_, *side_, *root_;
  Columns everything_;
  int *tried_;
};

// None where rounding prevents a solution.
Answer regularised(Arena &arena, const double *stiffness, const double *target,
                   const Program &program, double least, const double *start) {
  const int k = program.k;
  if (k == 0) throw Unsolved();
  double *stiff = arena.take(k), *centre = arena.take(k);
  const double stiffest = *std::max_element(stiffness, stiffness + k);
  const bool exact = least == 0.0;
  Answer answer{};
  for (double share : EXACT) {
    if (exact) least = share * (stiffest != 0.0 ? stiffest : 1.0);
    bool softer = false;
    for (int j = 0; j < k; ++j) {
      stiff[j] = std::max(stiffness[j], least);
      const double own = stiffness[j] / stiff[j];
      centre[j] = start[j] + own * (target[j] - start[j]);
      softer |= own < 1.0;
    }
    const Answer found = nearest(arena, stiff, centre, program);
    // The nearest answer if rounding prevents a solution of the next program.
    if (found.a) answer = found, start = found.a;
    if (!exact || !softer) return answer;
  }
  if (!answer.a) return answer;
  Arena::Frame frame(arena);
  Refinement(arena, stiffness, target, program).run(answer);
  return answer;
}

}  // namespace
