// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <limits>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include <interactive_mapping_common/config/schema.h>

#include "surface_picking/cuboids.h"

namespace surface_picking {

struct BodyConfig {
  /// A known body that shares more with a cuboid, along every axis, contradicts it: the cuboid counts.
  static constexpr double kOverlap_m = 0.03;
  /// A body that an update does not show is forgotten if so much of its inside was seen free.
  static constexpr double kFreeShare = 0.5;
  /// The map no longer has a body at its old place after more updates that look there and show none.
  static constexpr int kGoneUpdates = 3;

  double gate_m{0.08};
  double gate_rad{0.5};
  int max_missed{30};
  double put_back_m{0.08};

  static void fields(BodyConfig& c, interactive_mapping::Fields& f) {
    f("gate_m", c.gate_m, 0.005, 1.0, "m", "a cuboid nearer than this to a known body of its type can be this body");
    f("gate_rad", c.gate_rad, 0.01, 3.2, "rad", "the same of its rotation");
    f("max_missed", c.max_missed, 0, 1000, "updates",
      "a body is kept for so many updates that look at its place and do not show it");
    f("put_back_m", c.put_back_m, 0.0, 10.0, "m",
      "what appears this near to where a body was taken from, soon after it was let go, is this body");
  }
};

/// A body as known from all updates of the map.
struct Body {
  int id{0};
  Cuboid cuboid;
  int num_looks{0};   ///< updates that showed it
  int num_missed{0};  ///< updates since that looked for it
  double first_seen_s{0.0};
  double last_seen_s{0.0};
};

/// Which cuboid is which body, over updates of the map. An id is never given to another body. The map fuses what images
/// show, so the newest cuboid of a body replaces the one before; its axes are named as before. Not thread-safe.
class BodyTracker {
 public:
  /// Throws std::invalid_argument listing what is wrong with the config. `first_id`: nextId() of a tracker before this
  /// one, whose ids others may still know.
  explicit BodyTracker(const BodyConfig& config, int first_id = 0);

  struct Update {
    std::vector<std::size_t> seen;  ///< indices into bodies()
    std::vector<int> dropped;       ///< ids
  };

  /// Takes in the cuboids of an update. Nearest pairs of a type within the gate first, then pairs whose places agree though
  /// type or rotation do not: those were mistaken before. A body without a cuboid goes when a cuboid contradicts it, when
  /// `space` (may be empty) calls its inside free, or after max_missed updates. Cuboids at the old pose of the body in
  /// the hand are left out until the map has seen it empty. So they are after the body was let go elsewhere. Only what is
  /// wholly in `looked_at_map` was looked for: cuboids that are not are left out, and such bodies are not missed. Throws
  /// std::invalid_argument, and changes nothing, for a stamp that is before the last one. So it does for a stamp, pose
  /// or covariance that is not finite. What `space` throws it passes on; cuboids that are no known body are lost then.
  Update update(double stamp_s, const std::vector<Cuboid>& all_cuboids, const SpaceQuery& space,
                const Eigen::AlignedBox3d& looked_at_map = gpis_mapping::kEverywhere);

  /// The body is in the hand. Returns whether it was known.
  bool attach(int id);

  /// What was in the hand was let go at `stamp_s`. Near its old place, or at a place that is not known, it is the body that
  /// appears near the old one from then on.
  void detach(double stamp_s, const std::optional<Eigen::Vector3d>& place_map = std::nullopt);

  /// Forgets all bodies and the time. Ids go on counting.
  void clear();

  /// In order of their ids.
  const std::vector<Body>& bodies() const { return bodies_; }
  int nextId() const { return next_id_; }

 private:
  struct Taken {
    Body body;
    std::optional<double> released_s;
    bool is_elsewhere{false};  // let go there
    int num_missed{0};         // updates since; if it is elsewhere, those in a row that show nothing here
  };

  // Parts of update(), at last_stamp_s_ and of looked_at_.
  bool isLookedFor(const Cuboid& cuboid) const;
  bool hasLeftHand(const Taken& taken) const;
  /// Which cuboids are what the map still has of bodies that were taken.
  std::vector<bool> atTaken(const std::vector<Cuboid>& cuboids);
  /// The cuboid is the body.
  void show(const Cuboid& cuboid, Body* body);
  /// Returns the ids.
  std::vector<int> dropContradicted(const std::vector<Cuboid>& cuboids, const SpaceQuery& space);
  /// Of a cuboid that is no known body.
  void addSeen(const Cuboid& cuboid);

  BodyConfig config_;
  std::vector<Body> bodies_;
  std::vector<Taken> taken_;
  int next_id_;
  double last_stamp_s_{-std::numeric_limits<double>::infinity()};
  Eigen::AlignedBox3d looked_at_;
  std::set<int> shown_;  // by the last update
};

}  // namespace surface_picking
