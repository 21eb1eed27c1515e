// SPDX-License-Identifier: BSD-3-Clause
#include "synthetic_depth/pile.h"

#include <algorithm>
#include <cmath>
#include <sstream>
#include <stdexcept>

#include "polygon.h"
#include "synthetic_depth/seeded_random.h"

namespace synthetic_depth {
namespace {

constexpr double kSameHeight_m = 1e-6;
// The centre of mass must be this far inside the hull of the contacts, as a share of the brick's short side.
constexpr double kBalanceMargin = 0.1;
constexpr double kLeastContactShare = 0.5;
constexpr int kTriesPerBrick = 400;

struct Brick {
  Eigen::Vector2d center;
  double yaw;
  double top;
  Polygon base;  // counter-clockwise
};

Polygon footprint(const Eigen::Vector2d& center, double yaw, double half_length, double half_width) {
  const Eigen::Vector2d along = half_length * Eigen::Vector2d(std::cos(yaw), std::sin(yaw));
  const Eigen::Vector2d across = half_width * Eigen::Vector2d(-std::sin(yaw), std::cos(yaw));
  return {center - along - across, center + along - across, center + along + across, center - along + across};
}

/// Part of `subject` on the inner side of every edge of `window`; both convex and counter-clockwise.
Polygon intersection(Polygon subject, const Polygon& window) {
  for (std::size_t i = 0; i < window.size() && !subject.empty(); ++i) {
    const Eigen::Vector2d& origin = window[i];
    const Eigen::Vector2d edge = window[(i + 1) % window.size()] - origin;
    Polygon inside;
    for (std::size_t k = 0; k < subject.size(); ++k) {
      const Eigen::Vector2d& a = subject[k];
      const Eigen::Vector2d& b = subject[(k + 1) % subject.size()];
      const double side_a = cross(edge, a - origin);
      const double side_b = cross(edge, b - origin);
      if (side_a >= 0.0) {
        inside.push_back(a);
      }
      if (side_a * side_b < 0.0) {
        inside.push_back(a + (b - a) * (side_a / (side_a - side_b)));
      }
    }
    subject = inside;
  }
  return subject;
}

/// Counter-clockwise hull (Andrew's monotone chain).
Polygon convexHull(Polygon points) {
  std::sort(points.begin(), points.end(), [](const Eigen::Vector2d& a, const Eigen::Vector2d& b) {
    return a.x() != b.x() ? a.x() < b.x() : a.y() < b.y();
  });
  Polygon hull;
  const auto extendBy = [&hull](const Eigen::Vector2d& p, std::size_t floor_size) {
    while (hull.size() >= floor_size + 2 && cross(hull.back() - hull[hull.size() - 2], p - hull.back()) <= 0.0) {
      hull.pop_back();
    }
    hull.push_back(p);
  };
  for (const Eigen::Vector2d& p : points) {
    extendBy(p, 0);
  }
  const std::size_t lower_size = hull.size() - 1;
  for (auto p = points.rbegin(); p != points.rend(); ++p) {
    extendBy(*p, lower_size);
  }
  hull.pop_back();
  return hull;
}

bool isInsideBy(const Polygon& hull, const Eigen::Vector2d& p, double margin) {
  for (std::size_t i = 0; i < hull.size(); ++i) {
    const Eigen::Vector2d edge = hull[(i + 1) % hull.size()] - hull[i];
    if (cross(edge, p - hull[i]) < margin * edge.norm()) {
      return false;
    }
  }
  return hull.size() >= 3;
}

using Overlaps = std::vector<std::pair<const Brick*, Polygon>>;

/// Where a brick at this height rests on those below: corners and area.
std::pair<Polygon, double> contactAt(double resting_height, const Overlaps& overlaps) {
  std::pair<Polygon, double> contact;
  for (const auto& [below, overlap] : overlaps) {
    if (std::abs(below->top - resting_height) < kSameHeight_m) {
      contact.first.insert(contact.first.end(), overlap.begin(), overlap.end());
      contact.second += area(overlap);
    }
  }
  return contact;
}

}  // namespace

std::vector<std::string> PileConfig::validate() const {
  std::vector<std::string> problems;
  const auto check = [&problems](bool is_good, const std::string& key, double value, const std::string& rule) {
    if (!is_good) {
      std::ostringstream text;
      text << "pile/" << key << " = " << value << ", must be " << rule;
      problems.push_back(text.str());
    }
  };
  check(brick_size_m.allFinite() && brick_size_m.minCoeff() > 0.0, "brick_size_m", brick_size_m.minCoeff(), "> 0 m");
  check(extent_m > brick_size_m.head<2>().norm(), "extent_m", extent_m, "> the diagonal of a brick's base, m");
  check(height_m >= brick_size_m.z(), "height_m", height_m, ">= the height of a brick, m");
  check(max_bricks >= 1 && max_bricks <= 10000, "max_bricks", max_bricks, "in [1, 10000]");
  check(remove_topmost >= 0 && remove_topmost <= max_bricks, "remove_topmost", remove_topmost, "in [0, max_bricks]");
  check(first_id >= 0, "first_id", first_id, ">= 0");
  return problems;
}

std::vector<Box> makePile(const PileConfig& config) {
  const std::vector<std::string> problems = config.validate();
  if (!problems.empty()) {
    std::string text;
    for (const std::string& problem : problems) {
      text += (text.empty() ? "" : "\n") + problem;
    }
    throw std::invalid_argument(text);
  }

  const double half_length = 0.5 * config.brick_size_m.x();
  const double half_width = 0.5 * config.brick_size_m.y();
  const double brick_height = config.brick_size_m.z();
  const double base_area = 4.0 * half_length * half_width;
  const double center_radius = 0.5 * config.extent_m - std::hypot(half_length, half_width);
  SeededRandom random(config.seed);
  std::vector<Brick> bricks;
  for (int attempt = 0; attempt < kTriesPerBrick * config.max_bricks; ++attempt) {
    if (static_cast<int>(bricks.size()) == config.max_bricks) {
      break;
    }
    const double radius = center_radius * std::sqrt(random.uniform());
    const double bearing = random.uniform(-M_PI, M_PI);
    const double yaw = random.uniform(-M_PI, M_PI);
    const Eigen::Vector2d center = config.center_m + radius * Eigen::Vector2d(std::cos(bearing), std::sin(bearing));
    const Polygon base = footprint(center, yaw, half_length, half_width);

    double resting_height = 0.0;
    Overlaps overlaps;
    for (const Brick& below : bricks) {
      Polygon overlap = intersection(base, below.base);
      if (overlap.size() >= 3 && area(overlap) > 1e-10) {
        resting_height = std::max(resting_height, below.top);
        overlaps.emplace_back(&below, std::move(overlap));
      }
    }
    const double share_of_radius = radius / center_radius;
    const double envelope = std::max(brick_height, config.height_m * (1.0 - share_of_radius * share_of_radius));
    if (resting_height + brick_height > envelope + kSameHeight_m) {
      continue;
    }
    if (resting_height > 0.0) {
      const auto [contact_points, contact_area] = contactAt(resting_height, overlaps);
      if (contact_area < kLeastContactShare * base_area ||
          !isInsideBy(convexHull(contact_points), center, kBalanceMargin * 2.0 * half_width)) {
        continue;
      }
    }
    bricks.push_back({center, yaw, resting_height + brick_height, base});
  }
  if (static_cast<int>(bricks.size()) < config.remove_topmost) {
    throw std::invalid_argument("pile/remove_topmost = " + std::to_string(config.remove_topmost) +
                                ", must be at most the " + std::to_string(bricks.size()) +
                                " bricks that fit the envelope");
  }

  std::vector<Box> boxes;
  for (const Brick& brick : bricks) {
    Box box;
    box.id = config.first_id + static_cast<int>(boxes.size());
    box.half_extents_m = 0.5 * config.brick_size_m;
    box.T_scene_box =
        poseFromXyzRpy({brick.center.x(), brick.center.y(), brick.top - 0.5 * brick_height}, {0.0, 0.0, brick.yaw});
    boxes.push_back(box);
  }
  // What a brick carries is always higher than the brick, so the highest carry nothing but each other.
  std::vector<std::size_t> order(boxes.size());
  for (std::size_t i = 0; i < order.size(); ++i) {
    order[i] = i;
  }
  std::stable_sort(order.begin(), order.end(),
                   [&bricks](std::size_t a, std::size_t b) { return bricks[a].top > bricks[b].top + kSameHeight_m; });
  for (int i = 0; i < config.remove_topmost; ++i) {
    boxes[order[static_cast<std::size_t>(i)]].vanishes_at_frame = config.remove_at_frame;
  }
  return boxes;
}

}  // namespace synthetic_depth
