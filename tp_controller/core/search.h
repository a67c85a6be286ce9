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
  Search(std::vector<double> lower, std::vector<double> upper)
      : tasks(std::move(lower), std::move(upper)), descent_(tasks) {}
  Search(const Search &) = delete;

  PositionStack tasks;
  Point best;

  // The number of descents, each from one of `starts` (count, nq), until the first levels are met.
  int find(const double *starts, size_t count, size_t needed, Descent::Clock::time_point stop) {
    descent_.stop = stop;
    int descents = 0;
    for (size_t i = 0; i < count; ++i) {
      found_.q.assign(starts + i * tasks.nq(), starts + (i + 1) * tasks.nq());
      tasks.evaluate(found_);
      descent_.begin();
      descent_.approach(found_, needed);
      if (!descents || is_better(found_, best, needed)) std::swap(best, found_);
      ++descents;
      if (best.cost(0, needed) <= MET || descent_.out_of_time()) break;
    }
    return descents;
  }

  // Reduce the levels at a configuration in turn.
  void finish(const double *q, Descent::Clock::time_point stop) {
    descent_.stop = stop;
    best.q.assign(q, q + tasks.nq());
    tasks.evaluate(best);
    descent_.begin();
    descent_.finish(best);
  }

  // Descend once from a start to all levels; `finish` where some of them were not needed.
  void find_once(const double *start, size_t needed, double seconds) {
    find(start, 1, needed, after(seconds));
    if (best.cost(0, needed) <= MET && needed < best.costs.size()) {
      descent_.begin();
      descent_.finish(best);
    }
  }

 private:
  static bool is_better(const Point &one, const Point &other, size_t needed) {
    for (size_t l = 0; l < needed; ++l) {
      const double a = one.costs[l], b = other.costs[l];
      if (std::fabs(a - b) > EQUAL * std::max(a, b) + MET) return a < b;
    }
    return false;
  }

  Descent descent_;
  Point found_;
};

}  // namespace
