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

// The solver, compiled: what the Python files of this folder do, with their names and in their
// order, in one call a cycle. They are the reference: read them first (docs/core.md). Here are
// the numbers only. Checks, and the `Solution`, stay in Python (compiled.py).
//
// What the reference has from LAPACK is written out for small matrices: a singular value
// decomposition (Householder, then one-sided Jacobi). What this file cannot solve it leaves to the
// reference (`Unsolved`).

#include "border.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <memory>
#include <new>
#include <utility>
#include <vector>

namespace {

constexpr double INF = HUGE_VAL;

// The constants of the reference; a test holds them equal (CONSTANTS below).
constexpr double NEGLIGIBLE = 1e-9, ROUNDING = 1e-12, FEASIBLE = 1e-11;         // level.py
constexpr double CURVATURE = 4.0, TURNING = 2.0, ROW_TURNING = 0.5, FIRST = 0.2,
                 REMEMBERED = 0.1;                                              // damping.py
constexpr double WELL_CONDITIONED = 1e-2, WELL_WEIGHTED = 1e-3;                 // min_norm.py
constexpr double ROW_DAMPING = 0.1;                                             // hierarchy
constexpr double SOFTEST = 1e-8;                                                // hierarchy
constexpr double DEPENDENT = 1e-15, LAST_DIGIT = 1e-15;                         // active_set.py
constexpr double TOLERANCES[] = {FEASIBLE, 1e-9, 1e-7, 1e-6};                   // qp.py
constexpr double EXACT[] = {1e-2, 1e-6};                                        // qp.py

// Of columns that are shorter than this share of ‖J‖ nothing but rounding is left.
constexpr double NOISE = 1e-16;
// Cosine below which two columns are orthogonal.
constexpr double ORTHOGONAL = 1e-15;
constexpr int SWEEPS = 60;
// What this file leaves to the reference.
struct Unsolved {};

// ------------------------------------------------------------------ vectors and memory

inline double dot(const double *a, const double *b, int n) {
  double sum = 0.0;
#pragma omp simd reduction(+ : sum)
  for (int i = 0; i < n; ++i) sum += a[i] * b[i];
  return sum;
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
  double *take(size_t count) {
#ifdef __SANITIZE_ADDRESS__
    // Each piece for itself, so that its end is noticed; and no number that is not written first.
    double *found = add_block(count);
    std::fill(found, found + count, std::nan(""));
    block_ = blocks_.size();
    return found;
#else
    count = (count + 3) & ~size_t(3);
    while (block_ < blocks_.size() && used_ + count > blocks_[block_].size) {
      ++block_;
      used_ = 0;
    }
    if (block_ == blocks_.size()) {
      add_block(std::max(count, size_t(1) << 14));
      used_ = 0;
    }
    double *found = blocks_[block_].numbers.get() + used_;
    used_ += count;
    return found;
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

  void reset() { give_back(0, 0); }

  // Gives back, at its end, what was taken since it began.
  class Frame {
   public:
    explicit Frame(Arena &arena) : arena_(arena), block_(arena.block_), used_(arena.used_) {}
    Frame(const Frame &) = delete;
    ~Frame() { arena_.give_back(block_, used_); }

   private:
    Arena &arena_;
    size_t block_, used_;
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

  void give_back(size_t block, size_t used) {
    block_ = block;
    used_ = used;
#ifdef __SANITIZE_ADDRESS__
    blocks_.resize(block);
#endif
  }

  std::vector<Block> blocks_;
  size_t block_ = 0, used_ = 0;
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

// ------------------------------------------------------------------ level.py

struct Level {
  int m, n;
  bool bounded, scale, is_identity;
  const double *J, *v, *lower, *upper;   // J row by row; none where it is the identity

  const double *row(int i) const { return J + size_t(i) * n; }

  // y ← J x
  void times(const double *x, double *y) const {
    if (is_identity) std::copy(x, x + n, y);
    else for (int i = 0; i < m; ++i) y[i] = dot(row(i), x, n);
  }

  // y ← y + f Jᵀ w
  void add_transposed(double f, const double *w, double *y) const {
    if (is_identity) add(f, w, y, n);
    else for (int i = 0; i < m; ++i) add(f * w[i], row(i), y, n);
  }

  double size() const { return is_identity ? std::sqrt(double(n)) : norm(J, m * n); }

  bool meets(const double *x) const {
    for (int i = 0; i < m; ++i) {
      const double value = is_identity ? x[i] : dot(row(i), x, n);
      if (!within(value, lower[i], upper[i], FEASIBLE)) return false;
    }
    return true;
  }
};

// ------------------------------------------------------------------ damping.py

struct Damping {
  double damping = 0.0, singular_region = INF, release_region = 0.0, regularisation = 0.0;

  Damping first() const {
    const double share = everywhere() ? 1.0 : FIRST;
    return {share * damping, share * singular_region, release_region, FIRST * regularisation};
  }

  bool off() const { return damping == 0.0 || singular_region == 0.0; }
  bool everywhere() const { return damping > 0.0 && singular_region == INF; }

  bool spares(double s, double c) const {
    return s >= std::max(off() ? 0.0 : singular_region, release_region) && s * s >= c;
  }

  void gains(const double *s, int count, double c, double *found) const {
    if (count == 0 || spares(s[count - 1], c)) {
      for (int i = 0; i < count; ++i) found[i] = 1.0 / s[i];
      return;
    }
    const double share = damping / singular_region;
    const double k = off() ? 1.0 : 1.0 - share * share, added = off() ? 0.0 : damping * damping;
    for (int i = 0; i < count; ++i)
      found[i] = s[i] / std::max(std::max(s[i] * s[i], k * s[i] * s[i] + added), c);
  }

  double curvature(double h, double period) const {
    return everywhere() ? 0.0 : CURVATURE * period * h;
  }

  double follow(double h, double now, double period) const {
    if (h == 0.0 && now == 0.0) return 0.0;
    h = now + (h - now) * std::exp(-period / REMEMBERED);
    const double least = damping != 0.0 ? singular_region : regularisation;
    return curvature(h, period) > (now > 0.0 ? 0.0 : least * least) ? h : 0.0;
  }
};

inline double bend(double size, double push) { return std::max(size, TURNING) * push; }

double bend_of_rows(const double *lengths, const double *multipliers, int rows) {
  double sum = 0.0;
  for (int i = 0; i < rows; ++i) {
    const double each = multipliers[i] * std::max(1.0, ROW_TURNING / lengths[i]);
    sum += each * each;
  }
  return std::sqrt(sum);
}

// ------------------------------------------------------------------ null_space.py

struct Directions {
  int m = 0, rank = 0;
  double *U = nullptr, *s = nullptr;     // U (m, rank), column by column
  Columns Q;
  double size = 0.0;

  const double *task(int i) const { return U + size_t(i) * m; }

  // y ← Uᵀ w
  void seen(const double *w, double *y) const {
    for (int i = 0; i < rank; ++i) y[i] = dot(task(i), w, m);
  }
};

// Turn columns a and b until their first m numbers are orthogonal; say whether they were not.
inline bool turn(double *a, double *b, int m, int stride, double &aa, double &bb, double noise) {
  const double ab = dot(a, b, m);
  if (!(ab * ab > ORTHOGONAL * ORTHOGONAL * aa * bb) || !(std::min(aa, bb) > noise)) return false;
  const double half = 0.5 * (bb - aa);
  const double t = ab / (half + std::copysign(std::sqrt(half * half + ab * ab), half));
  const double c = 1.0 / std::sqrt(1.0 + t * t);
  rotate(c, c * t, a, b, stride);
  aa -= t * ab;
  bb += t * ab;
  return true;
}

// One-sided Jacobi for k columns, which lie `stride` apart. Pairs with the same sum, modulo k,
// have no column in common: a processor turns several at once.
void orthogonalise(double *B, int m, int stride, int k, double noise, double *square) {
  for (int sweep = 0; sweep < SWEEPS; ++sweep) {
    bool turned = false;
    for (int j = 0; j < k; ++j) square[j] = dot(B + j * stride, B + j * stride, m);
    for (int sum = 0; sum < k; ++sum)
      for (int p = 0; p < k; ++p) {
        const int q = sum >= p ? sum - p : sum - p + k;
        if (p < q)
          turned |= turn(B + p * stride, B + q * stride, m, stride, square[p], square[q], noise);
      }
    if (!turned) return;
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

Columns remaining(Arena &arena, const Directions &of, double region, double damping) {
  const Columns &Q = of.Q;
  const int rank = of.rank;
  if (rank == 0 || of.s[rank - 1] >= region) return {Q[rank], Q.n, Q.k - rank};
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

// ------------------------------------------------------------------ qp.py

// lower ≤ A a ≤ upper, A (rows, k) row by row.
struct Program {
  int rows, k;
  double *A, *lower, *upper;
};

struct Answer {
  double *a, *multipliers;
};

// The nearest point of a polytope, by the dual active-set method of Goldfarb and Idnani: from the
// point itself, the bound that is violated most becomes active, and bounds whose multipliers
// would turn negative on the way are dropped. The normals of the active ones are Q R.
class ActiveSet {
 public:
  // In coordinates a = scale z.
  ActiveSet(Arena &arena, const Program &program, const double *scale, const double *point)
      : rows_(program.rows), k_(program.k), most_(std::min(program.rows, program.k)),
        point_(point) {
    const int k = k_;
    A_ = arena.take(size_t(rows_) * k);
    lower_ = arena.take(rows_);
    upper_ = arena.take(rows_);
    length_ = arena.take(rows_);
    slack_ = arena.take(rows_);
    is_active_ = arena.integers(rows_);
    Q_ = arena.take(size_t(most_) * k);
    R_ = arena.take(size_t(most_) * most_);
    multiplier_ = arena.take(most_ + 1);
    side_ = arena.take(most_);
    active_ = arena.integers(most_);
    d_ = arena.take(most_);
    e_ = arena.take(most_);
    normal_ = arena.take(k);
    rest_ = arena.take(k);
    z = arena.take(k);
    for (int i = 0; i < rows_; ++i) set_row(i, program, scale);
  }

  // Say whether there is a point within the bounds, and find it.
  bool solve(double tolerance) {
    tolerance_ = tolerance;
    count_ = 0;
    std::fill(is_active_, is_active_ + rows_, 0);
    start();
    steps_ = 10 * (rows_ + k_) + 20;
    bool settled = false;
    for (int row; steps_-- > 0; settled = row < 0) {
      row = worst();
      if (row >= 0) {
        if (!enter(row)) return false;
      } else if (count_ == 0 || settled) {
        return true;
      } else {
        settle();
      }
    }
    return false;
  }

  void multipliers(double unit, double *found) const {
    std::fill(found, found + rows_, 0.0);
    for (int i = 0; i < count_; ++i)
      if (multiplier_[i] > 0.0)
        found[active_[i]] = unit * side_[i] * multiplier_[i] / length_[active_[i]];
  }

  double *z;

 private:
  // Make a row as long as 1; what is next to nothing cannot help, and is met or not.
  void set_row(int i, const Program &program, const double *scale) {
    double *row = A_ + size_t(i) * k_;
    const double *given = program.A + size_t(i) * k_;
    if (scale) for (int j = 0; j < k_; ++j) row[j] = given[j] * scale[j];
    else std::copy(given, given + k_, row);
    const double square = dot(row, row, k_), length = std::sqrt(square);
    // Tolerances are those of rows as they were given, or less where their bounds are near.
    const double far = std::max(std::fabs(program.lower[i]), std::fabs(program.upper[i]));
    const double reach = far > 0.0 ? std::min(far, 1.0) : 1.0;
    if (length < ROUNDING) {
      std::fill(row, row + k_, 0.0);
      length_[i] = 1.0;
      slack_[i] = reach;
      lower_[i] = program.lower[i];
      upper_[i] = program.upper[i];
      return;
    }
    const double f = 1.0 / length;
    for (int j = 0; j < k_; ++j) row[j] *= f;
    lower_[i] = f * program.lower[i];
    upper_[i] = f * program.upper[i];
    length_[i] = length;
    slack_[i] = f * reach;
  }

  int worst() {
    int found = -1;
    double most = 0.0;
    for (int i = 0; i < rows_; ++i) {
      if (is_active_[i]) continue;
      const double value = dot(A_ + size_t(i) * k_, z, k_);
      const double beyond = std::max(value - upper_[i], lower_[i] - value);
      if (beyond > most && beyond > std::max(tolerance_ * slack_[i], rounding_)) {
        most = beyond;
        found = i;
        entering_ = value > upper_[i] ? 1.0 : -1.0;
      }
    }
    violation_ = most;
    return found;
  }

  // Make a row active; say whether that is possible.
  bool enter(int row) {
    const int k = k_;
    for (int j = 0; j < k; ++j) normal_[j] = entering_ * A_[size_t(row) * k + j];
    double gained = 0.0;
    while (steps_-- > 0) {
      const double square = split();
      // How far until a multiplier is zero.
      double t = INF;
      int leaving = -1;
      for (int i = 0; i < count_; ++i)
        if (e_[i] > 0.0 && std::max(multiplier_[i], 0.0) < t * e_[i]) {
          t = std::max(multiplier_[i], 0.0) / e_[i];
          leaving = i;
        }
      const bool free = count_ < most_ && square > DEPENDENT;
      if (leaving < 0 && !free) return false;
      const bool whole = free && violation_ <= t * square;
      if (whole) t = violation_ / square;
      if (free) {
        add(-t, rest_, z, k);
        violation_ -= t * square;
      }
      add(-t, e_, multiplier_, count_);
      gained += t;
      if (whole) {
        append(row, std::sqrt(square), gained);
        return true;
      }
      drop(leaving);
    }
    return false;
  }

  // normal = N e + rest, with N = Q R and e = R⁻¹ d; return ‖rest‖².
  double split() {
    std::copy(normal_, normal_ + k_, rest_);
    std::fill(d_, d_ + count_, 0.0);
    subtract(rest_, d_);
    back(d_, e_);
    return dot(rest_, rest_, k_);
  }

  // x ← R⁻¹ b
  void back(const double *b, double *x) const {
    std::copy(b, b + count_, x);
    for (int j = count_ - 1; j >= 0; --j) {
      const double *column = R_ + size_t(j) * most_;
      x[j] /= column[j];
      add(-x[j], column, x, j);
    }
  }

  void append(int row, double length, double multiplier) {
    double *column = R_ + size_t(count_) * most_, *q = Q_ + size_t(count_) * k_;
    std::copy(d_, d_ + count_, column);
    column[count_] = length;
    for (int j = 0; j < k_; ++j) q[j] = rest_[j] / length;
    active_[count_] = row;
    side_[count_] = entering_;
    multiplier_[count_] = multiplier;
    is_active_[row] = 1;
    ++count_;
  }

  void drop(int leaving) {
    is_active_[active_[leaving]] = 0;
    --count_;
    for (int j = leaving; j < count_; ++j) {
      active_[j] = active_[j + 1];
      side_[j] = side_[j + 1];
      multiplier_[j] = multiplier_[j + 1];
      const double *from = R_ + size_t(j + 1) * most_;
      std::copy(from, from + j + 2, R_ + size_t(j) * most_);
    }
    // What is left has one number below its diagonal in each column.
    for (int j = leaving; j < count_; ++j) {
      double *column = R_ + size_t(j) * most_;
      const double h = std::hypot(column[j], column[j + 1]);
      const double c = column[j] / h, s = column[j + 1] / h;
      for (int i = j; i < count_; ++i) {
        double *each = R_ + size_t(i) * most_;
        rotate(c, -s, each + j, each + j + 1, 1);
      }
      rotate(c, -s, Q_ + size_t(j) * k_, Q_ + size_t(j + 1) * k_, k_);
    }
  }

  void start() {
    std::copy(point_, point_ + k_, z);
    rounding_ = LAST_DIGIT * (1.0 + norm(z, k_));
  }

  // Once more, from the active set alone: steps add up roundings, those of a point that may be far
  // off. z = Q y + r, with Rᵀ y = b and r what Q leaves of the point. Where roundings hid that a
  // multiplier is negative, its bound is dropped.
  void settle() {
    while (count_ > 0) {
      for (int i = 0; i < count_; ++i) {
        const int row = active_[i];
        const double *column = R_ + size_t(i) * most_;
        const double b = side_[i] > 0.0 ? upper_[row] : -lower_[row];
        d_[i] = (b - dot(column, d_, i)) / column[i];
        e_[i] = -d_[i];
      }
      std::copy(point_, point_ + k_, z);
      if (count_ == k_) {
        for (int i = 0; i < count_; ++i) e_[i] += dot(Q_ + size_t(i) * k_, z, k_);
        std::fill(z, z + k_, 0.0);
      } else {
        subtract(z, e_);
      }
      for (int i = 0; i < count_; ++i) add(d_[i], Q_ + size_t(i) * k_, z, k_);
      back(e_, multiplier_);
      const int least = int(std::min_element(multiplier_, multiplier_ + count_) - multiplier_);
      if (!(multiplier_[least] < -ROUNDING)) {
        rounding_ = LAST_DIGIT * (1.0 + norm(z, k_));
        return;
      }
      drop(least);
    }
    start();
  }

  // Subtract from w what lies along Q, and add that to c; twice, or rounding would leave a share.
  void subtract(double *w, double *c) const {
    for (int twice = 0; twice < 2; ++twice)
      for (int i = 0; i < count_; ++i) {
        const double *q = Q_ + size_t(i) * k_, share = dot(q, w, k_);
        c[i] += share;
        add(-share, q, w, k_);
      }
  }

  int rows_, k_, most_, count_ = 0, steps_ = 0;
  const double *point_;
  double *A_, *lower_, *upper_, *length_, *slack_, *Q_, *R_, *multiplier_, *side_;
  double *d_, *e_, *normal_, *rest_;
  int *is_active_, *active_;
  double tolerance_ = 0.0, rounding_ = 0.0, violation_ = 0.0, entering_ = 1.0;
};

bool nearest_point(Arena &arena, const double *point, const Program &program, const double *scale,
                   double unit, const Answer &found, double loosest = INF) {
  Arena::Frame frame(arena);
  ActiveSet set(arena, program, scale, point);
  for (double tolerance : TOLERANCES)
    if (tolerance <= loosest && set.solve(tolerance)) {
      for (int j = 0; j < program.k; ++j) found.a[j] = scale ? scale[j] * set.z[j] : set.z[j];
      set.multipliers(unit, found.multipliers);
      return true;
    }
  return false;
}

Answer nearest(Arena &arena, const double *stiffness, const double *centre,
               const Program &program) {
  const int k = program.k;
  const Answer found = {arena.take(k), arena.take(program.rows)};
  Arena::Frame frame(arena);
  double *point = arena.take(k), *scale = arena.take(k);
  const double unit = *std::max_element(stiffness, stiffness + k);
  for (int j = 0; j < k; ++j) {
    const double root = std::sqrt(stiffness[j] / unit);
    point[j] = root * centre[j];
    scale[j] = 1.0 / root;
  }
  if (!nearest_point(arena, point, program, scale, unit, found)) throw Unsolved();
  return found;
}

// The exact minimum from an answer near it, by the primal active-set method.
class Refinement {
 public:
  Refinement(Arena &arena, const double *stiffness, const double *target, const Program &program)
      : arena_(arena), target_(target), rows_(program.rows), k_(program.k),
        A_(arena.copy(program.A, size_t(rows_) * k_)), lower_(arena.take(rows_)),
        upper_(arena.take(rows_)), length_(arena.take(rows_)), side_(arena.take(rows_)),
        root_(arena.take(k_)), everything_{arena.zeros(size_t(k_) * k_), k_, k_},
        tried_(arena.integers(rows_)) {
    for (int i = 0; i < rows_; ++i) {
      const double length = norm(row(i), k_);
      length_[i] = length > NEGLIGIBLE ? length : 1.0;
      for (int j = 0; j < k_; ++j) row(i)[j] /= length_[i];
      lower_[i] = program.lower[i] / length_[i];
      upper_[i] = program.upper[i] / length_[i];
    }
    for (int j = 0; j < k_; ++j) {
      root_[j] = std::sqrt(stiffness[j]);
      everything_[j][j] = 1.0;
    }
  }

  // Refine `answer` (in place).
  void run(const Answer &answer) {
    double *a = arena_.copy(answer.a, k_), *step = arena_.take(k_), *missed = arena_.take(k_);
    double least = INF;
    for (int i = 0; i < rows_; ++i) {
      side_[i] = double(answer.multipliers[i] > 0.0) - double(answer.multipliers[i] < 0.0);
      tried_[i] = 0;
    }
    for (int left = 10 * (rows_ + k_); left-- > 0;) {
      Arena::Frame frame(arena_);
      const Directions face = Decomposition(arena_, active(), everything_, true, true).found();
      minimise({face.Q[face.rank], k_, k_ - face.rank}, a, step);
      if (!advance(a, step)) continue;
      for (int j = 0; j < k_; ++j) missed[j] = root_[j] * (target_[j] - a[j]);
      if (norm(missed, k_) < (1.0 - ROUNDING) * least) {
        least = norm(missed, k_);
        std::fill(tried_, tried_ + rows_, 0);
      }
      std::copy(a, a + k_, answer.a);
      if (!drop(face, missed, answer.multipliers)) return;
    }
  }

 private:
  double *row(int i) const { return A_ + size_t(i) * k_; }

  // The rows with a side, as a level.
  Level active() const {
    int count = 0;
    for (int i = 0; i < rows_; ++i) count += side_[i] != 0.0;
    double *J = arena_.take(size_t(count) * k_);
    for (int i = 0, at = 0; i < rows_; ++i)
      if (side_[i] != 0.0) std::copy(row(i), row(i) + k_, J + size_t(at++) * k_);
    return {count, k_, false, false, false, J, nullptr, nullptr, nullptr};
  }

  // The step from a to the minimum on what Z spans.
  void minimise(const Columns &Z, const double *a, double *step) const {
    const Columns weighted = {arena_.take(size_t(k_) * Z.k), k_, Z.k};
    for (int i = 0; i < Z.k; ++i)
      for (int j = 0; j < k_; ++j) weighted[i][j] = root_[j] * Z[i][j];
    const Level columns = {Z.k, k_, false, false, false, weighted.p, nullptr, nullptr, nullptr};
    const Directions free = Decomposition(arena_, columns, everything_, true, true).found();
    double *missed = arena_.take(k_), *share = arena_.zeros(Z.k);
    for (int j = 0; j < k_; ++j) missed[j] = root_[j] * (target_[j] - a[j]);
    const double least = NEGLIGIBLE * norm(root_, k_);
    for (int i = 0; i < free.rank && free.s[i] > least; ++i)
      add(dot(free.Q[i], missed, k_) / free.s[i], free.task(i), share, Z.k);
    std::fill(step, step + k_, 0.0);
    add_columns(Z, share, Z.k, step);
  }

  // Go along a step, up to the first bound without a side; say whether there was none.
  bool advance(double *a, const double *step) {
    const double least = ROUNDING * norm(step, k_);
    double share = 1.0;
    int found = -1;
    for (int i = 0; i < rows_; ++i) {
      const double gained = dot(row(i), step, k_);
      if (side_[i] != 0.0 || !(std::abs(gained) > least)) continue;
      const double value = dot(row(i), a, k_);
      const double reach = ((gained > 0.0 ? upper_[i] : lower_[i]) - value) / gained;
      if (!(reach < share)) continue;
      share = reach;
      found = i;
    }
    add(std::max(share, 0.0), step, a, k_);
    if (found >= 0) side_[found] = dot(row(found), step, k_) > 0.0 ? 1.0 : -1.0;
    return found < 0;
  }

  // Find the multipliers of a face; drop its row whose multiplier has the wrong sign most, of
  // those that were not tried; say whether there was one.
  bool drop(const Directions &face, const double *missed, double *multipliers) {
    double *found = arena_.zeros(face.m), *force = arena_.take(k_);
    for (int j = 0; j < k_; ++j) force[j] = root_[j] * missed[j];
    for (int i = 0; i < face.rank; ++i)
      add(dot(face.Q[i], force, k_) / face.s[i], face.task(i), found, face.m);
    double least = 0.0;
    int wrong = -1;
    for (int i = 0, at = 0; i < rows_; ++i) {
      multipliers[i] = 0.0;
      if (side_[i] == 0.0) continue;
      const double outwards = side_[i] * found[at++];
      if (outwards > 0.0) multipliers[i] = side_[i] * outwards / length_[i];
      if (!tried_[i] && outwards < least) {
        least = outwards;
        wrong = i;
      }
    }
    if (wrong < 0) return false;
    side_[wrong] = 0.0;
    tried_[wrong] = 1;
    return true;
  }

  Arena &arena_;
  const double *target_;
  int rows_, k_;
  double *A_, *lower_, *upper_, *length_, *side_, *root_;
  Columns everything_;
  int *tried_;
};

Answer regularised(Arena &arena, const double *stiffness, const double *target,
                   const Program &program, double least, const double *start) {
  const int k = program.k;
  if (k == 0) throw Unsolved();
  double *stiff = arena.take(k), *centre = arena.take(k);
  const double stiffest = *std::max_element(stiffness, stiffness + k);
  const bool exact = least == 0.0;
  Answer answer = {nullptr, nullptr};
  for (double share : EXACT) {
    if (exact) least = share * (stiffest != 0.0 ? stiffest : 1.0);
    bool softer = false;
    for (int j = 0; j < k; ++j) {
      stiff[j] = std::max(stiffness[j], least);
      const double own = stiffness[j] / stiff[j];
      centre[j] = start[j] + own * (target[j] - start[j]);
      softer |= own < 1.0;
    }
    answer = nearest(arena, stiff, centre, program);
    start = answer.a;
    if (!exact || !softer) return answer;
  }
  Arena::Frame frame(arena);
  Refinement(arena, stiffness, target, program).run(answer);
  return answer;
}

// ------------------------------------------------------------------ polytope.py

struct Polytope {
  int n, count = 0;
  double *lower, *upper;
  double *rows, *row_lower, *row_upper, *lengths;

  Polytope(Arena &arena, int n, const double *lower, const double *upper, int most)
      : n(n), lower(arena.copy(lower, n)), upper(arena.copy(upper, n)),
        rows(arena.take(size_t(most) * n)), row_lower(arena.take(most)),
        row_upper(arena.take(most)), lengths(arena.take(most)) {}

  const double *row(int i) const { return rows + size_t(i) * n; }

  void clip(const double *x, double *clipped) const {
    for (int j = 0; j < n; ++j) clipped[j] = ::clip(x[j], lower[j], upper[j]);
  }

  // x without what rounding put beyond its bounds; say whether it is no farther off.
  bool fitting(const double *x, double *clipped) const {
    double excess = 0.0;
    for (int j = 0; j < n; ++j) {
      clipped[j] = ::clip(x[j], lower[j], upper[j]);
      excess += (clipped[j] - x[j]) * (clipped[j] - x[j]);
    }
    if (excess > 0.0 && std::sqrt(excess) > ROUNDING * norm(x, n)) return false;
    for (int i = 0; i < count; ++i)
      if (!within(dot(row(i), clipped, n), row_lower[i], row_upper[i], FEASIBLE)) return false;
    return true;
  }

  void narrow(const double *cap, const double *x) {
    for (int j = 0; j < n; ++j) {
      lower[j] = std::min(std::max(lower[j], -cap[j]), x[j]);
      upper[j] = std::max(std::min(upper[j], cap[j]), x[j]);
    }
  }

  void widen(const double *x) {
    for (int i = 0; i < count; ++i) {
      const double value = dot(row(i), x, n);
      row_lower[i] = std::min(row_lower[i], value);
      row_upper[i] = std::max(row_upper[i], value);
    }
  }

  // What origin + Q a has to keep, with room for more rows, and more columns, of zeros.
  Program along(Arena &arena, const double *origin, const Columns &Q, int more_rows,
                int more_columns) const {
    const int k = Q.k + more_columns, r = n + count + more_rows;
    Program program = {r, k, arena.zeros(size_t(r) * k), arena.take(r), arena.take(r)};
    for (int i = 0; i < n; ++i) {
      for (int j = 0; j < Q.k; ++j) program.A[size_t(i) * k + j] = Q[j][i];
      program.lower[i] = lower[i] - origin[i];
      program.upper[i] = upper[i] - origin[i];
    }
    for (int i = 0; i < count; ++i) {
      for (int j = 0; j < Q.k; ++j) program.A[size_t(n + i) * k + j] = dot(row(i), Q[j], n);
      const double value = dot(row(i), origin, n);
      program.lower[n + i] = row_lower[i] - value;
      program.upper[n + i] = row_upper[i] - value;
    }
    return program;
  }
};

// ------------------------------------------------------------------ bounded_hierarchy.py

struct Step {
  const Level *level = nullptr;
  const double *velocity = nullptr, *followed = nullptr;
  Directions directions;
  Columns relaxed;
  bool is_relaxed = false;
  const double *multipliers = nullptr, *row_multipliers = nullptr;
  int rows = 0;
  double bend = 0.0;
};

// Levels with a demand, and what they could move.
struct Above {
  const Level *level;
  Directions its;
};

class BoundedHierarchy {
 public:
  BoundedHierarchy(Arena &arena, Polytope &allowed, const Damping &damping,
                   std::vector<Above> &above)
      : arena_(arena), allowed_(allowed), n_(allowed.n), damping_(damping),
        first_(damping.first()), rest_(arena.zeros(n_)), x_(arena.take(n_)), above_(above) {
    above_.clear();
    allowed.clip(rest_, x_);
    Z_ = {arena.zeros(size_t(n_) * n_), n_, n_};
    for (int j = 0; j < n_; ++j) Z_[j][j] = 1.0;
    identity_ = Z_;
  }

  double *x() { return x_; }

  Step carry_out(const Level &level, double c) {
    const Directions its = Decomposition(arena_, level, Z_, above_.empty(), !relaxed_).found();
    const int rank = its.rank;
    double *gains = arena_.take(rank), *step = arena_.take(rank), *missing = arena_.take(level.m);
    damping().gains(its.s, rank, c, gains);
    const double *origin = rest_;
    std::copy(level.v, level.v + level.m, missing);
    if (!above_.empty()) {
      origin = x_;
      less(level, missing);
    }
    its.seen(missing, step);
    for (int i = 0; i < rank; ++i) step[i] *= gains[i];
    const double *multipliers = nullptr;
    if (!take(origin, its.Q, step, rank))
      multipliers = level.scale ? keep_direction(level, its, gains, c)
                                : come_near(origin, its.Q, step, its.s, rank, c);
    Step found;
    double *followed = arena_.take(rank);
    for (int i = 0; i < rank; ++i) followed[i] = its.s[i] * gains[i];
    const bool met = !multipliers && rank == level.m
        && (rank == 0 || followed[rank - 1] > 1.0 - ROUNDING);
    found.level = &level;
    found.directions = its;
    found.followed = followed;
    found.bend = met ? 0.0 : bend_of(level, its, multipliers);
    apart(multipliers, found);
    leave(its, found);
    above_.push_back({&level, its});
    found.velocity = arena_.copy(x_, n_);
    return found;
  }

  Step satisfy(const Level &level, double c) {
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
      multipliers = meet(m, value, c);
      for (int i = 0; i < m; ++i) {
        const double now = dot(rows + size_t(i) * n, x_, n);
        lower[i] = std::min(lower[i], now);
        upper[i] = std::max(upper[i], now);
      }
    }
    allowed_.count += m;
    if (multipliers) found.bend = bend_against(arena_.zeros(n), multipliers);
    apart(multipliers, found);
    found.velocity = arena_.copy(x_, n);
    return found;
  }

  void finish(const double *weights) {
    if (!above_.empty() && above_.back().level->is_identity) return;
    Columns Z = relaxed_ ? null_space() : Z_;
    if (Z.k == 0) return;
    // One more level: √w_j x_j = 0.
    double *cost = nullptr;
    if (weights) {
      cost = arena_.zeros(size_t(n_) * n_);
      for (int j = 0; j < n_; ++j) cost[size_t(j) * n_ + j] = std::sqrt(weights[j]);
    }
    const Level level = {n_, n_, false, false, !weights, cost, rest_, nullptr, nullptr};
    const Directions its = Decomposition(arena_, level, Z, false, true).found();
    double *achieved = arena_.take(n_), *step = arena_.take(its.Q.k);
    double *stiffness = arena_.take(its.Q.k);
    level.times(x_, achieved);
    its.seen(achieved, step);
    for (int i = 0; i < its.rank; ++i) {
      step[i] /= -its.s[i];
      stiffness[i] = its.s[i] * its.s[i];
    }
    if (take(x_, its.Q, step, its.rank)) return;
    move(x_, its.Q, nearest(arena_, stiffness, step, allowed_.along(arena_, x_, its.Q, 0, 0)));
  }

 private:
  const Damping &damping() const { return above_.empty() ? first_ : damping_; }

  // w ← w − J x
  void less(const Level &level, double *w) const {
    double *achieved = arena_.take(level.m);
    level.times(x_, achieved);
    add(-1.0, achieved, w, level.m);
  }

  // Move to origin + Q step if that is allowed; say whether it was.
  bool take(const double *origin, const Columns &Q, const double *step, int rank) {
    double *x = arena_.copy(origin, n_), *fitting = arena_.take(n_);
    add_columns(Q, step, rank, x);
    if (!allowed_.fitting(x, fitting)) return false;
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

  const double *come_near(const double *origin, const Columns &Q, const double *step,
                          const double *s, int rank, double c) {
    const int k = Q.k;
    double *target = arena_.zeros(k), *stiffness = arena_.take(k), *start = arena_.take(k);
    double *demanded = arena_.copy(origin, n_), *off = arena_.take(n_);
    std::copy(step, step + rank, target);
    for (int j = 0; j < k; ++j) stiffness[j] = j < rank ? std::max(s[j] * s[j], c) : c;
    add_columns(Q, step, rank, demanded);
    allowed_.clip(demanded, off);
    add(-1.0, demanded, off, n_);
    for (int j = 0; j < k; ++j) start[j] = target[j] + dot(Q[j], off, n_);
    const double mu = damping().regularisation;
    double least = mu * mu;
    // It would cost the bounds their digits.
    if (least < SOFTEST * *std::max_element(stiffness, stiffness + k)) least = 0.0;
    return move(origin, Q, regularised(arena_, stiffness, target,
                                       allowed_.along(arena_, origin, Q, 0, 0), least, start));
  }

  // Move x, exactly onto bounds that have a multiplier; return the multipliers.
  const double *move(const double *origin, const Columns &Q, const Answer &found) {
    double *x = arena_.copy(origin, n_);
    add_columns(Q, found.a, Q.k, x);
    add(1.0 / ROUNDING, found.multipliers, x, n_);
    allowed_.clip(x, x_);
    allowed_.widen(x_);
    return found.multipliers;
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

  double bend_of(const Level &level, const Directions &its, const double *multipliers) {
    double *missed = arena_.copy(level.v, level.m), *force = arena_.zeros(n_);
    less(level, missed);
    const double push = norm(missed, level.m);
    if (push <= NEGLIGIBLE * norm(level.v, level.m)) return 0.0;
    double h = level.is_identity ? 0.0 : bend(its.size, push);
    level.add_transposed(1.0, missed, force);
    return h + bend_against(force, multipliers);
  }

  // The part of h from bounds and the levels above, against a force (n), which it overwrites.
  double bend_against(double *force, const double *multipliers) {
    double h = 0.0;
    if (multipliers) {
      add(-1.0, multipliers, force, n_);
      const double *of_rows = multipliers + n_;
      for (int i = 0; i < allowed_.count; ++i) add(-of_rows[i], allowed_.row(i), force, n_);
      h = bend_of_rows(allowed_.lengths, of_rows, allowed_.count);
    }
    const double half = 0.5 * damping_.release_region, softest = half * half;
    for (size_t index = above_.size(); index-- > 0;) {
      const Directions &those = above_[index].its;
      double *mu = arena_.take(those.rank), *pushed = arena_.zeros(those.m);
      for (int i = 0; i < those.rank; ++i) {
        mu[i] = dot(force, those.Q[i], n_) / (those.s[i] + softest / those.s[i]);
        add(mu[i], those.task(i), pushed, those.m);
      }
      h += bend(those.size, norm(mu, those.rank));
      if (index > 0) above_[index].level->add_transposed(-1.0, pushed, force);
    }
    return h;
  }

  // Move x to within bounds on what the next m rows gain; return multipliers where it cannot.
  const double *meet(int m, const double *value, double c) {
    const int before = allowed_.count, k = Z_.k;
    const double *rows = allowed_.rows + size_t(before) * n_;
    double *G = arena_.take(size_t(m) * k), *lower = arena_.take(m), *upper = arena_.take(m);
    double *asked = arena_.take(m);
    for (int i = 0; i < m; ++i) {
      double square = 0.0;
      for (int j = 0; j < k; ++j) {
        const double each = dot(rows + size_t(i) * n_, Z_[j], n_);
        G[size_t(i) * k + j] = each;
        square += each * each;
      }
      lower[i] = allowed_.row_lower[before + i] - value[i];
      upper[i] = allowed_.row_upper[before + i] - value[i];
      asked[i] = std::max(std::max(lower[i], -upper[i]), 0.0);
      if (!damping_.off()) reduce(lower[i], upper[i], square / (ROW_DAMPING * ROW_DAMPING));
    }
    if (nearest_step(m, G, lower, upper, asked)) return nullptr;
    // One more variable for each row: what is missing to its bound.
    const Program soft = with_rows(m, m, G, lower, upper);
    double *stiffness = arena_.take(soft.k), *target = arena_.zeros(soft.k);
    const double mu = damping_.regularisation;
    for (int j = 0; j < k; ++j) {
      stiffness[j] = std::max(c, mu * mu);
      target[j] = -dot(Z_[j], x_, n_);
    }
    for (int i = 0; i < m; ++i) {
      const double length = allowed_.lengths[before + i];
      stiffness[k + i] = length * length;
    }
    const Answer least = regularised(arena_, stiffness, target, soft, 0.0, target);
    return move(x_, Z_, least);
  }

  // Take the smallest step within bounds on what m rows gain; say whether there is one.
  bool nearest_step(int m, const double *G, const double *lower, const double *upper,
                    const double *asked) {
    const Program program = with_rows(m, 0, G, lower, upper);
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
    if (dear && !damping_.off()) ease(m, G, lower, upper, asked);
    else move(x_, Z_, found);
    return true;
  }

  // Move x towards bounds on what m rows gain, at a multiplier of at most asked / ROW_DAMPING².
  // Each may lack w, from 0 to what it asks for: least ‖a‖² + Σ (w + dearest)².
  void ease(int m, const double *G, const double *lower, const double *upper,
            const double *asked) {
    const int k = Z_.k;
    const Program program = allowed_.along(arena_, x_, Z_, 2 * m, m);
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
      move(x_, Z_, found);
  }

  // Demand a share, of at most 1, of what bounds demand.
  static void reduce(double &lower, double &upper, double share) {
    share = std::min(share, 1.0);
    lower = share * std::max(lower, 0.0) + std::min(lower, 0.0);
    upper = share * std::min(upper, 0.0) + std::max(upper, 0.0);
  }

  // All that is allowed, and m rows more; with one variable more for each of them, or none.
  Program with_rows(int m, int more, const double *G, const double *lower, const double *upper) {
    Program program = allowed_.along(arena_, x_, Z_, m, more);
    for (int i = 0; i < m; ++i) {
      const int at = n_ + allowed_.count + i;
      double *row = program.A + size_t(at) * program.k;
      std::copy(G + size_t(i) * Z_.k, G + size_t(i + 1) * Z_.k, row);
      if (more) row[Z_.k + i] = 1.0;
      program.lower[at] = lower[i];
      program.upper[at] = upper[i];
    }
    return program;
  }

  Columns null_space() {
    Columns Z = identity_;
    for (const Above &each : above_)
      Z = remaining(arena_, Decomposition(arena_, *each.level, Z, false, true).found(), 0.0, 0.0);
    return Z;
  }

  Arena &arena_;
  Polytope &allowed_;
  int n_;
  Damping damping_, first_;
  double *rest_, *x_;
  Columns Z_, identity_;
  std::vector<Above> &above_;
  bool relaxed_ = false;
};

// ------------------------------------------------------------------ min_norm.py

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
      if (!damping_.spares(1.0, curved[count - 1])) return false;
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

// ------------------------------------------------------------------ scaling.py

inline double slowest(double lower, double upper) { return std::min(std::max(lower, 0.0), upper); }

struct Scaled {
  double slowed = 1.0;
  int limiting = -1;
};

// x ← what `scale_uniformly` returns.
Scaled scale_uniformly(int n, const double *velocity, const double *lower, const double *upper,
                       double *x) {
  double fastest = 0.0;
  for (int j = 0; j < n; ++j)
    fastest = std::max(fastest, std::fabs(velocity[j] - slowest(lower[j], upper[j])));
  Scaled found;
  for (int j = 0; j < n; ++j) {
    const double rest = slowest(lower[j], upper[j]), change = velocity[j] - rest;
    const double allowed = (change > 0.0 ? upper[j] : lower[j]) - rest;
    if (!(std::fabs(change) - std::fabs(allowed) > NEGLIGIBLE * fastest)) continue;
    const double ratio = allowed / change;
    if (found.limiting < 0 || ratio < found.slowed) {
      found.slowed = ratio;
      found.limiting = j;
    }
  }
  for (int j = 0; j < n; ++j) {
    const double rest = slowest(lower[j], upper[j]), change = velocity[j] - rest;
    x[j] = clip(found.limiting < 0 ? velocity[j] : rest + found.slowed * change,
                lower[j], upper[j]);
    if (j == found.limiting) x[j] = change > 0.0 ? upper[j] : lower[j];
  }
  return found;
}

// ------------------------------------------------------------------ solve.py

struct Options {
  int n;
  Damping damping;
  std::vector<double> weights;           // none where empty
  bool uniform, fast;
};

class Solver {
 public:
  explicit Solver(const Options &options) : options_(options) {}

  Arena arena;
  std::vector<Level> levels;
  std::vector<double> memory;
  std::vector<Step> steps;
  double *x = nullptr, *whole = nullptr, slowed = 1.0;
  bool looped = false, busy = false;     // not looped: the fast path did it

  int n() const { return options_.n; }

  void begin() {
    arena.reset();
    levels.clear();
    memory.clear();
    steps.clear();
    slowed = 1.0;
    looped = false;
  }

  // Solve the levels; no bounds and no cap where they are null.
  void solve(const double *lower, const double *upper, double period, const double *cap) {
    const int n = options_.n;
    x = arena.take(n);
    if (!lower || !upper) {
      double *least = arena.take(n), *most = arena.take(n);
      std::fill(least, least + n, -INF);
      std::fill(most, most + n, INF);
      lower = least;
      upper = most;
    }
    curved_.clear();
    for (double h : memory) curved_.push_back(options_.damping.curvature(h, period));
    whole = x;
    if (options_.fast && fast(lower, upper, period, cap)) {
      for (double &h : memory) h = options_.damping.follow(h, 0.0, period);
      return;
    }
    looped = true;
    if (options_.uniform) {
      solve_uniformly(lower, upper, period);
      return;
    }
    loop(lower, upper, cap, false, x);
    remember(period);
  }

 private:
  bool fast(const double *lower, const double *upper, double period, const double *cap) {
    const int n = options_.n;
    demands_.clear();
    demands_curved_.clear();
    for (size_t l = 0; l < levels.size(); ++l) {
      if (levels[l].bounded) continue;
      demands_.push_back(&levels[l]);
      demands_curved_.push_back(curved_[l]);
    }
    MinNorm method(arena, n, options_.damping, period);
    double *free = arena.take(n);
    if (!method.solve(demands_, demands_curved_, weights(), free)) return false;
    if (!std::isfinite(dot(free, free, n))) return false;
    Polytope allowed(arena, n, lower, upper, 0);
    if (cap && demands_.size() > 1)
      for (int j = 0; j < n; ++j) {
        allowed.lower[j] = clip(-cap[j], lower[j], upper[j]);
        allowed.upper[j] = clip(cap[j], lower[j], upper[j]);
      }
    if (!allowed.fitting(free, x)) return false;
    for (const Level &level : levels)
      if (level.bounded && !level.meets(x)) return false;
    return true;
  }

  void loop(const double *lower, const double *upper, const double *cap, bool demands_only,
            double *found) {
    const int n = options_.n;
    int rows = 0;
    for (const Level &level : levels) rows += level.bounded ? level.m : 0;
    Polytope allowed(arena, n, lower, upper, rows);
    BoundedHierarchy hierarchy(arena, allowed, options_.damping, above_);
    steps.clear();
    for (size_t l = 0; l < levels.size(); ++l) {
      if (levels[l].bounded) {
        if (!demands_only) steps.push_back(hierarchy.satisfy(levels[l], curved_[l]));
        continue;
      }
      steps.push_back(hierarchy.carry_out(levels[l], curved_[l]));
      if (cap) allowed.narrow(cap, hierarchy.x());
      cap = nullptr;
    }
    hierarchy.finish(weights());
    std::copy(hierarchy.x(), hierarchy.x() + n, found);
    if (!std::isfinite(dot(found, found, n))) throw Unsolved();
  }

  void solve_uniformly(const double *lower, const double *upper, double period) {
    const int n = options_.n;
    double *least = arena.take(n), *most = arena.take(n);
    std::fill(least, least + n, -INF);
    std::fill(most, most + n, INF);
    whole = arena.take(n);
    if (std::any_of(levels.begin(), levels.end(), [](const Level &l) { return l.bounded; })) {
      // No bounds of levels are worth slowing the joints more than the demands need.
      loop(least, most, nullptr, true, whole);
      const double found = scale_uniformly(n, whole, lower, upper, x).slowed;
      const double share = found != 0.0 ? found : 1.0;
      for (int j = 0; j < n; ++j) {
        const double rest = slowest(lower[j], upper[j]);
        least[j] = rest + (lower[j] - rest) / share;
        most[j] = rest + (upper[j] - rest) / share;
      }
    }
    loop(least, most, nullptr, false, whole);
    remember(period);
    const Scaled found = scale_uniformly(n, whole, lower, upper, x);
    slowed = found.slowed;
    if (found.limiting < 0) return;
    double *multipliers = arena.zeros(n);
    multipliers[found.limiting] = x[found.limiting] == upper[found.limiting] ? 1.0 : -1.0;
    for (Step &step : steps) step.multipliers = multipliers;
  }

  void remember(double period) {
    for (size_t l = 0; l < levels.size(); ++l)
      memory[l] = options_.damping.follow(memory[l], steps[l].bend, period);
  }

  const double *weights() const {
    return options_.weights.empty() ? nullptr : options_.weights.data();
  }

  Options options_;
  std::vector<double> curved_, demands_curved_;
  std::vector<const Level *> demands_;
  std::vector<Above> above_;
};

// ------------------------------------------------------------------ what Python sees

// Names of the attributes of a `Level`.
PyObject *J_NAME, *V_NAME, *MODE_NAME, *LOWER_NAME, *UPPER_NAME, *IDENTITY_NAME;

void need(bool fine) {
  if (!fine) throw Unsolved();
}

bool finite(const double *values, int count) {
  double sum = 0.0;
  for (int i = 0; i < count; ++i) sum += 0.0 * values[i];
  return sum == 0.0;
}

const double *read(Arena &arena, PyObject *object, int size) {
  const Buffer buffer(object);
  need(buffer.is(size));
  double *found = arena.take(size);
  buffer.copy(found);
  return found;
}

bool is_true(PyObject *object) {
  const int found = PyObject_IsTrue(object);
  if (found < 0) PyErr_Clear();
  need(found >= 0);
  return found == 1;
}

double number(PyObject *object) {
  const double found = PyFloat_AsDouble(object);
  if (found == -1.0 && PyErr_Occurred()) {
    PyErr_Clear();
    throw Unsolved();
  }
  need(std::isfinite(found));
  return found;
}

void read_bounds(Arena &arena, PyObject *low, PyObject *high, int size, const double *&lower,
                 const double *&upper) {
  lower = read(arena, low, size);
  upper = read(arena, high, size);
  for (int i = 0; i < size; ++i)
    need(lower[i] <= upper[i] && lower[i] < INF && upper[i] > -INF);
}

Level read_level(Arena &arena, PyObject *object, int n) {
  const Held J(PyObject_GetAttr(object, J_NAME)), v(PyObject_GetAttr(object, V_NAME));
  const Held mode(PyObject_GetAttr(object, MODE_NAME));
  const Held identity(PyObject_GetAttr(object, IDENTITY_NAME));
  if (!J || !v || !mode || !identity) {
    PyErr_Clear();
    throw Unsolved();
  }
  need(PyUnicode_Check(mode));
  Level level = {0, n, v == Py_None, false, false, nullptr, nullptr, nullptr, nullptr};
  level.scale = PyUnicode_CompareWithASCIIString(mode, "scale") == 0;
  level.is_identity = is_true(identity);
  {
    const Buffer buffer(J);
    need(buffer.rows(2) >= 0);
    level.m = int(buffer.rows(2));
    need(buffer.is(level.m, n) && !(level.is_identity && (level.m != n || level.bounded)));
    if (!level.is_identity) {
      double *rows = arena.take(size_t(level.m) * n);
      buffer.copy_rows(rows);
      need(finite(rows, level.m * n));
      level.J = rows;
    }
  }
  if (!level.bounded) {
    level.v = read(arena, v, level.m);
    need(finite(level.v, level.m));
    return level;
  }
  const Held lower(PyObject_GetAttr(object, LOWER_NAME));
  const Held upper(PyObject_GetAttr(object, UPPER_NAME));
  if (!lower || !upper) PyErr_Clear();
  need(lower && upper);
  read_bounds(arena, lower, upper, level.m, level.lower, level.upper);
  return level;
}

// All steps as one row of doubles; `Record` in compiled.py reads it.
class Record {
 public:
  explicit Record(const Solver &solver) : n_(solver.n()) {
    const size_t head = n_ + 2 * solver.steps.size();
    size_t size = head;
    for (const Step &step : solver.steps) size += count(step);
    bytes_ = PyBytes_FromStringAndSize(nullptr, Py_ssize_t(size * sizeof(double)));
    if (!bytes_) return;
    at_ = PyBytes_AsString(bytes_);
    put(solver.whole, n_);
    for (const Step &step : solver.steps) put(&step.bend, 1);
    double begin = double(head);
    for (const Step &step : solver.steps) {
      put(&begin, 1);
      begin += double(count(step));
    }
    for (const Step &step : solver.steps) put(step);
  }

  PyObject *bytes() const { return bytes_; }

 private:
  static constexpr int HEAD = 8;

  size_t count(const Step &step) const {
    const Directions &its = step.directions;
    return HEAD + n_ + size_t(its.m + 2) * its.rank
        + size_t(n_) * (step.level->bounded ? 0 : its.Q.k)
        + (step.is_relaxed ? size_t(n_) * step.relaxed.k : 0)
        + (step.multipliers ? n_ : 0) + (step.row_multipliers ? step.rows : 0);
  }

  void put(const Step &step) {
    const Directions &its = step.directions;
    const bool demand = !step.level->bounded;
    const double head[HEAD] = {
        demand ? double(its.m) : -1.0, double(its.rank), demand ? double(its.Q.k) : 0.0,
        step.is_relaxed ? double(step.relaxed.k) : -1.0, step.multipliers ? 1.0 : 0.0,
        step.row_multipliers ? double(step.rows) : -1.0, its.size, step.bend};
    put(head, HEAD);
    put(step.velocity, n_);
    put(its.U, size_t(its.m) * its.rank);
    put(its.s, its.rank);
    if (demand) put(its.Q.p, size_t(n_) * its.Q.k);
    put(step.followed, its.rank);
    if (step.is_relaxed) put(step.relaxed.p, size_t(n_) * step.relaxed.k);
    if (step.multipliers) put(step.multipliers, n_);
    if (step.row_multipliers) put(step.row_multipliers, step.rows);
  }

  void put(const double *from, size_t count) {
    if (count) std::memcpy(at_, from, count * sizeof(double));
    at_ += count * sizeof(double);
  }

  int n_;
  PyObject *bytes_;
  char *at_ = nullptr;
};

// Solves one cycle; a nested call, from an attribute that is computed, goes to the reference.
class Cycle {
 public:
  explicit Cycle(Solver &solver) : solver_(solver) {
    need(!solver.busy);
    solver.busy = true;
    solver.begin();
  }
  Cycle(const Cycle &) = delete;
  ~Cycle() { solver_.busy = false; }

  PyObject *solve(PyObject *const *given) {
    PyObject *levels = given[0], *memory = given[5];
    need(PyList_Check(levels) && PyTuple_Check(memory));
    Arena &arena = solver_.arena;
    for (Py_ssize_t l = 0; l < PyList_Size(levels); ++l) {
      const Held level(Py_NewRef(PyList_GetItem(levels, l)));
      solver_.levels.push_back(read_level(arena, level, solver_.n()));
      solver_.memory.push_back(
          l < PyTuple_Size(memory) ? number(PyTuple_GetItem(memory, l)) : 0.0);
    }
    const double *lower = nullptr, *upper = nullptr, *cap = nullptr;
    if (given[1] != Py_None && given[2] != Py_None)
      read_bounds(arena, given[1], given[2], solver_.n(), lower, upper);
    if (given[4] != Py_None) cap = read(arena, given[4], solver_.n());
    for (int j = 0; cap && j < solver_.n(); ++j) need(cap[j] >= 0.0);
    const Buffer velocity(given[6], PyBUF_STRIDES | PyBUF_FORMAT | PyBUF_WRITABLE);
    need(velocity.is(solver_.n()));
    solver_.solve(lower, upper, number(given[3]), cap);
    velocity.fill(solver_.x);
    return answer();
  }

 private:
  // (memory, steps or None, slowed)
  PyObject *answer() const {
    Held memory(PyTuple_New(Py_ssize_t(solver_.memory.size())));
    if (!memory) return nullptr;
    for (size_t l = 0; l < solver_.memory.size(); ++l) {
      PyObject *h = PyFloat_FromDouble(solver_.memory[l]);
      if (!h || PyTuple_SetItem(memory, Py_ssize_t(l), h) != 0) return nullptr;
    }
    const Held steps(solver_.looped ? Record(solver_).bytes() : Py_NewRef(Py_None));
    const Held slowed(PyFloat_FromDouble(solver_.slowed));
    if (!steps || !slowed) return nullptr;
    return PyTuple_Pack(3, static_cast<PyObject *>(memory), static_cast<PyObject *>(steps),
                        static_cast<PyObject *>(slowed));
  }

  Solver &solver_;
};

// solve(levels, lower, upper, period, cap, memory, velocity): None where the reference is needed.
PyObject *solve(PyObject *self, PyObject *const *given, Py_ssize_t count) {
  if (count != 7) {
    PyErr_SetString(PyExc_TypeError,
                    "solve(levels, lower, upper, period, speed_cap, memory, velocity)");
    return nullptr;
  }
  try {
    return Cycle(of<Solver>(self)).solve(given);
  } catch (const Unsolved &) {
  } catch (const std::bad_alloc &) {
  }
  return Py_NewRef(Py_None);
}

bool read_weights(PyObject *object, int n, std::vector<double> &weights) {
  if (object == Py_None) return true;
  const Buffer buffer(object);
  if (!buffer.is(n)) return false;
  for (int j = 0; j < n; ++j) weights.push_back(buffer.at(j));
  return true;
}

PyObject *make(PyTypeObject *type, PyObject *given, PyObject *) {
  Options options;
  Damping &damping = options.damping;
  PyObject *weights;
  int uniform, fast;
  if (!PyArg_ParseTuple(given, "iddddOpp", &options.n, &damping.damping, &damping.singular_region,
                        &damping.release_region, &damping.regularisation, &weights, &uniform,
                        &fast)) return nullptr;
  options.uniform = uniform;
  options.fast = fast;
  try {
    if (options.n >= 1 && options.n <= MOST && read_weights(weights, options.n, options.weights))
      return keep<Solver>(type, options);
  } catch (const std::bad_alloc &) {
    return PyErr_NoMemory();
  }
  PyErr_SetString(PyExc_ValueError, "needs joints, and as many weights or None");
  return nullptr;
}

PyMethodDef METHODS[] = {
    method("solve", solve, "Solve one cycle."),
    {nullptr, nullptr, 0, nullptr}};
PyModuleDef MODULE = {PyModuleDef_HEAD_INIT, "core", "The solver, compiled.", -1,
                      nullptr, nullptr, nullptr, nullptr, nullptr};

PyObject *constants() {
  return Py_BuildValue(
      "{s:n,s:d,s:d,s:d,s:d,s:d,s:d,s:d,s:d,s:d,s:d,s:d,s:d,s:d,s:d,s:(dddd),s:(dd)}",
       "MOST", MOST, "SOFTEST", SOFTEST, "DEPENDENT", DEPENDENT,
       "LAST_DIGIT", LAST_DIGIT, "WELL_WEIGHTED", WELL_WEIGHTED,
      "NEGLIGIBLE", NEGLIGIBLE, "ROUNDING", ROUNDING, "FEASIBLE", FEASIBLE,
      "CURVATURE", CURVATURE, "TURNING", TURNING, "ROW_TURNING", ROW_TURNING, "FIRST", FIRST,
      "MEMORY", REMEMBERED, "WELL_CONDITIONED", WELL_CONDITIONED, "ROW_DAMPING", ROW_DAMPING,
      "TOLERANCES", TOLERANCES[0], TOLERANCES[1], TOLERANCES[2], TOLERANCES[3],
      "EXACT", EXACT[0], EXACT[1]);
}

bool intern(PyObject *&name, const char *text) {
  name = PyUnicode_InternFromString(text);
  return name != nullptr;
}

}  // namespace

PyMODINIT_FUNC PyInit_core(void) {
  if (!intern(J_NAME, "J") || !intern(V_NAME, "v") || !intern(MODE_NAME, "mode")
      || !intern(LOWER_NAME, "lower") || !intern(UPPER_NAME, "upper")
      || !intern(IDENTITY_NAME, "is_identity")) return nullptr;
  return make_module(MODULE, {
      {"Solver", make_type<Solver>("tp_controller.solver.core.Solver", make, METHODS)},
      {"CONSTANTS", constants()}});
}
