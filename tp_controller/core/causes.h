// Copyright 2026 tp_controller contributors
// SPDX-License-Identifier: Apache-2.0

// Causes of limited tasks, found by solving a cycle again without one candidate at a time.
// Reference: tp_controller/control/causes.py

#pragma once

#include "variants.h"

namespace {

// Constants of the reference.
constexpr double SIGNIFICANT_SHARE = 0.01, NOTABLE_SHARE = 0.1, NEAR_SINGULAR = 0.1,
    IMMOVABLE = 1e-5;

// Kinds of causes that follow those of limits, whose numbers are the places of their bits.
enum CauseKind {
  BY_TASK = 6, BY_BOUNDS, SINGULARITY, IMPOSSIBLE, DAMPING, CURVED, ACCELERATING,
  BY_JOINTS
};

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
    const double now = missing(level, cycle_.x);
    const double demand = level.bounded ? 0.0 : norm(level.v, level.m);
    found_.clear();
    if (!(now > std::max(least, SIGNIFICANT_SHARE * demand))) return found_;
    const double lasting = missing(level, variants_.lasting().x);
    size_ = std::max(now, lasting);
    for (const Removed &candidates : {active_limits(part.level), standing(), other_tasks(task)})
      for (const Removable &each : candidates)
        add_cause(kind_of(each), index_of(each),
                  lasting - missing(level, variants_.without({each})));
    consider_masks(part, level, lasting);
    if (is_damped(part.level))
      add_cause(DAMPING, -1, lasting - missing(level, variants_.undamped()));
    consider_singular(part, level, lasting);
    consider_passing(level, now, lasting);
    std::stable_sort(found_.begin(), found_.end(),
                     [](const Cause &a, const Cause &b) { return a.share > b.share; });
    return found_;
  }

  // The tasks and limits that block a task together; none if they do not.
  Removed combined(size_t task) {
    const Part &part = cycle_.parts[task];
    const Level level = cycle_.of(part);
    Removed removed = other_tasks(task);
    for (const Removed &limits : {active_limits(part.level), standing()})
      removed.insert(removed.end(), limits.begin(), limits.end());
    const double residual = missing(level, variants_.lasting().x);
    const double small = SIGNIFICANT_SHARE * residual;
    double least = missing(level, variants_.without(removed));
    // Without a task, a limit may become the next to stop the joints.
    while (least > (1.0 - NOTABLE_SHARE) * residual) {
      const Removed hidden = next_limits(removed);
      if (hidden.empty()) break;
      removed.insert(removed.end(), hidden.begin(), hidden.end());
      least = missing(level, variants_.without(removed));
    }
    if (least > residual - small) return {};
    for (const Removable &candidate : Removed(removed)) {
      Removed fewer;
      for (const Removable &each : removed) if (!(each == candidate)) fewer.push_back(each);
      if (missing(level, variants_.without(fewer)) <= least + small) removed = fewer;
    }
    return removed;
  }

  // The kind of a cause, and the joint or task that it names.
  int kind_of(const Removable &cause) const {
    if (cause.task < 0) return first_of(cause.active.limits);
    return cycle_.levels[cycle_.parts[size_t(cause.task)].level].bounded ? BY_BOUNDS : BY_TASK;
  }

  static int index_of(const Removable &cause) {
    return cause.task < 0 ? cause.active.joint : cause.task;
  }

 private:
  // Add a cause by the size of the residual that disappears without it.
  void add_cause(int kind, int index, double gained) {
    const double share = std::min(gained / size_, 1.0);
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

  double missing(const Level &level, const double *x) const {
    Arena::Frame frame(arena_);
    return norm(residual_of(level, x), level.m);
  }

  // The other tasks, on the level of a task or above it, that can block it.
  Removed other_tasks(size_t task) const {
    const size_t index = cycle_.parts[task].level;
    const bool all = variants_.lasting().slowed < 1.0;
    std::vector<char> coupled(size_t(n_), all);
    couple(task, coupled, true);
    for (bool more = true; more;) {
      more = false;
      for (size_t other = 0; other < cycle_.parts.size() && cycle_.parts[other].level <= index; ++other)
        if (other != task && couple(other, coupled, false)) more = true;
    }
    Removed found;
    for (size_t other = 0; other < cycle_.parts.size(); ++other)
      if (cycle_.parts[other].level <= index && other != task
          && (all || moves_any(other, coupled)))
        found.push_back({int(other), {}});
    return found;
  }

  // Add the joints that move rows of a task, all rows or those that a coupled joint moves; whether
  // there are more now.
  bool couple(size_t task, std::vector<char> &coupled, bool all) const {
    const Level level = cycle_.of(cycle_.parts[task]);
    bool more = false;
    for (int row = 0; row < level.m; ++row) {
      bool is = all;
      for (int j = 0; j < n_ && !is; ++j) is = coupled[size_t(j)] && moves(level, row, j);
      for (int j = 0; j < n_ && is; ++j)
        if (!coupled[size_t(j)] && moves(level, row, j)) coupled[size_t(j)] = more = true;
    }
    return more;
  }

  bool moves_any(size_t task, const std::vector<char> &coupled) const {
    const Level level = cycle_.of(cycle_.parts[task]);
    for (int row = 0; row < level.m; ++row)
      for (int j = 0; j < n_; ++j)
        if (coupled[size_t(j)] && moves(level, row, j)) return true;
    return false;
  }

  // Joints that stand move nothing but rows of the identity, which demand nothing of them.
  bool moves(const Level &level, int row, int j) const {
    if (!level.J) return row == j;
    return level.J[size_t(row) * size_t(level.n) + size_t(j)] != 0.0
        && !stands(j);
  }

  bool stands(int j) const {
    return std::count(cycle_.standing.begin(), cycle_.standing.end(), j) > 0;
  }

  // The joints that stand, and stay.
  Removed standing() const {
    Removed found;
    for (int j : cycle_.standing) found.push_back({-1, {j, VELOCITY}});
    return found;
  }

  // All limits that are active in a level of the cycle that lasts, or above it.
  Removed active_limits(size_t index) const {
    const Found &lasting = variants_.lasting();
    Removed found;
    for (size_t l = 0; l <= index && l < lasting.steps.size(); ++l) {
      const Step &step = lasting.steps[l];
      if (!step.multipliers) continue;
      const double *at = lasting.slowed < 1.0 ? lasting.x : step.velocity;
      for (int j : limited_by(step)) {
        const Removable active = {-1, {j, limits_at(j, step.multipliers[j] > 0.0, at[j])}};
        if (!has(found, active)) found.push_back(active);
      }
    }
    if (lasting.slowed < 1.0)
      // Bounds of levels may bring more joints to their limits than the one that decides.
      for (const Removable &active : at_bounds(lasting.x, {}))
        if (!has(found, active)) found.push_back(active);
    return found;
  }

  // The limits that are active at velocities (n,), without some that are removed.
  Removed at_bounds(const double *x, const Removed &removed) const {
    Removed found;
    for (bool up : {true, false})
      for (int j = 0; j < n_; ++j) {
        if (stands(j) && !has(removed, {-1, {j, VELOCITY}})) continue;
        const double bound = variants_.bound(j, up, removed);
        if (std::fabs(x[j] - bound) <= SAME_VELOCITY)
          found.push_back({-1, {j, holding(j, up, bound, removed)}});
      }
    return found;
  }

  // The limits at which the joints are without some that are removed.
  Removed next_limits(const Removed &removed) {
    Removed found;
    for (const Removable &each : at_bounds(variants_.without(removed), removed))
      if (!has(removed, each)) found.push_back(each);
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

  // The lasting limits that stop a joint at a velocity.
  unsigned limits_at(int j, bool up, double velocity) const {
    const double bound = variants_.bound(j, up, {});
    if (cycle_.cap && std::isfinite(cycle_.cap[j])
        && (up ? bound - velocity : velocity - bound) > SAME_VELOCITY) return RESERVE;
    return holding(j, up, bound, {});
  }

  unsigned holding(int j, bool up, double bound, const Removed &removed) const {
    return limits_.holding(cycle_.motion, cycle_.gain, size_t(j), up, bound,
                           Variants::bits(j, removed));
  }

  // The joints that the level of a task, or one above, may move.
  void consider_masks(const Part &own, const Level &level, double lasting) {
    size_t above = cycle_.levels.size();
    for (size_t task = 0; task < cycle_.parts.size(); ++task) {
      const size_t l = cycle_.parts[task].level;
      if (l > own.level) return;
      if (l != above && cycle_.levels[l].joints)
        add_cause(BY_JOINTS, l == own.level ? -1 : int(task),
                  lasting - missing(level, variants_.with_all_joints(l)));
      above = l;
    }
  }

  // The candidates that disappear by themselves, one after the other.
  void consider_passing(const Level &level, double now, double lasting) {
    const double accelerated = missing(level, variants_.accelerated());
    add_cause(ACCELERATING, -1, now - accelerated);
    if (variants_.remembers())
      add_cause(CURVED, -1,
                accelerated - std::min(missing(level, variants_.straight()), lasting));
  }

  // Whether a level, or one above it, is damped or relaxed.
  bool is_damped(size_t index) const {
    const std::vector<Step> &steps = variants_.lasting().steps;
    for (size_t l = 0; l <= index && l < steps.size(); ++l) {
      const Step &step = steps[l];
      const int rank = step.directions.rank;
      if (step.is_relaxed || (step.level->bounded && step.multipliers)
          || std::any_of(step.followed, step.followed + rank,
                         [](double share) { return share < 1.0 - NEGLIGIBLE; })) return true;
    }
    return false;
  }

  // The candidates for directions in which the robot can hardly move or not at all.
  void consider_singular(const Part &part, const Level &level, double lasting) {
    const Found &its = variants_.lasting();
    const double *residual = residual_of(level, its.x);
    double gained = 0.0;
    if (!its.steps.empty() && its.steps[part.level].is_relaxed)
      gained = lasting - undisturbed(level, residual, its.steps[part.level]);
    if (level.m && !part.is_identity) {
      Directions alone = alone_of(part, level);
      while (alone.rank > 1 && alone.s[alone.rank - 1] <= IMMOVABLE * alone.s[0]) --alone.rank;
      if (alone.rank < level.m) {
        double *along = arena_.take(alone.rank);
        alone.seen(residual, along);
        add_cause(IMPOSSIBLE, -1, lasting - norm(along, alone.rank));
      }
      if (alone.rank && alone.s[alone.rank - 1] < NEAR_SINGULAR)
        gained = std::max(gained, lasting - regular(part, level, alone));
    }
    add_cause(SINGULARITY, -1, gained);
  }

  // What a relaxed level would miss without the motion that the levels below add.
  double undisturbed(const Level &level, const double *residual, const Step &step) const {
    const Found &its = variants_.lasting();
    double *added = arena_.take(n_), *left = arena_.take(level.m);
    for (int j = 0; j < n_; ++j) added[j] = its.slowed * (its.whole[j] - step.velocity[j]);
    level.times(added, left);
    for (int i = 0; i < level.m; ++i) left[i] += residual[i];
    return norm(left, level.m);
  }

  // What a level would miss where all its singular values were large enough.
  double regular(const Part &part, const Level &level, const Directions &alone) {
    Level other = level;
    double *J = arena_.zeros(size_t(level.m) * n_);
    for (int i = 0; i < alone.rank; ++i)
      for (int row = 0; row < level.m; ++row)
        add(std::max(alone.s[i], NEAR_SINGULAR) * alone.task(i)[row], alone.Q[i], J + row * n_,
            n_);
    other.J = J;
    return missing(other, variants_.with_rows(part, J));
  }

  // The directions of a task by itself.
  Directions alone_of(const Part &part, const Level &level) {
    const std::vector<Step> &steps = variants_.lasting().steps;
    if (part.level == 0 && !level.bounded && !level.joints && !steps.empty()
        && cycle_.standing.empty()
        && level.m == cycle_.levels[0].m)
      return steps[0].directions;
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
  double size_ = 0.0;                    // of the residual, or that of the cycle that lasts
  std::vector<Cause> found_;
  Columns everything_;
};

}  // namespace
