// Copyright 2026 tp_controller contributors
// SPDX-License-Identifier: Apache-2.0

// Support polygon: the convex hull of points in a plane, and the distances from its edges.
// Reference: tp_controller/model/support_polygon.py

#pragma once

#include <algorithm>
#include <cmath>
#include <numeric>
#include <vector>

namespace {

// Constant of the reference.
constexpr double COLLINEAR = 1e-9;

// An edge as a point sees it.
struct Edge {
  int first, last;
  double share, normal[2], distance;
};

class SupportPolygon {
 public:
  std::vector<Edge> edges;
  bool flat = false;

  // Find the edges of the hull of points (k, 2), seen from a point (2,).
  void find(const std::vector<double> &points, const double *seen) {
    points_ = points.data();
    find_corners(int(points.size() / 2));
    flat = corners_.size() < 3;
    edges.clear();
    for (size_t i = 0; i < (flat ? 1 : corners_.size()); ++i)
      edges.push_back(edge(corners_[i], corners_[(i + 1) % corners_.size()], seen));
  }

 private:
  // The corners of the convex hull, anticlockwise, from the one with the lowest index on.
  void find_corners(int count) {
    order_.resize(size_t(count));
    std::iota(order_.begin(), order_.end(), 0);
    std::stable_sort(order_.begin(), order_.end(), [this](int a, int b) {
      return std::make_pair(x(a), y(a)) < std::make_pair(x(b), y(b));
    });
    corners_.clear();
    chain(order_.begin(), order_.end());
    chain(order_.rbegin(), order_.rend());
    if (corners_.empty()) corners_.push_back(order_[0]);
    std::rotate(corners_.begin(), std::min_element(corners_.begin(), corners_.end()),
                corners_.end());
  }

  // Add the corners of one side of the hull, but for the last.
  template <typename Index>
  void chain(Index at, Index end) {
    const size_t begin = corners_.size();
    for (; at != end; ++at) {
      while (corners_.size() > begin + 1
             && turn(corners_[corners_.size() - 2], corners_.back(), *at) <= COLLINEAR)
        corners_.pop_back();
      corners_.push_back(*at);
    }
    const int first = corners_[begin], last = corners_.back();
    corners_.resize(x(first) != x(last) || y(first) != y(last) ? corners_.size() - 1 : begin);
  }

  // Twice the signed area of a triangle, positive anticlockwise.
  double turn(int one, int two, int three) const {
    return (x(two) - x(one)) * (y(three) - y(one)) - (y(two) - y(one)) * (x(three) - x(one));
  }

  Edge edge(int first, int last, const double *seen) const {
    const double along[2] = {x(last) - x(first), y(last) - y(first)};
    const double offset[2] = {seen[0] - x(first), seen[1] - y(first)};
    // A single point has no direction.
    const double square = std::max(along[0] * along[0] + along[1] * along[1], COLLINEAR);
    double share = (offset[0] * along[0] + offset[1] * along[1]) / square;
    if (!flat) {
      const double length = std::sqrt(square);
      const double normal[2] = {-along[1] / length, along[0] / length};
      return {first, last, share, {normal[0], normal[1]},
              offset[0] * normal[0] + offset[1] * normal[1]};
    }
    share = std::min(std::max(share, 0.0), 1.0);
    const double gap[2] = {offset[0] - share * along[0], offset[1] - share * along[1]};
    const double distance = std::sqrt(gap[0] * gap[0] + gap[1] * gap[1]);
    const double length = std::max(distance, COLLINEAR);
    return {first, last, share, {-gap[0] / length, -gap[1] / length}, -distance};
  }

  double x(int i) const { return points_[2 * i]; }
  double y(int i) const { return points_[2 * i + 1]; }

  const double *points_ = nullptr;
  std::vector<int> order_, corners_;
};

}  // namespace
