// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include <Eigen/Geometry>
#include <base_navigation/navigation_grid.h>
#include <base_navigation/planar.h>
#include <gpis_mapping/ground_projection.h>
#include <interactive_mapping_common/config/schema.h>
#include <motion_planning/manipulability_sector.h>

#include "nbv_selection/failure_memory.h"
#include "nbv_selection/ground_frontier.h"
#include "nbv_selection/manipulability_score.h"
#include "nbv_selection/outline.h"
#include "nbv_selection/scene_model.h"
#include "nbv_selection/segment.h"
#include "nbv_selection/segment_attributes.h"
#include "nbv_selection/utility.h"

namespace nbv_selection {

/// How the best is found.
enum class Choice {
  kUtility,          // the candidate of largest utility; of equal ones the nearest
  kRandomCandidate,  // any candidate, with a probability in proportion to 1 - p
  kRandomSegment,    // any segment of an outline, and any place that shows unseen ground, whatever its verdict
};
inline constexpr interactive_mapping::Names<Choice> kChoiceNames = {{"utility", Choice::kUtility},
                                                                    {"random_candidate", Choice::kRandomCandidate},
                                                                    {"random_segment", Choice::kRandomSegment}};

struct ViewSelectorConfig {
  gpis_mapping::GroundOptions ground;  // only the options of estimateGround() matter
  OutlineConfig outline;
  SegmentConfig segments;
  ManipulabilityScoreConfig manipulability;
  UtilityConfig utility;
  GroundFrontierConfig exploration;
  Choice choice{Choice::kUtility};
  double imaginary_share{0.5};
  double standing_padding_m{0.02};
  double max_lost_share{0.1};
  double start_m{1.5};

  /// What estimateGround() needs.
  struct GroundPlaneOptions {
    gpis_mapping::GroundOptions& ground;

    static void fields(GroundPlaneOptions& c, interactive_mapping::Fields& f) {
      f("max_tilt_rad", c.ground.max_tilt_rad, 0.01, 0.8, "rad", "largest tilt of the ground against the map's z axis");
      f("plane_tolerance_m", c.ground.plane_tolerance_m, 0.002, 0.2, "m", "a point this near belongs to the ground");
    }
  };

  static void fields(ViewSelectorConfig& c, interactive_mapping::Fields& f) {
    f("choice", c.choice, kChoiceNames,
      "the largest utility; or, to compare with, drawn: any candidate, those of late failures less often, or any "
      "segment of an outline or pose that shows unseen ground, also one that cannot be driven to");
    f("imaginary_share", c.imaginary_share, 0.01, 1.0, "",
      "a segment above this share of the prior's uncertainty was never seen");
    f("standing_padding_m", c.standing_padding_m, 0.0, 0.5, "m", "padding of the footprint at a standing pose");
    f("max_lost_share", c.max_lost_share, 0.01, 1.0, "",
      "the map has changed during the selection when more than this share of the pile's surface has no data at the "
      "end");
    f("start_m", c.start_m, 0.0, 100.0, "m",
      "that a drive counts beside its length, where the robot may stay: it has to turn, to stop and to look again");
    UtilityConfig::fields(c.utility, f);
    GroundPlaneOptions plane{c.ground};
    f.section("ground", plane);
    f.section("outline", c.outline);
    f.section("segments", c.segments);
    f.section("manipulability", c.manipulability);
    f.section("exploration", c.exploration);
  }
};

/// Defaults for an OctomapScene, whose uncertainty has other units and values.
ViewSelectorConfig octomapSelectorConfig();

/// The robot as a selection needs it.
struct RobotBody {
  base_navigation::Polygon footprint;                             // base_link
  std::optional<motion_planning::ManipulabilitySectors> sectors;  // nothing: manipulability is 0 everywhere
  Eigen::Isometry3d T_base_armbase{Eigen::Isometry3d::Identity()};
  std::optional<Eigen::Isometry3d> T_base_camera;  // optical frame; nothing: no workspace can be asked for
};

/// No segment whose midpoint or standing place is in it is a candidate.
struct ExcludedZone {
  Eigen::Vector2d center_map{Eigen::Vector2d::Zero()};
  double radius_m{0.0};
};

struct SelectionRequest {
  std::shared_ptr<const base_navigation::NavigationGrid> ground;  // where the robot can stand and drive
  base_navigation::Pose2d T_map_base;                             // where it is
  std::vector<ExcludedZone> excluded;
  std::vector<Eigen::Vector2d>
      workspace_map;      // corners: poses that show its unseen ground are candidates, too; or empty
  bool may_stay{false};   // T_map_base is a candidate, too, while the arm reaches something from there
  double now_s{0.0};      // t of eq 8
  std::uint64_t seed{0};  // of what is drawn
};

/// Why a segment is a candidate, or is not; the first that applies.
using interactive_mapping::SegmentVerdict;

struct ScoredSegment {
  Segment segment;
  SegmentKind kind{SegmentKind::kReal};
  SegmentVerdict verdict{SegmentVerdict::kCandidate};
  double mean_uncertainty{0.0};  // along it, of imaginary ones too, whose attribute is 0
  Attributes attributes;
  Utility utility;  // all 0 if imaginary; utility 0 of whatever is no candidate
};

enum class SelectionStatus {
  kSelected,
  kEmptyMap,     // no surface
  kNoGround,     // no large level plane in it
  kNoPile,       // nothing above the ground
  kNoCandidate,  // segments, but none the robot may go to; `message` counts the reasons
  kLowUtility,   // the best is below min_utility
  kMapChanged,   // while it was asked: ask again with the surface of now
  kCancelled,
};
inline constexpr interactive_mapping::Names<SelectionStatus> kSelectionStatusNames = {
    {"selected", SelectionStatus::kSelected},        {"empty map", SelectionStatus::kEmptyMap},
    {"no ground", SelectionStatus::kNoGround},       {"no pile", SelectionStatus::kNoPile},
    {"no candidate", SelectionStatus::kNoCandidate}, {"low utility", SelectionStatus::kLowUtility},
    {"map changed", SelectionStatus::kMapChanged},   {"cancelled", SelectionStatus::kCancelled}};
constexpr const char* toString(SelectionStatus status) {
  return interactive_mapping::nameOf(status, kSelectionStatusNames);
}

struct Selection {
  SelectionStatus status{SelectionStatus::kNoCandidate};
  std::string message;              // in words, with numbers; empty if selected
  std::optional<std::size_t> best;  // also with kLowUtility: the best there is
  std::vector<ScoredSegment> segments;
  std::vector<ManipulabilitySample> reach_samples;  // of the candidate with the largest manipulability, to be shown
  PileOutline outline;
  std::vector<Eigen::Vector2d> workspace_map;  // of the request
  std::vector<Eigen::Vector2d> unseen_map;     // middles of the cells of the workspace's unseen ground (GroundFrontier)
  double unseen_m2{0.0};                       // of it, in patches of which a candidate shows a part
  double prior_uncertainty{0.0};               // where nothing was ever seen
  std::uint64_t map_update{0};
  double map_stamp_s{0.0};
};

/// One more factor in the sum of eq 9.
struct ExtraFactor {
  std::string name;                                   // for messages
  double weight{0.0};                                 // in [0, 1]; the five of UtilityConfig share the rest
  std::function<double(const ScoredSegment&)> value;  // of a segment with attributes, in [0, 1]
};

/// What a strategy adds to a ViewSelector or replaces in it.
struct Extension {
  std::vector<ExtraFactor> factors;
  /// Called if there is a candidate, with the status and the best that Choice and min_utility give. Returns the index of
  /// the best or of another candidate; nothing: none is worth a drive (kLowUtility). Null: the best stays.
  std::function<std::optional<std::size_t>(const Selection&)> choose;
};

/// The next best view (eq 8) among the segments of the pile, whatever map shows them.
class ViewSelector {
 public:
  /// Throws std::invalid_argument listing every impossible value.
  ViewSelector(const ViewSelectorConfig& config, RobotBody robot, Extension extension = {});

  /// `tell`, if any, gets each stage with the number of segments so far; `is_cancelled`, if any, is asked between
  /// stages and map queries. The same arguments give the same selection. Throws std::invalid_argument for a request
  /// that is not finite or has no ground. Throws std::runtime_error if the map does not answer or a result of the
  /// extension is impossible.
  Selection select(const SceneModel& scene, const FailureMemory& failures, const SelectionRequest& request,
                   const std::function<void(const std::string& stage, std::size_t segments)>& tell = {},
                   const std::function<bool()>& is_cancelled = {}) const;

  const ViewSelectorConfig& config() const { return config_; }
  const RobotBody& robot() const { return robot_; }

 private:
  ViewSelectorConfig config_;
  RobotBody robot_;
  Extension extension_;
  double num_reach_samples_{0.0};  // N of eq 14, the same in every selection
};

}  // namespace nbv_selection
