// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <map>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "simulated_world/judge_event.h"
#include "simulated_world/world_observation.h"

namespace simulated_world {

/// Names of bodies as they come in contacts.
struct CollisionConfig {
  std::set<std::string> wheel_bodies{"wheel_front_left_link", "wheel_front_right_link"};
  std::string ground_body{"ground"};
  std::string tool_body{"magnet"};
  std::string container_body{"container"};
  double end_gap_s{0.5};  ///< without contact for so long, an episode is over

  std::vector<std::string> validate() const;
};

/// Counts what the robot hits. One collision is one episode of contact between a body of the robot and another body,
/// however often they lose touch for a moment.
///
/// Permitted are: a wheel and the ground; the tool and the target, or a brick that it holds or has just released; the
/// container and a brick that the tool holds, has released or has dropped, or that is stowed. (The container's job is with
/// carried bricks; one that ploughs through the pile is a collision.) Everything else counts. Contacts of a carried
/// brick are of a kind of their own, counted in the same way.
class CollisionMonitor {
 public:
  /// Throws std::invalid_argument with all that is wrong with `config`.
  explicit CollisionMonitor(const CollisionConfig& config);

  /// Observations come with increasing time.
  std::vector<JudgeEvent> observe(const WorldObservation& observation);

  /// Ends the episodes that are still open, in order of their bodies' names.
  std::vector<JudgeEvent> finish();

  int collisions() const { return collisions_; }
  int loadContacts() const { return load_contacts_; }

  /// Largest force of any collision so far, 0 without one.
  double maxForce() const { return max_force_N_; }

 private:
  struct Episode {
    double begin_s;
    double last_s;
    double max_force_N;
    bool is_of_load;
    Eigen::Vector3d p_map;  // of its first contact
  };
  using Pair = std::pair<std::string, std::string>;

  static JudgeEvent eventOf(const std::pair<const Pair, Episode>& entry, bool has_ended, double time_s);
  bool isPermitted(const RobotContact& contact, const WorldObservation& observation) const;

  CollisionConfig config_;
  std::map<Pair, Episode> open_;
  int collisions_{0};
  int load_contacts_{0};
  double max_force_N_{0.0};
};

}  // namespace simulated_world
