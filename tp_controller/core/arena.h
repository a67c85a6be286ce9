// Copyright 2026 tp_controller contributors
// SPDX-License-Identifier: Apache-2.0

// Vectors of doubles, and memory that a cycle takes in pieces and returns at once.
// Reference: none

#pragma once

#include <algorithm>
#include <cmath>
#include <cstring>
#include <memory>
#include <new>
#include <utility>
#include <vector>

namespace {

constexpr double INF = HUGE_VAL;

// Thrown where a problem is left to the reference.
struct Unsolved {};

// Two sums, which a vector of two doubles holds; a reduction by `omp simd` goes through the stack.
inline double dot(const double *a, const double *b, int n) {
  double even = 0.0, odd = 0.0;
  int i = 0;
  for (; i + 1 < n; i += 2) {
    even += a[i] * b[i];
    odd += a[i + 1] * b[i + 1];
  }
  if (i < n) even += a[i] * b[i];
  return even + odd;
}

// b ← b + f a
inline void add(double f, const double *a, double *b, int n) {
#pragma omp simd
  for (int i = 0; i < n; ++i) b[i] += f * a[i];
}

// a, b ← c a − s b, s a + c b
inline void rotate(double c, double s, double *a, double *b, int n) {
#pragma omp simd
  for (int i = 0; i < n; ++i) {
    const double x = a[i], y = b[i];
    a[i] = c * x - s * y;
    b[i] = s * x + c * y;
  }
}

inline double norm(const double *a, int n) { return std::sqrt(dot(a, a, n)); }

inline double clip(double x, double lower, double upper) {
  return std::min(std::max(x, lower), upper);
}

inline bool within(double value, double lower, double upper, double tolerance) {
  return !(value > upper + tolerance || value < lower - tolerance);
}

// Memory that is taken in pieces and given back at once: after the first cycles none is allocated.
class Arena {
 public:
  // Some dozens of pieces a cycle: a call would take longer than the rest.
  [[gnu::always_inline]] double *take(size_t count) {
#ifdef __SANITIZE_ADDRESS__
    // Each piece for itself, so that its end is noticed; and no number that is not written first.
    double *found = add_block(count);
    std::fill(found, found + count, std::nan(""));
    used_ = blocks_.size();
    return found;
#else
    count = (count + 3) & ~size_t(3);
    if (count > left_) go_on(count);
    left_ -= count;
    return end_ - left_ - count;
#endif
  }

  double *zeros(size_t count) {
    double *found = take(count);
    std::fill(found, found + count, 0.0);
    return found;
  }

  double *copy(const double *from, size_t count) {
    double *found = take(count);
    std::copy(from, from + count, found);
    return found;
  }

  int *integers(size_t count) { return reinterpret_cast<int *>(take((count + 1) / 2)); }

  void reset() { return_to(0, 0); }

  // Gives back, at its end, what was taken since it began.
  class Frame {
   public:
    explicit Frame(Arena &arena) : arena_(arena), used_(arena.used_), left_(arena.left_) {}
    Frame(const Frame &) = delete;
    ~Frame() { arena_.return_to(used_, left_); }

   private:
    Arena &arena_;
    size_t used_, left_;
  };

 private:
  struct Block {
    std::unique_ptr<double[]> numbers;
    size_t size;
  };

  // Where there is no memory nothing has changed.
  double *add_block(size_t size) {
    blocks_.push_back({std::unique_ptr<double[]>(new double[size]), size});
    return blocks_.back().numbers.get();
  }

  // Go on in the next block that is large enough.
  void go_on(size_t count) {
    while (used_ < blocks_.size() && count > blocks_[used_].size) ++used_;
    if (used_ == blocks_.size()) add_block(std::max(count, size_t(1) << 14));
    return_to(used_ + 1, blocks_[used_].size);
  }

  void return_to(size_t used, size_t left) {
    used_ = used;
    left_ = left;
    if (used) end_ = blocks_[used - 1].numbers.get() + blocks_[used - 1].size;
#ifdef __SANITIZE_ADDRESS__
    blocks_.resize(used);
#endif
  }

  std::vector<Block> blocks_;
  // Blocks in use; in the last of them: numbers that are left, and its end.
  size_t used_ = 0, left_ = 0;
  double *end_ = nullptr;
};

// A matrix (n, k), column by column.
struct Columns {
  double *p = nullptr;
  int n = 0, k = 0;

  double *operator[](int j) const { return p + size_t(j) * n; }
};

// y ← y + Q a, for the first `count` columns.
inline void add_columns(const Columns &Q, const double *a, int count, double *y) {
  for (int j = 0; j < count; ++j) add(a[j], Q[j], y, Q.n);
}

}  // namespace
