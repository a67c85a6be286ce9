// Copyright 2026 tp_controller contributors
// SPDX-License-Identifier: Apache-2.0

// Search among configurations: a descent from the start, then from others.
// Reference: tp_controller/positions/search.py

#pragma once

#include "descent.h"

namespace {

// Constant of the reference.
constexpr double EQUAL = 1e-3;

// Longest time of a search [s].
constexpr double LONGEST_SEARCH = 1e6;

Descent::Clock::time_point after(double seconds) {
  return Descent::Clock::now() + std::chrono::duration_cast<Descent::Clock::duration>(
      std::chrono::duration<double>(clip(seconds, 0.0, LONGEST_SEARCH)));
}

class Search {
 public:
  // Limits of the positions (n,), and their changes (N, n) to the starts of descents nearby.
  Search(std::vector<double> lower, std::vector<double> upper, std::vector<double> nudges)
      : tasks(std::move(lower), std::move(upper)), descent_(tasks), nudges_(std::move(nudges)) {}
  Search(const Search &) = delete;

  PositionStack tasks;
  // Configurations that meet the needed levels, or the best one.
  std::vector<Point> found{1};
  size_t count = 0;
  int descents = 0;

  // Descend from each of `starts` (number, nq), until `wanted` configurations meet the first levels.
  void find(const double *starts, size_t number, size_t needed, size_t wanted,
            Descent::Clock::time_point stop) {
    descent_.stop = stop;
    descents = 0;
    count = 0;
    for (size_t i = 0; i < number && count < wanted; ++i) {
      tried_.q.assign(starts + i * tasks.nq(), starts + (i + 1) * tasks.nq());
      tasks.evaluate(tried_);
      descent_.begin();
      descent_.approach(tried_, needed);
      ++descents;
      if (is_met(tried_, needed)) {
        if (needed < tried_.costs.size()) finish(tried_);
        if (found.size() <= count) found.emplace_back();
        std::swap(found[count++], tried_);
      } else if (!count && (descents == 1 || is_better(tried_, found[0], needed))) {
        std::swap(found[0], tried_);
      }
      if (descent_.out_of_time()) break;
    }
    met_ = count > 0;
    count = std::max(count, size_t(1));
  }

  // The same for one start, and for others if that does not suffice.
  void find(const double *start, const std::vector<double> &others, size_t needed, size_t wanted,
            Descent::Clock::time_point stop) {
    find(start, 1, needed, 1, stop);
    if (!met_ && !others.empty() && !descent_.out_of_time()) {
      std::swap(first_, found[0]);
      find(others.data(), others.size() / tasks.nq(), needed, wanted, stop);
      ++descents;
      if (!met_ && !is_better(found[0], first_, needed)) std::swap(first_, found[0]);
    }
    if (!met_) finish(found[0]);
  }

  // Reduce all levels at a configuration.
  void finish(const double *q, Descent::Clock::time_point stop) {
    descent_.stop = stop;
    found[0].q.assign(q, q + tasks.nq());
    tasks.evaluate(found[0]);
    finish(found[0]);
    count = 1;
  }

  // Reduce all levels in turn; where some are not met, descend from nearby, too.
  void finish(Point &point) {
    reduce_all(point);
    const size_t levels = point.costs.size();
    for (const double *nudge = nudges_.data(); nudge != nudges_.data() + nudges_.size();
         nudge += tasks.n()) {
      if (is_met(point, levels) || descent_.out_of_time()) break;
      tasks.move(point, nudge, nearby_);
      descent_.begin();
      descent_.approach(nearby_, levels);
      if (!is_better(nearby_, point, levels)) continue;
      reduce_all(nearby_);
      if (improves(nearby_, point)) std::swap(nearby_, point);
    }
  }

  // Whether the first costs that differ notably are less than those of another point.
  static bool is_better(const Point &one, const Point &other, size_t needed) {
    for (size_t l = 0; l < needed; ++l) {
      const double a = one.costs[l], b = other.costs[l];
      if (std::fabs(a - b) > EQUAL * std::max(a, b) + MET) return a < b;
    }
    return false;
  }

 private:
  static bool is_met(const Point &point, size_t needed) { return point.cost(0, needed) <= MET; }

  // Whether a level costs notably less than at another point, and none above costs more.
  static bool improves(const Point &one, const Point &other) {
    for (size_t l = 0; l < one.costs.size(); ++l) {
      const double a = one.costs[l], b = other.costs[l];
      if (a < (1.0 - EQUAL) * b - MET) return true;
      if (a > kept_cost(b)) return false;
    }
    return false;
  }

  void reduce_all(Point &point) {
    descent_.begin();
    descent_.finish(point);
  }

  Descent descent_;
  const std::vector<double> nudges_;
  Point tried_, first_, nearby_;
  bool met_ = false;
};

}  // namespace
