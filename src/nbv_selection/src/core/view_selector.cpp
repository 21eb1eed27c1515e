// SPDX-License-Identifier: BSD-3-Clause
#include "nbv_selection/view_selector.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <iomanip>
#include <limits>
#include <random>
#include <sstream>
#include <stdexcept>
#include <utility>

#include <base_navigation/base_planner.h>
#include <base_navigation/distance_field.h>
#include <base_navigation/footprint_checker.h>
#include <interactive_mapping_common/geometry/polygon.h>

namespace nbv_selection {
namespace {

/// RANSAC's cost grows with the samples, its answer does not change with more than this.
constexpr std::size_t kMaxGroundSamples = 20000;
/// A share is known from so many to 3 %.
constexpr std::size_t kMaxProbes = 300;
/// Poses from which unseen ground is looked for: half of what a camera sees at once lies between neighbours.
constexpr double kLookStep_m = 0.5;
constexpr int kNumLookHeadings = 8;

void requireSameLengths(const MappedSurface& surface) {
  const std::size_t n = surface.points_map.size();
  if (surface.normals_map.size() == n && surface.uncertainty.size() == n) return;
  throw std::runtime_error("a surface of " + std::to_string(n) + " points has " +
                           std::to_string(surface.normals_map.size()) + " normals and " +
                           std::to_string(surface.uncertainty.size()) + " uncertainties, must be as many");
}

std::optional<gpis_mapping::GroundPlane> groundOf(const MappedSurface& surface,
                                                  const gpis_mapping::GroundOptions& options) {
  const std::size_t stride = surface.points_map.size() / kMaxGroundSamples + 1;
  if (stride == 1) return gpis_mapping::estimateGround(surface.points_map, surface.normals_map, options);
  std::vector<Eigen::Vector3d> points;
  std::vector<Eigen::Vector3f> normals;
  for (std::size_t i = 0; i < surface.points_map.size(); i += stride) {
    points.push_back(surface.points_map[i]);
    normals.push_back(surface.normals_map[i]);
  }
  return gpis_mapping::estimateGround(points, normals, options);
}

/// Share of samples of the pile's surface, as it was, of which the map knows nothing now.
double lostShare(const SceneModel& scene, const MappedSurface& surface, const gpis_mapping::GroundPlane& ground,
                 const OutlineConfig& outline) {
  std::vector<Eigen::Vector3d> pile;
  for (const Eigen::Vector3d& p : surface.points_map) {
    if (!p.allFinite()) continue;
    const double height = ground.heightOf(p);
    if (height >= outline.min_height_m && height <= outline.max_height_m) pile.push_back(p);
  }
  if (pile.empty()) return 0.0;
  const std::size_t count = std::min(pile.size(), kMaxProbes);
  gpis_mapping::Points3d probes(3, static_cast<Eigen::Index>(count));
  for (std::size_t i = 0; i < count; ++i) probes.col(static_cast<Eigen::Index>(i)) = pile[i * pile.size() / count];
  const std::vector<bool> is_there = scene.occupancy(probes).is_supported;
  if (is_there.size() != count) {
    throw std::runtime_error("the map answered for " + std::to_string(is_there.size()) + " of " +
                             std::to_string(count) + " points");
  }
  return static_cast<double>(std::count(is_there.begin(), is_there.end(), false)) / static_cast<double>(count);
}

bool isIn(const ExcludedZone& zone, const Eigen::Vector2d& p_map) {
  return (p_map - zone.center_map).norm() <= zone.radius_m;
}

void requireFinite(const std::string& key, double value, const char* unit) {
  if (std::isfinite(value)) return;
  std::ostringstream text;
  text << key << " = " << value << " " << unit << ", must be finite";
  throw std::invalid_argument(text.str());
}

void requirePossible(const SelectionRequest& request) {
  if (!request.ground) throw std::invalid_argument("ground is null, must be the grid that the base drives on");
  requireFinite("T_map_base.x_m", request.T_map_base.x_m, "m");
  requireFinite("T_map_base.y_m", request.T_map_base.y_m, "m");
  requireFinite("T_map_base.yaw_rad", request.T_map_base.yaw_rad, "rad");
  const std::string workspace = interactive_mapping::problemOfPolygon(request.workspace_map);
  if (!request.workspace_map.empty() && !workspace.empty()) throw std::invalid_argument("workspace_map " + workspace);
  requireFinite("now_s", request.now_s, "s");
  for (std::size_t i = 0; i < request.excluded.size(); ++i) {
    const ExcludedZone& zone = request.excluded[i];
    const std::string key = "excluded[" + std::to_string(i) + "].";
    requireFinite(key + "center_map.x", zone.center_map.x(), "m");
    requireFinite(key + "center_map.y", zone.center_map.y(), "m");
    requireFinite(key + "radius_m", zone.radius_m, "m");
    if (zone.radius_m < 0.0) {
      throw std::invalid_argument(key + "radius_m = " + std::to_string(zone.radius_m) + " m, must be at least 0 m");
    }
  }
}

std::string describeVerdicts(const std::vector<ScoredSegment>& segments) {
  std::array<std::size_t, interactive_mapping::kNumSegmentVerdict> counts{};
  for (const ScoredSegment& scored : segments) ++counts[static_cast<std::size_t>(scored.verdict)];
  std::ostringstream text;
  text << "none of " << segments.size() << " segments can be driven to:";
  const char* separator = " ";
  for (std::size_t i = 0; i < counts.size(); ++i) {
    if (counts[i] == 0) continue;
    text << separator << counts[i] << " " << toString(static_cast<SegmentVerdict>(i));
    separator = ", ";
  }
  return text.str();
}

/// Largest utility; of equal ones the nearest, then the first.
std::optional<std::size_t> bestOf(const std::vector<ScoredSegment>& segments) {
  std::optional<std::size_t> best;
  for (std::size_t i = 0; i < segments.size(); ++i) {
    if (segments[i].verdict != SegmentVerdict::kCandidate) continue;
    if (!best) {
      best = i;
      continue;
    }
    const double gain = segments[i].utility.utility - segments[*best].utility.utility;
    if (gain > 0.0 || (gain == 0.0 && segments[i].attributes.distance_m < segments[*best].attributes.distance_m)) {
      best = i;
    }
  }
  return best;
}

/// Draws. Of candidates those of late failures less often.
std::optional<std::size_t> randomOf(const std::vector<ScoredSegment>& segments, Choice choice, std::uint64_t seed) {
  std::vector<std::size_t> candidates;
  std::vector<double> weights;
  for (std::size_t i = 0; i < segments.size(); ++i) {
    if (choice == Choice::kRandomSegment) {
      if (segments[i].kind != SegmentKind::kReal && segments[i].kind != SegmentKind::kGround) continue;
    } else if (segments[i].verdict != SegmentVerdict::kCandidate) {
      continue;
    }
    candidates.push_back(i);
    weights.push_back(choice == Choice::kRandomSegment ? 1.0 : 1.0 - segments[i].utility.failure_penalty);
  }
  if (candidates.empty()) return std::nullopt;
  double total = 0.0;
  for (const double weight : weights) total += weight;
  if (!(total > 0.0)) std::fill(weights.begin(), weights.end(), 1.0);
  std::mt19937_64 random(seed);
  std::discrete_distribution<std::size_t> pick(weights.begin(), weights.end());
  return candidates[pick(random)];
}

/// Where a failure counts against the segment: its standing pose, then its middle, then its samples.
std::vector<Eigen::Vector2d> placesOf(const Segment& segment) {
  std::vector<Eigen::Vector2d> places{segment.standing_map.position(), segment.midpoint_map.head<2>()};
  for (const Eigen::Vector3d& sample : segment.samples_map) places.emplace_back(sample.head<2>());
  return places;
}

/// Of a segment whose attributes and utility are known.
SegmentVerdict verdictOf(const ScoredSegment& scored, const std::vector<ExcludedZone>& excluded,
                         base_navigation::SpaceState below, bool has_approach, const PileOutline& outline) {
  const Eigen::Vector2d standing_map = scored.segment.standing_map.position();
  const Eigen::Vector2d midpoint_map = scored.segment.midpoint_map.head<2>();
  const bool is_excluded = std::any_of(excluded.begin(), excluded.end(), [&](const ExcludedZone& zone) {
    return isIn(zone, standing_map) || isIn(zone, midpoint_map);
  });
  if (is_excluded) return SegmentVerdict::kExcluded;
  if (below == base_navigation::SpaceState::kOccupied) return SegmentVerdict::kOccupied;
  if (below == base_navigation::SpaceState::kUnknown) return SegmentVerdict::kUnknownGround;
  if (std::isinf(scored.attributes.distance_m) || !has_approach) return SegmentVerdict::kUnreachable;
  // The middle of unseen ground may be elsewhere than what is seen of it.
  const bool faces_middle = scored.kind != SegmentKind::kGround;
  if (faces_middle && outline.isWallBetween(standing_map, midpoint_map)) return SegmentVerdict::kBehindWall;
  Attributes but_travel = scored.attributes;
  but_travel.distance_m = 0.0;
  const bool is_finite = but_travel.isFinite() && std::isfinite(scored.utility.utility);
  return is_finite ? SegmentVerdict::kCandidate : SegmentVerdict::kBadAttribute;
}

/// What segments are scored by.
struct Scoring {
  const UtilityConfig& utility;
  const std::vector<ExtraFactor>& extra;
  double start_m;  // of each drive
  const SelectionRequest& request;
  const FailureMemory& failures;
  const std::optional<ManipulabilityScore>& manipulability;
  const base_navigation::DistanceField& distances;
  const base_navigation::FootprintChecker& standing;
  const base_navigation::FootprintChecker& driving;
  const PileOutline& outline;

  ScoredSegment score(const Segment& segment, SegmentKind kind, const SegmentUncertainty& uncertainty) const {
    ScoredSegment scored;
    scored.segment = segment;
    scored.kind = kind;
    scored.mean_uncertainty = uncertainty.mean;
    scored.attributes.distance_m = start_m + distances.distance(segment.standing_map.position());
    if (kind == SegmentKind::kImaginary) {
      scored.verdict = SegmentVerdict::kIsImaginary;  // m, h and sigma^2 stay 0, and so does the utility
      return scored;
    }
    if (manipulability) scored.attributes.manipulability = manipulability->at(segment.standing_map);
    setAlong(segment, uncertainty, &scored.attributes);
    const base_navigation::SpaceState below = standing.check(segment.standing_map).state;
    weigh(below, below == base_navigation::SpaceState::kFree && hasApproach(segment.standing_map), &scored);
    return scored;
  }

  /// The robot's own pose before `segment`, the stretch of outline that is the nearest. Its ground is not asked: the robot
  /// stands there. Nothing: the arm reaches nothing from there, so that staying is of no use.
  std::optional<ScoredSegment> scoreHere(const Segment& segment, SegmentKind kind,
                                         const SegmentUncertainty& uncertainty) const {
    ScoredSegment scored;
    scored.segment = segment;
    scored.segment.standing_map = request.T_map_base;
    scored.kind = SegmentKind::kHere;
    scored.mean_uncertainty = uncertainty.mean;
    if (manipulability) scored.attributes.manipulability = manipulability->at(request.T_map_base);
    if (!(scored.attributes.manipulability > 0.0)) return std::nullopt;
    if (kind != SegmentKind::kImaginary) setAlong(segment, uncertainty, &scored.attributes);
    weigh(base_navigation::SpaceState::kFree, true, &scored);
    return scored;
  }

  /// For each patch of unseen ground the pose that shows some of it with the largest utility: m = h = sigma^2 = 0, f by the
  /// area of all patches that it shows. A patch that no reachable pose shows is unreachable.
  std::vector<ScoredSegment> scoreGround(const GroundFrontier& frontier, const gpis_mapping::GroundPlane& ground,
                                         const GroundFrontierConfig& config) const {
    std::vector<ScoredSegment> best;
    Eigen::AlignedBox2d box;
    for (const GroundFrontier::Patch& patch : frontier.patches()) {
      for (const Eigen::Vector2d& cell : patch.cells_map) box.extend(cell);
      ScoredSegment none;
      none.kind = SegmentKind::kGround;
      none.verdict = SegmentVerdict::kUnreachable;
      none.attributes.distance_m = std::numeric_limits<double>::infinity();
      const Eigen::Vector2d& middle = patch.cells_map[patch.cells_map.size() / 2];
      none.segment.midpoint_map << middle, ground.zAt(middle.x(), middle.y());
      none.segment.standing_map = request.T_map_base;
      best.push_back(none);
    }
    if (best.empty()) return best;
    const Eigen::Vector2d from = box.min() - Eigen::Vector2d::Constant(config.max_range_m);
    const Eigen::Vector2d to = box.max() + Eigen::Vector2d::Constant(config.max_range_m);
    for (double y_m = from.y(); y_m <= to.y(); y_m += kLookStep_m) {
      for (double x_m = from.x(); x_m <= to.x(); x_m += kLookStep_m) {
        if (!std::isfinite(distances.distance({x_m, y_m}))) continue;
        for (int k = 0; k < kNumLookHeadings; ++k) {
          lookFrom({x_m, y_m, base_navigation::wrapAngle(2.0 * M_PI * k / kNumLookHeadings)}, frontier, config, &best);
        }
      }
    }
    return best;
  }

 private:
  /// Takes the place of the best of each patch that it shows some of, if its utility is larger.
  void lookFrom(const base_navigation::Pose2d& T_map_base, const GroundFrontier& frontier,
                const GroundFrontierConfig& config, std::vector<ScoredSegment>* best) const {
    const std::vector<double> areas_m2 = frontier.areasSeenFrom(T_map_base);
    double area_m2 = 0.0;
    for (const double one_m2 : areas_m2) area_m2 += one_m2;
    // A patch of which less is left to be seen is too small to be gone to.
    const double least_m2 = 0.5 * config.min_area_m2;
    if (area_m2 < least_m2) return;
    ScoredSegment scored;
    scored.kind = SegmentKind::kGround;
    scored.segment.standing_map = T_map_base;
    scored.attributes.distance_m = start_m + distances.distance(T_map_base.position());
    scored.attributes.frontier = frontierOfArea(area_m2, config.full_area_m2, utility.of(Factor::kFrontier).logistic);
    std::optional<bool> may_stand;  // asked for the few that are better
    for (std::size_t i = 0; i < areas_m2.size(); ++i) {
      if (areas_m2[i] < least_m2) continue;
      ScoredSegment& other = (*best)[i];
      scored.segment.midpoint_map = other.segment.midpoint_map;
      weigh(base_navigation::SpaceState::kFree, true, &scored);
      const bool is_first = other.verdict != SegmentVerdict::kCandidate;
      if (scored.verdict != SegmentVerdict::kCandidate) continue;
      if (!is_first && scored.utility.utility <= other.utility.utility) continue;
      if (!may_stand) may_stand = standing.isFree(T_map_base) && hasApproach(T_map_base);
      if (!*may_stand) return;
      other = scored;
    }
  }

  static void setAlong(const Segment& segment, const SegmentUncertainty& uncertainty, Attributes* attributes) {
    attributes->height_m = pileHeight(segment);
    attributes->uncertainty = uncertainty.mean;
    attributes->frontier = uncertainty.frontier;
  }

  /// By the parameters that the base's planner has by default.
  bool hasApproach(const base_navigation::Pose2d& T_map_base) const {
    return base_navigation::roomToApproach(standing, driving, T_map_base, {}).longest_m.has_value();
  }

  /// Utility and verdict of what has its attributes.
  void weigh(base_navigation::SpaceState below, bool has_approach, ScoredSegment* scored) const {
    const double since_failure_s = request.now_s - failures.lastFailure(placesOf(scored->segment));
    scored->utility = computeUtility(scored->attributes, since_failure_s, utility);
    scored->verdict = verdictOf(*scored, request.excluded, below, has_approach, outline);
    if (scored->verdict != SegmentVerdict::kCandidate) {
      scored->utility.utility = 0.0;
    } else if (!extra.empty()) {
      addExtra(scored);
    }
  }

  /// Eq 9 with the strategy's own factors, then eq 8 again.
  void addExtra(ScoredSegment* scored) const {
    double information = 0.0, rest = 1.0;
    for (const ExtraFactor& factor : extra) {
      const double value = factor.value(*scored);
      if (!(value >= 0.0 && value <= 1.0)) {
        throw std::runtime_error("factor " + factor.name + " = " + std::to_string(value) + ", must be in [0, 1]");
      }
      information += factor.weight * value;
      rest -= factor.weight;
    }
    scored->utility.information = information + std::max(rest, 0.0) * scored->utility.information;
    scored->utility.utility = (1.0 - scored->utility.failure_penalty) * scored->utility.information;
  }
};

/// The segment whose standing pose is nearest to the robot. Nothing: there are no segments.
std::optional<std::size_t> nearestTo(const base_navigation::Pose2d& T_map_base, const std::vector<Segment>& segments) {
  std::optional<std::size_t> nearest;
  double least_m = std::numeric_limits<double>::infinity();
  for (std::size_t i = 0; i < segments.size(); ++i) {
    const double distance_m = (segments[i].standing_map.position() - T_map_base.position()).norm();
    if (distance_m >= least_m) continue;
    least_m = distance_m;
    nearest = i;
  }
  return nearest;
}

/// The selection's segments of unseen ground: one for each patch, in their order, the last ones.
std::size_t firstGround(const Selection& selection, const GroundFrontier& frontier) {
  return selection.segments.size() - frontier.patches().size();
}

void noteUnseen(const GroundFrontier& frontier, Selection* selection) {
  for (std::size_t i = 0; i < frontier.patches().size(); ++i) {
    const GroundFrontier::Patch& patch = frontier.patches()[i];
    selection->unseen_map.insert(selection->unseen_map.end(), patch.cells_map.begin(), patch.cells_map.end());
    const ScoredSegment& view = selection->segments[firstGround(*selection, frontier) + i];
    if (view.verdict == SegmentVerdict::kCandidate) selection->unseen_m2 += patch.area_m2;
  }
}

/// What of the workspace cannot be seen; empty: nothing.
std::string describeHidden(const Selection& selection, const std::optional<GroundFrontier>& frontier) {
  if (!frontier) return "";
  std::ostringstream text;
  text << std::fixed << std::setprecision(1);
  for (std::size_t i = 0; i < frontier->patches().size(); ++i) {
    const ScoredSegment& view = selection.segments[firstGround(selection, *frontier) + i];
    if (view.verdict == SegmentVerdict::kCandidate) continue;
    const Eigen::Vector3d& p_map = view.segment.midpoint_map;
    text << (text.tellp() > 0 ? ", " : "; no reachable pose shows the unseen ground of the workspace: ")
         << frontier->patches()[i].area_m2 << " m^2 at (" << p_map.x() << ", " << p_map.y() << ") m";
  }
  return text.str();
}

/// Null: there is no candidate.
const ScoredSegment* mostManipulable(const std::vector<ScoredSegment>& segments) {
  const ScoredSegment* most = nullptr;
  for (const ScoredSegment& scored : segments) {
    if (scored.verdict != SegmentVerdict::kCandidate) continue;
    if (most == nullptr || scored.attributes.manipulability > most->attributes.manipulability) most = &scored;
  }
  return most;
}

void requirePossible(const std::vector<ExtraFactor>& factors) {
  double sum = 0.0;
  for (const ExtraFactor& factor : factors) {
    if (!factor.value) throw std::invalid_argument("factor " + factor.name + " has no value, must be a function");
    if (!(factor.weight >= 0.0 && factor.weight <= 1.0)) {
      throw std::invalid_argument("weight of factor " + factor.name + " = " + std::to_string(factor.weight) +
                                  ", must be in [0, 1]");
    }
    sum += factor.weight;
  }
  if (sum <= 1.0 + 1e-6) return;  // thirds with seven decimals, as UtilityConfig
  throw std::invalid_argument("weights of the extra factors: their sum = " + std::to_string(sum) +
                              ", must be at most 1");
}

/// With the strategy's own choice. Throws std::runtime_error if that is no candidate.
void rechoose(const Extension& extension, Selection* selection) {
  const std::optional<std::size_t> chosen = extension.choose(*selection);
  if (!chosen) {
    if (selection->status == SelectionStatus::kSelected) selection->message = "the strategy chose no candidate";
    selection->status = SelectionStatus::kLowUtility;
    return;
  }
  const std::vector<ScoredSegment>& segments = selection->segments;
  const bool is_candidate = *chosen < segments.size() && segments[*chosen].verdict == SegmentVerdict::kCandidate;
  if (!is_candidate && chosen != selection->best) {
    throw std::runtime_error("the strategy chose segment " + std::to_string(*chosen) + " of " +
                             std::to_string(segments.size()) + ", must be a candidate");
  }
  selection->best = chosen;
  selection->status = SelectionStatus::kSelected;
  selection->message.clear();
}

std::string describeNoPile(const ViewSelectorConfig& config) {
  std::ostringstream text;
  text << "no surface is more than " << config.outline.min_height_m << " m above the ground";
  return text.str();
}

std::string describeLoss(double lost, const ViewSelectorConfig& config) {
  std::ostringstream text;
  text << "the map changed during the selection: " << std::lround(100.0 * lost)
       << " % of what was the pile's surface has no data now, allowed are "
       << std::lround(100.0 * config.max_lost_share) << " %";
  return text.str();
}

std::string describeLowUtility(const ScoredSegment& best, const ViewSelectorConfig& config) {
  std::ostringstream text;
  text << "the best utility is " << best.utility.utility << ", must be at least " << config.utility.min_utility
       << " (min_utility)";
  return text.str();
}

}  // namespace

ViewSelectorConfig octomapSelectorConfig() {
  ViewSelectorConfig config;
  config.imaginary_share = 0.65;  // beside a seen surface half of what is averaged over is unknown ground
  // Spanned as those of UtilityConfig are, on OctoMaps of the same sequences.
  config.utility.of(Factor::kManipulability).logistic = {1.0, 302.0, 3.82};  // 0.0054 to 0.0199
  config.utility.of(Factor::kPickOrder).logistic = {1.0, 27.5, 5.6};         // 0.12 m to 0.28 m
  config.utility.of(Factor::kTravel).logistic = {1.0, 1.23, -3.26};          // 4.4 m to 0.86 m
  config.utility.of(Factor::kUncertainty).logistic = {1.0, 24.2, 11.7};      // 0.39 bit to 0.57 bit
  config.utility.of(Factor::kFrontier).logistic = {1.0, 2.97, 2.57};         // 0.13 bit^2/m^2 to 1.6 bit^2/m^2
  return config;
}

ViewSelector::ViewSelector(const ViewSelectorConfig& config, RobotBody robot, Extension extension)
    : config_(config), robot_(std::move(robot)), extension_(std::move(extension)) {
  requirePossible(extension_.factors);
  interactive_mapping::requireValid("impossible selection:", config_);
  cutSegments({}, robot_.footprint,
              config_.segments);  // throws for a bad footprint, and for one the segments do not fit
  if (!robot_.T_base_armbase.matrix().allFinite()) {
    throw std::invalid_argument("T_base_armbase is not finite, must be a pose");
  }
  if (robot_.sectors) {
    num_reach_samples_ = countSamples(*robot_.sectors, robot_.T_base_armbase, config_.manipulability.cell_m);
  } else if (const double weight = config_.utility.of(Factor::kManipulability).weight;
             config_.choice == Choice::kUtility && weight > 0.0) {
    std::ostringstream text;
    text << "weights/manipulability = " << weight << ", must be 0 without the arm's sectors";
    throw std::invalid_argument(text.str());
  }
}

// The stages in their order; each of them can end the selection.
Selection ViewSelector::select(const SceneModel& scene, const FailureMemory& failures, const SelectionRequest& request,
                               const std::function<void(const std::string&, std::size_t)>& tell,
                               const std::function<bool()>& is_cancelled) const {
  requirePossible(request);
  Selection selection;
  selection.workspace_map = request.workspace_map;
  std::size_t num_segments = 0;
  /// Tells the next stage; true: the selection is over.
  const auto begin = [&](const char* stage) {
    if (is_cancelled && is_cancelled()) {
      selection.status = SelectionStatus::kCancelled;
      selection.message = std::string("cancelled before the stage: ") + stage;
      return true;
    }
    if (tell) tell(stage, num_segments);
    return false;
  };
  const auto end = [&selection](SelectionStatus status, const std::string& message) {
    selection.status = status;
    selection.message = message;
    return selection;
  };

  if (begin("surface")) return selection;
  const MappedSurface surface = scene.surface();
  selection.map_update = surface.update;
  selection.map_stamp_s = surface.stamp_s;
  selection.prior_uncertainty = scene.priorUncertainty();
  requireSameLengths(surface);
  if (surface.points_map.empty()) return end(SelectionStatus::kEmptyMap, "the map has no surface");
  const std::optional<gpis_mapping::GroundPlane> ground = groundOf(surface, config_.ground);
  if (!ground) {
    return end(SelectionStatus::kNoGround, "the map has no large level plane: look at the ground before the pile");
  }

  if (begin("outline")) return selection;
  selection.outline = outlinePile(surface, *ground, config_.outline);
  const bool has_pile = !selection.outline.polygons.empty();
  std::optional<GroundFrontier> frontier;
  if (!request.workspace_map.empty()) {
    if (!robot_.T_base_camera) throw std::invalid_argument("T_base_camera is not known, must be for a workspace");
    frontier.emplace(surface, *ground, request.workspace_map, *request.ground, *robot_.T_base_camera,
                     config_.exploration);
  }
  if (!has_pile && (!frontier || frontier->patches().empty())) {
    return end(SelectionStatus::kNoPile, describeNoPile(config_));
  }
  const std::vector<Segment> segments = cutSegments(selection.outline, robot_.footprint, config_.segments);
  num_segments = segments.size();

  if (begin("uncertainty")) return selection;
  const std::vector<SegmentUncertainty> uncertainty = segmentUncertainty(scene, segments);
  const std::vector<SegmentKind> kinds =
      classify(segments, uncertainty, scene.priorUncertainty(), config_.imaginary_share);

  if (begin("manipulability")) return selection;
  std::optional<ManipulabilityScore> manipulability;
  if (robot_.sectors && has_pile) {
    manipulability.emplace(scene, surface, *ground, config_.outline.min_height_m, *robot_.sectors,
                           robot_.T_base_armbase, config_.manipulability, num_reach_samples_);
  }

  if (begin("travel")) return selection;
  const base_navigation::DistanceField distances(*request.ground, request.T_map_base.position(),
                                                 base_navigation::inscribedRadius(robot_.footprint));
  const base_navigation::FootprintChecker standing(request.ground, robot_.footprint, config_.standing_padding_m);
  const base_navigation::FootprintChecker driving(request.ground, robot_.footprint,
                                                  base_navigation::BasePlannerConfig().padding_m);

  const Scoring scoring{config_.utility,  extension_.factors, request.may_stay ? config_.start_m : 0.0,
                        request,          failures,           manipulability,
                        distances,        standing,           driving,
                        selection.outline};
  std::vector<ScoredSegment> scored_segments;
  const std::optional<std::size_t> ahead = nearestTo(request.T_map_base, segments);
  if (request.may_stay && ahead) {  // first: of equal ones it is preferred
    if (auto here = scoring.scoreHere(segments[*ahead], kinds[*ahead], uncertainty[*ahead])) {
      scored_segments.push_back(std::move(*here));
    }
  }
  for (std::size_t i = 0; i < segments.size(); ++i) {
    scored_segments.push_back(scoring.score(segments[i], kinds[i], uncertainty[i]));
  }
  if (frontier) {
    if (begin("exploration")) return selection;
    for (ScoredSegment& view : scoring.scoreGround(*frontier, *ground, config_.exploration)) {
      scored_segments.push_back(std::move(view));
    }
  }

  if (begin("choice")) return selection;
  const double lost = lostShare(scene, surface, *ground, config_.outline);
  if (lost > config_.max_lost_share) return end(SelectionStatus::kMapChanged, describeLoss(lost, config_));
  selection.segments = std::move(scored_segments);
  if (frontier) noteUnseen(*frontier, &selection);
  selection.best = config_.choice == Choice::kUtility ? bestOf(selection.segments)
                                                      : randomOf(selection.segments, config_.choice, request.seed);
  const std::string hidden = describeHidden(selection, frontier);
  if (!selection.best) {
    return has_pile ? end(SelectionStatus::kNoCandidate, describeVerdicts(selection.segments) + hidden)
                    : end(SelectionStatus::kNoPile, describeNoPile(config_) + hidden);
  }
  const ScoredSegment* most = mostManipulable(selection.segments);
  if (manipulability && most != nullptr) manipulability->at(most->segment.standing_map, &selection.reach_samples);
  const ScoredSegment& best = selection.segments[*selection.best];
  end(SelectionStatus::kSelected, "");
  if (config_.choice == Choice::kUtility && best.utility.utility < config_.utility.min_utility) {
    end(SelectionStatus::kLowUtility, describeLowUtility(best, config_) + hidden);
  }
  if (extension_.choose) rechoose(extension_, &selection);
  return selection;
}

}  // namespace nbv_selection
