// Copyright 2026 tp_controller contributors
// SPDX-License-Identifier: Apache-2.0

// Singular directions of a level in the null space of those above, and the null space it leaves.
// Instead of LAPACK, J Z with m rows and k ≥ m columns is decomposed by Householder reflections with
// pivoting, (J Z)ᵀ Π = H R. Then one-sided Jacobi: pairs of columns of Rᵀ are rotated until all are
// orthogonal. Their lengths are the singular values, their directions Π U; the rotations, applied to
// the first m columns of Z H, give Q. With m > k, Jacobi works on J Z itself. Pairs (p, q) come in
// the order of (p + q) mod k: those of one value have no column in common.
// Reference: tp_controller/solver/null_space.py

#pragma once

#include "damping.h"

namespace {

// Columns shorter than this share of ‖J‖ are rounding errors.
constexpr double NOISE = 1e-16;
// Cosine below which two columns are orthogonal.
constexpr double ORTHOGONAL = 1e-15;
constexpr int SWEEPS = 60;

struct Directions {
  int m = 0, rank = 0;
  double *U = nullptr, *s = nullptr;     // U (m, rank), column by column
  Columns Q;
  double size = 0.0;
  const double *P = nullptr;             // as U: coordinates of a demand; none: U

  const double *task(int i) const { return U + size_t(i) * m; }

  // The motions of the null space.
  Columns free() const { return {Q[rank], Q.n, Q.k - rank}; }

  // y ← Uᵀ w, or Pᵀ w
  void seen(const double *w, double *y) const {
    for (int i = 0; i < rank; ++i) y[i] = dot((P ? P : U) + size_t(i) * m, w, m);
  }
};

// Turn columns a and b, of squared lengths aa and bb, until their first m numbers are orthogonal; say
// whether the square of their cosine, or of the tangent of twice the angle, was above `near`.
inline bool turn(double *a, double *b, int m, int stride, double &aa, double &bb, double noise,
                 double near) {
  const double ab = dot(a, b, m), square = ab * ab, product = aa * bb;
  if (!(square > ORTHOGONAL * ORTHOGONAL * product) || !(std::min(aa, bb) > noise)) return false;
  const double half = 0.5 * (bb - aa), root = std::sqrt(half * half + square);
  const double sum = std::fabs(half) + root;
  // No division or root waits for that of the tangent.
  const double t = ab / std::copysign(sum, half), c = std::sqrt(sum / (root + root));
  rotate(c, c * t, a, b, stride);
  aa -= t * ab;
  bb += t * ab;
  return square > near * std::min(product, half * half);
}

// One-sided Jacobi for k columns, which lie `stride` apart. Pairs with the same sum, modulo k,
// have no column in common: a processor turns several at once.
//
// The last sweep is the one in which all cosines and angles are at most L, up to rounding: until its
// end, 2 (k − 2) more turns change the cosine of a pair by up to 2 L² each, together less than
// ORTHOGONAL.
void orthogonalise(double *B, int m, int stride, int k, double noise, double *square) {
  const double near = ORTHOGONAL / (4.0 * k);
  bool again = true;
  for (int sweep = 0; again && sweep < SWEEPS; ++sweep) {
    again = false;
    for (int j = 0; j < k; ++j) square[j] = dot(B + j * stride, B + j * stride, m);
    for (int sum = 0; sum < k; ++sum)
      for (int p = 0; p < k; ++p) {
        const int q = sum >= p ? sum - p : sum - p + k;
        if (p < q)
          again |= turn(B + p * stride, B + q * stride, m, stride, square[p], square[q], noise, near);
      }
  }
}

class Decomposition {
 public:
  // Of a level on what Z spans; of all joints where `all`, and then Z is the identity.
  Decomposition(Arena &arena, const Level &level, const Columns &Z, bool all, bool orthonormal)
      : arena_(arena), m_(level.m), k_(Z.k), found_() {
    found_.m = level.m;
    found_.size = level.size();
    found_.Q = Z;
    if (m_ == 0 || k_ == 0) return;
    if (level.is_identity && orthonormal) {
      found_.rank = k_;
      found_.U = Z.p;
      found_.s = arena.take(k_);
      std::fill(found_.s, found_.s + k_, 1.0);
      return;
    }
    // J Z, row by row.
    T_ = arena.take(size_t(m_) * k_);
    for (int i = 0; i < m_; ++i)
      for (int j = 0; j < k_; ++j)
        T_[i * k_ + j] = level.is_identity ? Z[j][i]
            : all ? level.row(i)[j] : dot(level.row(i), Z[j], Z.n);
    if (m_ <= k_) wide(Z, all);
    else tall(Z);
  }

  const Directions &found() const { return found_; }

 private:
  // (J Z)ᵀ Π = H R, and the singular values of Rᵀ.
  void wide(const Columns &Z, bool all) {
    const int m = m_, k = k_;
    double *h = arena_.zeros(size_t(m) * k), *beta = arena_.zeros(m);
    int *order = arena_.integers(m);
    for (int i = 0; i < m; ++i) order[i] = i;
    for (int i = 0; i < m; ++i) reflect(i, h + size_t(i) * k, beta, order);
    found_.Q = all ? reflected_identity(h, beta) : reflected(Z, h, beta);
    // Columns of Rᵀ, and below them those of what turns them.
    double *B = arena_.zeros(size_t(2) * m * m);
    for (int j = 0; j < m; ++j) {
      for (int i = j; i < m; ++i) B[size_t(j) * 2 * m + i] = T_[i * k + j];
      B[size_t(j) * 2 * m + m + j] = 1.0;
    }
    finish(B, m, order);
  }

  void tall(const Columns &Z) {
    const int m = m_, k = k_;
    double *B = arena_.zeros(size_t(m + k) * k);
    for (int j = 0; j < k; ++j) {
      for (int i = 0; i < m; ++i) B[size_t(j) * (m + k) + i] = T_[i * k + j];
      B[size_t(j) * (m + k) + m + j] = 1.0;
    }
    found_.Q = {arena_.copy(Z.p, size_t(Z.n) * k), Z.n, k};
    finish(B, k, nullptr);
  }

  // The reflection that takes the longest of the rows from i on to its first number.
  void reflect(int i, double *h, double *beta, int *order) {
    const int m = m_, k = k_, left = k - i;
    int longest = i;
    double most = -1.0;
    for (int j = i; j < m; ++j) {
      const double square = dot(T_ + j * k + i, T_ + j * k + i, left);
      if (square > most) {
        most = square;
        longest = j;
      }
    }
    if (longest != i) {
      std::swap_ranges(T_ + longest * k, T_ + longest * k + k, T_ + i * k);
      std::swap(order[longest], order[i]);
    }
    const double length = std::sqrt(most);
    if (!(length > 0.0)) return;
    double *row = T_ + i * k;
    const double alpha = row[i] > 0.0 ? -length : length;
    std::copy(row + i, row + k, h + i);
    h[i] -= alpha;
    beta[i] = -1.0 / (alpha * h[i]);
    row[i] = alpha;
    for (int j = i + 1; j < m; ++j)
      add(-beta[i] * dot(h + i, T_ + j * k + i, left), h + i, T_ + j * k + i, left);
  }

  Columns reflected_identity(const double *h, const double *beta) {
    const int k = k_;
    Columns Q = {arena_.zeros(size_t(k) * k), k, k};
    for (int j = 0; j < k; ++j) Q[j][j] = 1.0;
    for (int i = m_ - 1; i >= 0; --i) {
      const double *each = h + size_t(i) * k + i;
      for (int j = i; j < k; ++j)
        add(-beta[i] * dot(each, Q[j] + i, k - i), each, Q[j] + i, k - i);
    }
    return Q;
  }

  Columns reflected(const Columns &Z, const double *h, const double *beta) {
    Columns Q = {arena_.copy(Z.p, size_t(Z.n) * k_), Z.n, k_};
    double *w = arena_.take(Z.n);
    for (int i = 0; i < m_; ++i) {
      const double *each = h + size_t(i) * k_;
      std::fill(w, w + Z.n, 0.0);
      for (int j = i; j < k_; ++j) add(each[j], Q[j], w, Z.n);
      for (int j = i; j < k_; ++j) add(-beta[i] * each[j], w, Q[j], Z.n);
    }
    return Q;
  }

  // Singular values of r columns, the largest first; Q turned with them.
  void finish(double *B, int r, const int *order) {
    const int m = m_, stride = m + r;
    double *square = arena_.take(r);
    const double noise = NOISE * found_.size;
    orthogonalise(B, m, stride, r, noise * noise, square);
    int *place = arena_.integers(r);
    for (int j = 0; j < r; ++j) {
      square[j] = norm(B + size_t(j) * stride, m);
      // Numbers that are none have no order.
      if (!std::isfinite(square[j])) throw Unsolved();
      place[j] = j;
    }
    std::sort(place, place + r, [&](int a, int b) {
      return square[a] > square[b] || (square[a] == square[b] && a < b);
    });
    const Columns Q = found_.Q;
    double *turned = arena_.zeros(size_t(Q.n) * r);
    found_.s = arena_.take(r);
    found_.U = arena_.take(size_t(m) * r);
    const double least = NEGLIGIBLE * found_.size;
    for (int i = 0; i < r; ++i) {
      const double *column = B + size_t(place[i]) * stride;
      add_columns(Q, column + m, r, turned + size_t(i) * Q.n);
      const double s = square[place[i]];
      found_.s[i] = s;
      if (!(s > least)) continue;
      found_.rank = i + 1;
      for (int j = 0; j < m; ++j) found_.U[size_t(i) * m + (order ? order[j] : j)] = column[j] / s;
    }
    std::copy(turned, turned + size_t(Q.n) * r, Q.p);
  }

  Arena &arena_;
  int m_, k_;
  double *T_ = nullptr;
  Directions found_;
};

// √W U diag(s) = P diag(θ) Rᵀ of a level with weights, or without s: P is U, R is Q.
Directions weighted(Arena &arena, const Level &level, const Directions &of, bool with_s) {
  const int m = of.m, rank = of.rank;
  const double *root = level.root(arena);
  double *J = arena.take(size_t(m) * rank);
  for (int i = 0; i < m; ++i)
    for (int j = 0; j < rank; ++j)
      J[size_t(i) * rank + j] = root[i] * of.task(j)[i] * (with_s ? of.s[j] : 1.0);
  const Columns all = {arena.zeros(size_t(rank) * rank), rank, rank};
  for (int j = 0; j < rank; ++j) all[j][j] = 1.0;
  const Level rows = {m, rank, false, false, false, J, nullptr, nullptr, nullptr};
  return Decomposition(arena, rows, all, true, true).found();
}

// The coordinates of a demand with weights, where some rows cannot be met; none where these are
// those of U.
const double *projection(Arena &arena, const Level &level, const Directions &of) {
  if (!level.weights || of.rank == of.m || of.rank == 0) return nullptr;
  const Directions its = weighted(arena, level, of, false);
  const double *root = level.root(arena);
  double *P = arena.zeros(size_t(of.m) * of.rank);
  for (int l = 0; l < of.rank; ++l)
    for (int j = 0; j < of.rank; ++j)
      for (int i = 0; i < of.m; ++i)
        P[size_t(j) * of.m + i] += root[i] * its.task(l)[i] / its.s[l] * its.Q[l][j];
  return P;
}

// Motions Q of a level, its step along them (rank,), and the roots of the stiffnesses of these.
struct Stiff {
  Columns Q;
  const double *step, *s;
  int rank;
};

// With weights, in coordinates in which these give stiffnesses θ².
Stiff stiff(Arena &arena, const Level &level, const Directions &its, const double *step) {
  const int n = its.Q.n, rank = its.rank;
  if (!level.weights || rank == 0) return {its.Q, step, its.s, rank};
  const Directions turn = weighted(arena, level, its, true);
  const Columns Q = {arena.copy(its.Q.p, size_t(n) * its.Q.k), n, its.Q.k};
  double *turned = arena.take(rank);
  for (int i = 0; i < rank; ++i) {
    std::fill(Q[i], Q[i] + n, 0.0);
    add_columns(its.Q, turn.Q[i], rank, Q[i]);
    turned[i] = dot(turn.Q[i], step, rank);
  }
  return {Q, turned, turn.s, rank};
}

// A level and its directions.
struct Decomposed {
  Level level;
  Directions its;
};

// The joints outside a mask (n,) as a level, and its directions in what Z spans: its null space are
// the motions of the joints of the mask alone.
Decomposed excluded(Arena &arena, const double *joints, const Columns &Z) {
  const int n = Z.n, m = int(std::count(joints, joints + n, 0.0));
  double *J = arena.zeros(size_t(m) * n);
  for (int j = 0, row = 0; j < n; ++j)
    if (joints[j] == 0.0) J[size_t(row++) * n + j] = 1.0;
  const Level level = {m, n, false, false, false, J, nullptr, nullptr, nullptr};
  return {level, Decomposition(arena, level, Z, false, true).found()};
}

Columns remaining(Arena &arena, const Directions &of, double region, double damping) {
  const Columns &Q = of.Q;
  const int rank = of.rank;
  if (rank == 0 || of.s[rank - 1] >= region) return of.free();
  int weak = 0;
  while (of.s[weak] >= region) ++weak;
  Columns left = {arena.copy(Q[weak], size_t(Q.n) * (Q.k - weak)), Q.n, Q.k - weak};
  for (int i = weak; i < rank; ++i) {
    const double share = of.s[i] / region;
    const double kept = share * share * (3.0 - 2.0 * share);
    const double given = std::min(
        damping * std::sqrt((1.0 - kept) / std::max(kept, NEGLIGIBLE)), 1.0);
    for (int j = 0; j < Q.n; ++j) left[i - weak][j] *= given;
  }
  return left;
}

}  // namespace
