// Copyright 2026 tp_controller contributors
// SPDX-License-Identifier: Apache-2.0

// Curvature of the constraints that balance the force of a level.
// Reference: tp_controller/solver/curvature.py

#pragma once

#include "level_step.h"
#include "polytope.h"

namespace {

// Subtract from a force (n,) the part that a level balances; return the norm of its multipliers.
double balance(Arena &arena, const Level &level, const Directions &its, double softest,
               double *force) {
  double *mu = arena.take(its.rank), *pushed = arena.zeros(its.m);
  for (int i = 0; i < its.rank; ++i) {
    mu[i] = dot(force, its.Q[i], its.Q.n) / (its.s[i] + softest / its.s[i]);
    add(mu[i], its.task(i), pushed, its.m);
  }
  level.add_transposed(-1.0, pushed, force);
  return norm(mu, its.rank);
}

// Weigh the residual (m,) of a level with weights, in place, and return its multipliers in the same
// units: those of the residual, whatever the weights.
const double *weigh(Arena &arena, const Level &level, double *missed, const double *multipliers,
                    int count) {
  const double push = norm(missed, level.m), *root = level.root(arena);
  for (int i = 0; i < level.m; ++i) missed[i] *= root[i] * root[i];
  const double share = push / norm(missed, level.m);
  for (int i = 0; i < level.m; ++i) missed[i] *= share;
  if (!multipliers) return nullptr;
  double *found = arena.zeros(count);
  add(share, multipliers, found, count);
  return found;
}

// The part of h from the constraints that balance a force (n,), which it overwrites.
double bend_against(Arena &arena, double *force, const double *multipliers,
                    const Polytope &allowed, const std::vector<Above> &above,
                    const Decomposed &others, double release_region) {
  double h = 0.0;
  if (multipliers) {
    const int n = allowed.n;
    add(-1.0, multipliers, force, n);
    const double *of_rows = multipliers + n;
    for (int i = 0; i < allowed.count; ++i) add(-of_rows[i], allowed.row(i), force, n);
    h = bend_of_rows(allowed.lengths, of_rows, allowed.count);
  }
  // Joints outside a mask balance a part of the force without curvature.
  balance(arena, others.level, others.its, 0.0, force);
  const double half = 0.5 * release_region, softest = half * half;
  for (size_t index = above.size(); index-- > 0;) {
    const Directions &those = above[index].its;
    h += bend(those.size, balance(arena, *above[index].level, those, softest, force));
  }
  return h;
}

}  // namespace
