// Copyright 2026 tp_controller contributors
// SPDX-License-Identifier: Apache-2.0

// Levels one after the other within bounds.
// Reference: tp_controller/solver/bounded_hierarchy.py

#pragma once

#include "curvature.h"
#include "qp.h"

namespace {

// Constants of the reference.
constexpr double ROW_DAMPING = 0.1;
constexpr double SOFTEST = 1e-8;

class BoundedHierarchy {
 public:
  // `weights` (n,) of the joints; none where null.
  BoundedHierarchy(Arena &arena, Polytope &allowed, const Damping &damping, const double *weights,
                   std::vector<Above> &above, const Shared &shared)
      : arena_(arena), shared_(shared), allowed_(allowed), n_(allowed.n), damping_(damping),
        first_(damping.first()), rest_(arena.zeros(n_)), x_(arena.take(n_)), weights_(weights),
        own_(rest_), above_(above) {
    above_.clear();
    allowed.clip(rest_, x_);
    Z_ = {arena.zeros(size_t(n_) * n_), n_, n_};
    for (int j = 0; j < n_; ++j) Z_[j][j] = 1.0;
    identity_ = Z_;
  }

  double *x() { return x_; }

  // Note from now on the joints (n,) whose bounds a level may depend on.
  void watch(int *touched) { touched_ = touched; }

  Progress progress() const {
    return {arena_.copy(x_, n_), Z_, relaxed_, above_.size(), allowed_.count,
            arena_.copy(allowed_.row_lower, allowed_.count),
            arena_.copy(allowed_.row_upper, allowed_.count), own_, shortened_};
  }

  // Take back the levels since then.
  void return_to(const Progress &then) {
    std::copy(then.x, then.x + n_, x_);
    Z_ = then.Z;
    relaxed_ = then.relaxed;
    own_ = then.own;
    shortened_ = then.shortened;
    above_.erase(above_.begin() + std::ptrdiff_t(then.above), above_.end());
    allowed_.count = then.rows;
    std::copy(then.row_lower, then.row_lower + then.rows, allowed_.row_lower);
    std::copy(then.row_upper, then.row_upper + then.rows, allowed_.row_upper);
  }

  // With what a level without a mask can move, where that is known.
  Step carry_out(const Level &level, double c, const Directions *known = nullptr) {
    const Decomposed others = hold(level);
    const Directions whole = known ? *known
        : above_.size() < shared_.count ? shared_.directions[above_.size()]
        : Decomposition(arena_, level, Z_, above_.empty(), !relaxed_).found();
    Directions its = !level.joints ? whole
        : Decomposition(arena_, level, others.its.free(), false, !relaxed_).found();
    its.P = projection(arena_, level, its);
    const int rank = its.rank;
    double *gains = arena_.take(rank), *step = arena_.take(rank), *missing = arena_.take(level.m);
    damping().gains(its.s, rank, c, gains);
    const double *origin = origin_of(level);
    std::copy(level.v, level.v + level.m, missing);
    if (origin != rest_) less(level, origin, missing);
    const double *start = arena_.copy(origin, n_);
    its.seen(missing, step);
    for (int i = 0; i < rank; ++i) step[i] *= gains[i];
    const double *multipliers = nullptr;
    if (!take(origin, its.Q, step, rank))
      multipliers = level.scale ? keep_direction(level, its, gains, c)
                                : come_near(origin, stiff(arena_, level, its, step), c);
    Step found;
    if (above_.empty() ? origin != rest_ : shortened_) found.origin = start;
    double *followed = arena_.take(rank);
    for (int i = 0; i < rank; ++i) followed[i] = its.s[i] * gains[i];
    const bool met = !multipliers && rank == level.m
        && (rank == 0 || followed[rank - 1] > 1.0 - ROUNDING);
    found.level = &level;
    found.directions = its;
    found.directions.P = nullptr;
    found.followed = followed;
    found.bend = met ? 0.0 : bend_of(level, its, multipliers, others);
    apart(multipliers, found);
    leave(whole, found);
    above_.push_back({&level, whole});
    found.velocity = arena_.copy(x_, n_);
    keep(level, start);
    return found;
  }

  Step satisfy(const Level &level, double c) {
    const Decomposed others = hold(level);
    const Columns Z = level.joints ? others.its.free() : Z_;
    const double *start = arena_.copy(x_, n_);
    const int m = level.m, n = n_, before = allowed_.count;
    double *rows = allowed_.rows + size_t(before) * n, *lengths = allowed_.lengths + before;
    double *lower = allowed_.row_lower + before, *upper = allowed_.row_upper + before;
    double *value = arena_.take(m);
    bool met = true;
    for (int i = 0; i < m; ++i) {
      double *row = rows + size_t(i) * n;
      std::copy(level.row(i), level.row(i) + n, row);
      const double length = norm(row, n);
      lengths[i] = length == 0.0 ? 1.0 : length;
      for (int j = 0; j < n; ++j) row[j] /= lengths[i];
      lower[i] = level.lower[i] / lengths[i];
      upper[i] = level.upper[i] / lengths[i];
      value[i] = dot(row, x_, n);
      met = met && within(value[i], lower[i], upper[i], 0.0);
    }
    Step found;
    found.level = &level;
    const double *multipliers = nullptr;
    if (!met) {
      multipliers = meet(Z, level, value, c);
      for (int i = 0; i < m; ++i) {
        const double now = dot(rows + size_t(i) * n, x_, n);
        lower[i] = std::min(lower[i], now);
        upper[i] = std::max(upper[i], now);
      }
    }
    allowed_.count += m;
    if (multipliers)
      found.bend = bend_against(arena_, arena_.zeros(n), multipliers, allowed_, above_, others,
                                damping_.release_region);
    apart(multipliers, found);
    found.velocity = arena_.copy(x_, n);
    keep(level, start);
    return found;
  }

  void finish() {
    if (above_.empty() || !above_.back().level->is_identity) shorten(null_space(), own_);
  }

 private:
  const Damping &damping() const { return above_.empty() ? first_ : damping_; }

  // w ← w − J x
  void less(const Level &level, const double *x, double *w) const {
    double *achieved = arena_.take(level.m);
    level.times(x, achieved);
    add(-1.0, achieved, w, level.m);
  }

  // The velocities (n,) at which the step of a level with a demand begins.
  const double *origin_of(const Level &level) const {
    if (!above_.empty()) return x_;
    if (!level.joints) return own_;
    double *found = arena_.take(n_);
    for (int j = 0; j < n_; ++j) found[j] = level.joints[j] != 0.0 ? own_[j] : x_[j];
    return found;
  }

  // Prepare x for a level with a mask; the joints that it holds.
  Decomposed hold(const Level &level) {
    if (!level.joints) return Decomposed();
    shorten(null_space(), own_);
    return excluded(arena_, level.joints, Z_);
  }

  // Shorten the step of a level with a mask from `origin`, and keep it.
  void keep(const Level &level, const double *origin) {
    shortened_ = false;
    if (!level.joints) return;
    shorten(excluded(arena_, level.joints, null_space()).its.free(), origin);
    double *own = arena_.copy(own_, n_);
    add(1.0, x_, own, n_);
    add(-1.0, origin, own, n_);
    own_ = own;
  }

  // Move x along Z so that Σ w_j (x_j − origin_j)² is least.
  void shorten(const Columns &Z, const double *origin) {
    if (Z.k == 0) return;
    shortened_ = true;
    // One more level: √w_j (x_j − origin_j) = 0.
    double *cost = nullptr;
    if (weights_) {
      cost = arena_.zeros(size_t(n_) * n_);
      for (int j = 0; j < n_; ++j) cost[size_t(j) * n_ + j] = std::sqrt(weights_[j]);
    }
    const Level level = {n_, n_, false, false, !weights_, cost, rest_, nullptr, nullptr};
    const Directions its = Decomposition(arena_, level, Z, false, true).found();
    double *way = arena_.copy(x_, n_), *cost_of = arena_.take(n_);
    double *step = arena_.take(its.Q.k), *stiffness = arena_.take(its.Q.k);
    add(-1.0, origin, way, n_);
    level.times(way, cost_of);
    its.seen(cost_of, step);
    for (int i = 0; i < its.rank; ++i) {
      step[i] /= -its.s[i];
      stiffness[i] = its.s[i] * its.s[i];
    }
    if (take(x_, its.Q, step, its.rank)) return;
    move(x_, its.Q, nearest(arena_, stiffness, step, allowed_.along(arena_, x_, its.Q, 0, 0)));
  }

  // Move to origin + Q step if that is allowed; say whether it was.
  bool take(const double *origin, const Columns &Q, const double *step, int rank) {
    double *x = arena_.copy(origin, n_), *fitting = arena_.take(n_);
    add_columns(Q, step, rank, x);
    if (!allowed_.fitting(x, fitting)) return false;
    touch(fitting, x);
    std::copy(fitting, fitting + n_, x_);
    return true;
  }

  const double *keep_direction(const Level &level, const Directions &its, const double *gains,
                               double c) {
    const int rank = its.rank;
    const Columns &Q = its.Q;
    double *image = arena_.take(level.m), *achieved = arena_.take(rank);
    double *moved = arena_.take(rank), *step = arena_.take(rank);
    level.times(x_, image);
    its.seen(image, achieved);
    if (std::any_of(achieved, achieved + rank, [](double each) { return each != 0.0; })) {
      for (int i = 0; i < rank; ++i) step[i] = -gains[i] * achieved[i];
      this->step(Q, step, rank, its.s, c);
    }
    level.times(x_, image);
    its.seen(image, moved);
    its.seen(level.v, step);
    for (int i = 0; i < rank; ++i)
      step[i] = gains[i] * (step[i] - achieved[i]) - (moved[i] - achieved[i]) / its.s[i];
    const double length = norm(step, rank);
    if (length == 0.0) return nullptr;
    // One direction for the level, and all that do not move it.
    const Columns D = {arena_.zeros(size_t(n_) * (Q.k - rank + 1)), n_, Q.k - rank + 1};
    double along = 0.0;
    for (int i = 0; i < rank; ++i) {
      const double share = step[i] / length;
      add(share, Q[i], D[0], n_);
      along += its.s[i] * share * (its.s[i] * share);
    }
    std::copy(Q[rank], Q[Q.k], D[1]);
    along = std::sqrt(along);
    return this->step(D, &length, 1, &along, c);
  }

  const double *step(const Columns &Q, const double *step, int rank, const double *s, double c) {
    return take(x_, Q, step, rank) ? nullptr : come_near(x_, Q, step, s, rank, c);
  }

  const double *come_near(const double *origin, const Stiff &its, double c) {
    return come_near(origin, its.Q, its.step, its.s, its.rank, c);
  }

  const double *come_near(const double *origin, const Columns &Q, const double *step,
                          const double *s, int rank, double c) {
    const int k = Q.k;
    if (k == 0) throw Unsolved();
    double *target = arena_.zeros(k), *stiffness = arena_.take(k), *start = arena_.take(k);
    double *demanded = arena_.copy(origin, n_), *off = arena_.take(n_);
    std::copy(step, step + rank, target);
    for (int j = 0; j < k; ++j) stiffness[j] = j < rank ? std::max(s[j] * s[j], c) : c;
    add_columns(Q, step, rank, demanded);
    allowed_.clip(demanded, off);
    touch(off, demanded);
    add(-1.0, demanded, off, n_);
    for (int j = 0; j < k; ++j) start[j] = target[j] + dot(Q[j], off, n_);
    const double mu = damping().regularisation;
    double least = mu * mu;
    // It would cost the bounds their digits.
    if (least < SOFTEST * *std::max_element(stiffness, stiffness + k)) least = 0.0;
    // An exact minimum may be more than one point.
    if (least == 0.0) touch_all();
    return move(origin, Q, regularised(arena_, stiffness, target,
                                       allowed_.along(arena_, origin, Q, 0, 0), least, start));
  }

  // Move x, exactly onto bounds that have a multiplier; return the multipliers.
  const double *move(const double *origin, const Columns &Q, const Answer &found) {
    if (!found.a) throw Unsolved();
    double *x = arena_.copy(origin, n_);
    add_columns(Q, found.a, Q.k, x);
    add(1.0 / ROUNDING, found.multipliers, x, n_);
    allowed_.clip(x, x_);
    touch(x_, x);
    allowed_.widen(x_);
    return found.multipliers;
  }

  // Joints whose velocities were clipped.
  void touch(const double *clipped, const double *x) const {
    for (int j = 0; touched_ && j < n_; ++j) touched_[j] |= clipped[j] != x[j];
  }

  void touch_all() const {
    if (touched_) std::fill(touched_, touched_ + n_, 1);
  }

  void apart(const double *multipliers, Step &found) const {
    found.rows = allowed_.count;
    if (!multipliers) return;
    found.multipliers = multipliers;
    double *of_rows = arena_.take(allowed_.count);
    for (int i = 0; i < allowed_.count; ++i)
      of_rows[i] = multipliers[n_ + i] / allowed_.lengths[i];
    found.row_multipliers = of_rows;
  }

  void leave(const Directions &its, Step &found) {
    const double region = damping_.release_region;
    Z_ = remaining(arena_, its, region, damping_.damping != 0.0 ? damping_.damping : region);
    if (Z_.k == its.Q.k - its.rank) return;
    relaxed_ = true;
    found.is_relaxed = true;
    found.relaxed = Z_;
  }

  double bend_of(const Level &level, const Directions &its, const double *multipliers,
                 const Decomposed &others) {
    double *missed = arena_.copy(level.v, level.m), *force = arena_.zeros(n_);
    less(level, x_, missed);
    const double push = norm(missed, level.m);
    if (push <= NEGLIGIBLE * norm(level.v, level.m)) return 0.0;
    double h = level.is_identity ? 0.0 : bend(its.size, push);
    if (level.weights)
      multipliers = weigh(arena_, level, missed, multipliers, n_ + allowed_.count);
    level.add_transposed(1.0, missed, force);
    return h + bend_against(arena_, force, multipliers, allowed_, above_, others,
                            damping_.release_region);
  }

  // Move x to within bounds on what the next rows gain; return multipliers where it cannot.
  const double *meet(const Columns &Z, const Level &level, const double *value, double c) {
    const int before = allowed_.count, k = Z.k, m = level.m;
    const double *rows = allowed_.rows + size_t(before) * n_;
    double *G = arena_.take(size_t(m) * k), *lower = arena_.take(m), *upper = arena_.take(m);
    double *asked = arena_.take(m);
    for (int i = 0; i < m; ++i) {
      double square = 0.0;
      for (int j = 0; j < k; ++j) {
        const double each = dot(rows + size_t(i) * n_, Z[j], n_);
        G[size_t(i) * k + j] = each;
        square += each * each;
      }
      lower[i] = allowed_.row_lower[before + i] - value[i];
      upper[i] = allowed_.row_upper[before + i] - value[i];
      asked[i] = std::max(std::max(lower[i], -upper[i]), 0.0);
      if (!damping_.off()) reduce(lower[i], upper[i], square / (ROW_DAMPING * ROW_DAMPING));
    }
    if (nearest_step(Z, m, G, lower, upper, asked)) return nullptr;
    touch_all();
    // One more variable for each row: what is missing to its bound.
    const Program soft = allowed_.with_rows(arena_, x_, Z, m, m, G, lower, upper);
    double *stiffness = arena_.take(soft.k), *target = arena_.zeros(soft.k);
    const double *root = level.root(arena_);
    const double mu = damping_.regularisation;
    for (int j = 0; j < k; ++j) {
      stiffness[j] = std::max(c, mu * mu);
      target[j] = -dot(Z[j], x_, n_);
    }
    for (int i = 0; i < m; ++i) {
      const double length = allowed_.lengths[before + i] * root[i];
      stiffness[k + i] = length * length;
    }
    const Answer least = regularised(arena_, stiffness, target, soft, 0.0, target);
    return move(x_, Z, least);
  }

  // Take the smallest step within bounds on what m rows gain; say whether there is one.
  bool nearest_step(const Columns &Z, int m, const double *G, const double *lower,
                    const double *upper, const double *asked) {
    const Program program = allowed_.with_rows(arena_, x_, Z, m, 0, G, lower, upper);
    const Answer found = {arena_.take(program.k), arena_.take(program.rows)};
    // No looser tolerance may find it.
    if (!nearest_point(arena_, arena_.zeros(program.k), program, nullptr, 1.0, found, FEASIBLE))
      return false;
    // A row of which others, and joints at their limits, leave a length s: its multiplier is what
    // it still lacks / s².
    const double share = ROW_DAMPING * ROW_DAMPING;
    bool dear = false;
    for (int i = 0; i < m; ++i)
      dear |= asked[i] > 0.0
          && share * std::abs(found.multipliers[program.rows - m + i]) > asked[i];
    if (dear && !damping_.off()) {
      touch_all();
      ease(Z, m, G, lower, upper, asked);
    } else {
      move(x_, Z, found);
    }
    return true;
  }

  // Move x towards bounds on what m rows gain, at a multiplier of at most asked / ROW_DAMPING².
  // Each may lack w, from 0 to what it asks for: least ‖a‖² + Σ (w + dearest)².
  void ease(const Columns &Z, int m, const double *G, const double *lower, const double *upper,
            const double *asked) {
    const int k = Z.k;
    const Program program = allowed_.along(arena_, x_, Z, 2 * m, m);
    double *target = arena_.zeros(program.k);
    for (int i = 0; i < m; ++i) {
      const int at = program.rows - 2 * m + i;
      double *row = program.A + size_t(at) * program.k;
      std::copy(G + size_t(i) * k, G + size_t(i + 1) * k, row);
      row[k + i] = lower[i] > 0.0 ? 1.0 : -1.0;
      program.lower[at] = lower[i];
      program.upper[at] = upper[i];
      program.A[size_t(at + m) * program.k + k + i] = 1.0;
      program.lower[at + m] = 0.0;
      program.upper[at + m] = asked[i];
      target[k + i] = -asked[i] / (ROW_DAMPING * ROW_DAMPING);
    }
    const Answer found = {arena_.take(program.k), arena_.take(program.rows)};
    if (nearest_point(arena_, target, program, nullptr, 1.0, found, FEASIBLE))
      move(x_, Z, found);
  }

  // Demand a share, of at most 1, of what bounds demand.
  static void reduce(double &lower, double &upper, double share) {
    share = std::min(share, 1.0);
    lower = share * std::max(lower, 0.0) + std::min(lower, 0.0);
    upper = share * std::min(upper, 0.0) + std::max(upper, 0.0);
  }

  // The null space of all levels, without relaxed directions.
  Columns null_space() {
    if (!relaxed_) return Z_;
    Columns Z = identity_;
    for (const Above &each : above_)
      Z = remaining(arena_, Decomposition(arena_, *each.level, Z, false, true).found(), 0.0, 0.0);
    return Z;
  }

  Arena &arena_;
  const Shared &shared_;
  Polytope &allowed_;
  int n_;
  Damping damping_, first_;
  double *rest_, *x_;
  const double *weights_, *own_;         // own: steps of levels with a mask
  Columns Z_, identity_;
  std::vector<Above> &above_;
  bool relaxed_ = false, shortened_ = false;  // x, since the last level
  int *touched_ = nullptr;
};

}  // namespace
