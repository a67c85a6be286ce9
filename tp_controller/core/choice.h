// Copyright 2026 tp_controller contributors
// SPDX-License-Identifier: Apache-2.0

// Choice among configurations that reach the same goals.
// Reference: tp_controller/positions/choice.py

#pragma once

#include "search.h"

namespace {

// Constant of the reference.
constexpr double FULL_TURN = 6.283185307179586;

class Choice {
 public:
  // `turning` (n,): 1 for joints that turn, 0 for others.
  Choice(Search &search, std::vector<double> turning)
      : search_(search), tasks_(search.tasks), turning_(std::move(turning)) {}
  Choice(const Choice &) = delete;

  // Turn the joints of all that are found by whole turns, and put the one nearest to `start` first.
  void nearest(const double *start) {
    size_t best = 0;
    double least = 0.0;
    for (size_t i = 0; i < search_.count; ++i) {
      unwind(search_.found[i], start);
      const double its = distance(search_.found[i].q.data(), start);
      if (i && its >= least) continue;
      best = i;
      least = its;
    }
    std::swap(search_.found[0], search_.found[best]);
  }

 private:
  // Turn joints by whole turns towards `start`, if no task minds.
  void unwind(Point &found, const double *start) {
    turned_.q = found.q;
    bool any = false;
    for (size_t j = 0; j < tasks_.n(); ++j) {
      if (turning_[j] == 0.0) continue;
      const size_t row = tasks_.row(j);
      const double turns = std::nearbyint((start[row] - found.q[row]) / FULL_TURN);
      const double moved = found.q[row] + FULL_TURN * turns;
      if (turns == 0.0 || !tasks_.allows(j, moved)) continue;
      turned_.q[row] = moved;
      any = true;
    }
    if (!any) return;
    tasks_.evaluate(turned_);
    if (Search::is_better(found, turned_, found.costs.size())) return;
    search_.finish(turned_);
    std::swap(found, turned_);
  }

  // The distance of joints and the position of a base.
  double distance(const double *q, const double *start) const {
    double square = 0.0;
    const auto add_row = [&](size_t row) {
      square += (q[row] - start[row]) * (q[row] - start[row]);
    };
    for (size_t row = 0; row < tasks_.place_size(); ++row) add_row(row);
    for (size_t j = tasks_.first_joint(); j < tasks_.n(); ++j) add_row(tasks_.row(j));
    return std::sqrt(square);
  }

  Search &search_;
  PositionStack &tasks_;
  const std::vector<double> turning_;
  Point turned_;
};

}  // namespace
