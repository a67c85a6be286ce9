// Copyright 2026 tp_controller contributors
//
// Licensed under the Apache License, Version 2.0 (the "License");
// you may not use this file except in compliance with the License.
// You may obtain a copy of the License at
//
//     http://www.apache.org/licenses/LICENSE-2.0
//
// Unless required by applicable law or agreed to in writing, software
// distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
// See the License for the specific language governing permissions and
// limitations under the License.

// Causes of limited tasks, found by solving a cycle again without one candidate at a time.
// Reference: tp_controller/control/causes.py

#pragma once

#include "variants.h"

namespace {

// Constants of the reference.
constexpr double SIGNIFICANT_SHARE = 0.01, NEAR_SINGULAR = 0.1;

// Kinds of causes that follow those of limits, whose numbers are the places of their bits.
enum CauseKind { BY_TASK = 5, BY_BOUNDS, SINGULARITY, IMPOSSIBLE, DAMPING };

// `index`: the joint or task that it names.
struct Cause {
  int kind, index;
  double share;
};

class Causes {
 public:
  Causes(Arena &arena, Variants &variants, const Limits &limits, const SolvedCycle &cycle)
      : arena_(arena), variants_(variants), limits_(limits), cycle_(cycle),
        n_(cycle.levels.empty() ? 0 : cycle.levels[0].n) {}

  // The causes that limit a task, the largest share first; none where its residual is at most
  // `least`.
  std::vector<Cause> of(size_t task, double least) {
    const Part &part = cycle_.parts[task];
    const Level level = cycle_.of(part);
    const double *residual = residual_of(level, cycle_.x);
    const double size = norm(residual, level.m);
    const double demand = level.bounded ? 0.0 : norm(level.v, level.m);
    found_.clear();
    if (!(size > std::max(least, SIGNIFICANT_SHARE * demand))) return found_;
    const auto consider = [&](int kind, int index, const double *x) {
      add_cause(kind, index, norm(residual_of(level, x), level.m), size);
    };
    for (const ActiveLimits &active : active_limits(part.level))
      consider(first_of(active.limits), active.joint, variants_.without(active));
    for (size_t other = 0; other < cycle_.parts.size(); ++other) {
      const size_t its = cycle_.parts[other].level;
      if (its <= part.level && other != task)
        consider(cycle_.levels[its].bounded ? BY_BOUNDS : BY_TASK, int(other),
                 variants_.without(other));
    }
    if (is_damped(part.level)) consider(DAMPING, -1, variants_.undamped());
    if (level.m && !part.is_identity) consider_singular(part, level, residual, size);
    std::stable_sort(found_.begin(), found_.end(),
                     [](const Cause &a, const Cause &b) { return a.share > b.share; });
    return found_;
  }

 private:
  void add_cause(int kind, int index, double left, double size) {
    const double share = 1.0 - left / size;
    if (share > SIGNIFICANT_SHARE) found_.push_back({kind, index, share});
  }

  static int first_of(unsigned limits) {
    int place = 0;
    while (!(limits >> place & 1)) ++place;
    return place;
  }

  const double *residual_of(const Level &level, const double *x) const {
    double *found = arena_.take(level.m);
    level.times(x, found);
    for (int i = 0; i < level.m; ++i)
      found[i] = (level.bounded ? clip(found[i], level.lower[i], level.upper[i]) : level.v[i])
          - found[i];
    return found;
  }

  // All limits that are active in a level or in one above it.
  std::vector<ActiveLimits> active_limits(size_t index) const {
    std::vector<ActiveLimits> found;
    const auto note = [&](int j, bool up, double velocity) {
      const ActiveLimits active = {j, limits_at(size_t(j), up, velocity)};
      if (std::find(found.begin(), found.end(), active) == found.end()) found.push_back(active);
    };
    for (size_t l = 0; l <= index && l < cycle_.steps.size(); ++l) {
      const Step &step = cycle_.steps[l];
      if (!step.multipliers) continue;
      const double *at = cycle_.slowed < 1.0 ? cycle_.x : step.velocity;
      for (int j : limited_by(step)) note(j, step.multipliers[j] > 0.0, at[j]);
    }
    if (cycle_.slowed < 1.0)
      // Bounds of levels may bring more joints to their limits than the one that decides.
      for (bool up : {true, false})
        for (int j = 0; j < n_; ++j) {
          const double bound = (up ? cycle_.upper : cycle_.lower)[j];
          if (std::fabs(cycle_.x[j] - bound) <= SAME_VELOCITY) note(j, up, bound);
        }
    return found;
  }

  // The joints whose bounds limit a level, the strongest first.
  std::vector<int> limited_by(const Step &step) const {
    double most = 0.0;
    for (int j = 0; j < n_; ++j) most = std::max(most, std::fabs(step.multipliers[j]));
    const double least = std::max(NEGLIGIBLE * most, ROUNDING);
    std::vector<int> found;
    for (int j = 0; j < n_; ++j)
      if (std::fabs(step.multipliers[j]) > least) found.push_back(j);
    std::stable_sort(found.begin(), found.end(), [&step](int a, int b) {
      return std::fabs(step.multipliers[a]) > std::fabs(step.multipliers[b]);
    });
    return found;
  }

  // The limits that stop a joint at a velocity.
  unsigned limits_at(size_t j, bool up, double velocity) const {
    const double bound = (up ? cycle_.upper : cycle_.lower)[j];
    if (cycle_.cap && std::isfinite(cycle_.cap[j])
        && (up ? bound - velocity : velocity - bound) > SAME_VELOCITY) return RESERVE;
    return limits_.holding(cycle_.motion, cycle_.gain, j, up, bound);
  }

  // Whether a level, or one above it, is damped or relaxed.
  bool is_damped(size_t index) const {
    for (size_t l = 0; l <= index && l < cycle_.steps.size(); ++l) {
      const Step &step = cycle_.steps[l];
      const int rank = step.directions.rank;
      if (step.is_relaxed || (step.level->bounded && step.multipliers)
          || std::any_of(step.followed, step.followed + rank,
                         [](double share) { return share < 1.0 - NEGLIGIBLE; })) return true;
    }
    return false;
  }

  // The candidates for directions in which the robot can hardly move or not at all.
  void consider_singular(const Part &part, const Level &level, const double *residual,
                         double size) {
    const Directions its = alone(part, level);
    if (its.rank < level.m) {
      double *along = arena_.take(its.rank), *left = arena_.zeros(level.m);
      its.seen(residual, along);
      for (int i = 0; i < its.rank; ++i) add(along[i], its.task(i), left, level.m);
      add_cause(IMPOSSIBLE, -1, norm(left, level.m), size);
    }
    if (!its.rank || its.s[its.rank - 1] >= NEAR_SINGULAR) return;
    Level other = level;
    double *J = arena_.zeros(size_t(level.m) * n_);
    for (int i = 0; i < its.rank; ++i)
      for (int row = 0; row < level.m; ++row)
        add(std::max(its.s[i], NEAR_SINGULAR) * its.task(i)[row], its.Q[i], J + row * n_, n_);
    other.J = J;
    add_cause(SINGULARITY, -1,
              norm(residual_of(other, variants_.with_rows(part, J)), level.m), size);
  }

  // The directions of a task by itself.
  Directions alone(const Part &part, const Level &level) {
    if (part.level == 0 && !level.bounded && !cycle_.steps.empty()
        && level.m == cycle_.levels[0].m) return cycle_.steps[0].directions;
    if (!everything_.p) {
      everything_ = {arena_.zeros(size_t(n_) * n_), n_, n_};
      for (int j = 0; j < n_; ++j) everything_[j][j] = 1.0;
    }
    return Decomposition(arena_, level, everything_, true, true).found();
  }

  Arena &arena_;
  Variants &variants_;
  const Limits &limits_;
  const SolvedCycle &cycle_;
  int n_;
  std::vector<Cause> found_;
  Columns everything_;
};

}  // namespace
