// Copyright 2026 tp_controller contributors
// SPDX-License-Identifier: Apache-2.0

// The fast path: all levels at once where no damping and no bound is active.
// Reference: tp_controller/solver/min_norm.py

#pragma once

#include "bounded_hierarchy.h"

namespace {

// Constants of the reference.
constexpr double WELL_CONDITIONED = 1e-2, WELL_WEIGHTED = 1e-3;

class MinNorm {
 public:
  // Levels with demands; `closing` is the last of them where that is the identity.
  MinNorm(Arena &arena, int n, const Damping &damping, double period)
      : arena_(arena), n_(n), damping_(damping), period_(period) {}

  // The velocity of levels that damping does not touch; say whether there is one.
  bool solve(const std::vector<const Level *> &levels, const std::vector<double> &curved,
             const double *weights, double *x) {
    size_t count = levels.size();
    double most_curved = 0.0;
    for (double c : curved) most_curved = std::max(most_curved, c);
    const Level *closing = nullptr;
    if (count && levels[count - 1]->is_identity) {
      if (levels[count - 1]->weights || !damping_.spares(1.0, curved[count - 1])) return false;
      closing = levels[--count];
    }
    std::fill(x, x + n_, 0.0);
    if (closing) std::copy(closing->v, closing->v + n_, x);
    if (count == 0) return true;
    stack(levels, count);
    if (rows_ == 0 || rows_ > n_ || !factorise(nullptr) || !invert()) return false;
    const double size = norm(J_, rows_ * n_), largest = norm(inverse_, rows_ * rows_);
    if (!(WELL_CONDITIONED * size * largest <= 1.0)) return false;
    if (!damping_.spares(1.0 / largest, most_curved) && !undamped(levels, count, curved))
      return false;
    if (closing) return close(size, x);
    return weights ? weigh(weights, x) : (apply(v_, x), true);
  }

 private:
  void stack(const std::vector<const Level *> &levels, size_t count) {
    rows_ = 0;
    for (size_t l = 0; l < count; ++l) rows_ += levels[l]->m;
    if (rows_ > n_) return;
    J_ = arena_.zeros(size_t(rows_) * n_);
    v_ = arena_.take(rows_);
    int at = 0;
    for (size_t l = 0; l < count; ++l) {
      const Level &level = *levels[l];
      double *J = J_ + size_t(at) * n_;
      if (level.is_identity) for (int i = 0; i < n_; ++i) J[size_t(i) * n_ + i] = 1.0;
      else std::copy(level.J, level.J + size_t(level.m) * n_, J);
      std::copy(level.v, level.v + level.m, v_ + at);
      at += level.m;
    }
    L_ = arena_.take(size_t(rows_) * rows_);
  }

  // J W⁻¹ Jᵀ = L Lᵀ, row by row; say whether that is possible.
  bool factorise(const double *weights) {
    const int r = rows_;
    double *scaled = weights ? arena_.take(n_) : nullptr;
    for (int i = 0; i < r; ++i) {
      const double *row = J_ + size_t(i) * n_;
      double *l = L_ + size_t(i) * r;
      if (weights) {
        for (int j = 0; j < n_; ++j) scaled[j] = row[j] / weights[j];
        row = scaled;
      }
      for (int j = 0; j <= i; ++j) {
        const double *other = L_ + size_t(j) * r;
        const double left = dot(row, J_ + size_t(j) * n_, n_) - dot(l, other, j);
        if (j < i) l[j] = left / other[j];
        else if (left > 0.0) l[i] = std::sqrt(left);
        else return false;
      }
    }
    return true;
  }

  // L⁻¹, row by row.
  bool invert() {
    const int r = rows_;
    inverse_ = arena_.zeros(size_t(r) * r);
    for (int i = 0; i < r; ++i) {
      double *row = inverse_ + size_t(i) * r;
      const double *l = L_ + size_t(i) * r, diagonal = 1.0 / l[i];
      for (int j = 0; j < i; ++j) add(-diagonal * l[j], inverse_ + size_t(j) * r, row, j + 1);
      row[i] = diagonal;
    }
    return true;
  }

  bool undamped(const std::vector<const Level *> &levels, size_t count,
                const std::vector<double> &curved) {
    const Damping first = damping_.first();
    int begin = 0;
    for (size_t l = 0; l < count; ++l) {
      const Damping &kind = l ? damping_ : first;
      const int m = levels[l]->m, end = begin + m;
      if (m && !kind.spares(1.0 / block_norm(begin, end), curved[l])
          && !kind.spares(1.0 / std::sqrt(block_square_norm(begin, end)), curved[l])) return false;
      begin = end;
    }
    return true;
  }

  // ‖B‖ of the block B of L⁻¹ that belongs to rows.
  double block_norm(int begin, int end) const {
    double sum = 0.0;
    for (int i = begin; i < end; ++i) {
      const double *row = inverse_ + size_t(i) * rows_ + begin;
      sum += dot(row, row, i - begin + 1);
    }
    return std::sqrt(sum);
  }

  // ‖Bᵀ B‖ of the same; upper triangles only.
  double block_square_norm(int begin, int end) const {
    double sum = 0.0;
    for (int i = begin; i < end; ++i)
      for (int j = i; j < end; ++j) {
        double each = 0.0;
        for (int l = j; l < end; ++l)
          each += inverse_[size_t(l) * rows_ + i] * inverse_[size_t(l) * rows_ + j];
        sum += (i == j ? 1.0 : 2.0) * each * each;
      }
    return std::sqrt(sum);
  }

  // z ← (L Lᵀ)⁻¹ b
  void solve_factors(const double *b, double *z) const {
    const int r = rows_;
    for (int i = 0; i < r; ++i) {
      const double *l = L_ + size_t(i) * r;
      z[i] = (b[i] - dot(l, z, i)) / l[i];
    }
    for (int i = r - 1; i >= 0; --i) {
      const double *l = L_ + size_t(i) * r;
      z[i] /= l[i];
      add(-z[i], l, z, i);
    }
  }

  // x ← x + Jᵀ (L Lᵀ)⁻¹ b; return ‖(L Lᵀ)⁻¹ b‖.
  double apply(const double *b, double *x) const {
    double *z = arena_.take(rows_);
    solve_factors(b, z);
    for (int i = 0; i < rows_; ++i) add(z[i], J_ + size_t(i) * n_, x, n_);
    return norm(z, rows_);
  }

  // w ← v − J x
  double *missing(const double *x) const {
    double *w = arena_.take(rows_);
    for (int i = 0; i < rows_; ++i) w[i] = v_[i] - dot(J_ + size_t(i) * n_, x, n_);
    return w;
  }

  bool close(double size, double *x) const {
    const double push = apply(missing(x), x);
    // The multipliers of what the closing level pushes, which bends: too much for its step?
    return !(bend(size, damping_.curvature(1.0, period_)) * push > 1.0);
  }

  bool weigh(const double *weights, double *x) {
    double *plain = L_;
    L_ = arena_.zeros(size_t(rows_) * rows_);
    if (!factorise(weights) || !invert()) return false;
    const double size = norm(L_, rows_ * rows_), largest = norm(inverse_, rows_ * rows_);
    if (!(WELL_WEIGHTED * size * largest <= 1.0)) return false;
    apply(v_, x);
    for (int j = 0; j < n_; ++j) x[j] /= weights[j];
    // What weights of very different size cost in digits is made up for without them.
    L_ = plain;
    apply(missing(x), x);
    return true;
  }

  Arena &arena_;
  int n_, rows_ = 0;
  const Damping &damping_;
  double period_;
  double *J_ = nullptr, *v_ = nullptr, *L_ = nullptr, *inverse_ = nullptr;
};

}  // namespace
