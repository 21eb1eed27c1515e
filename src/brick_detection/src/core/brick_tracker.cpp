// SPDX-License-Identifier: BSD-3-Clause
#include "brick_detection/brick_tracker.h"

#include <algorithm>
#include <cmath>
#include <set>
#include <stdexcept>
#include <tuple>

#include <Eigen/Dense>
#include <interactive_mapping_common/geometry/rigid_motion.h>

#include "rotation.h"

namespace brick_detection {
namespace {

using mp700_ur5e_description::BrickCatalogue;

// Camera poses nearer to each other than that are one standpoint.
constexpr double kStandpoint_m = 0.20;
constexpr double kStandpoint_rad = 0.20;
// Enough for all sides of a pile; the oldest one goes, which can only cost certainty.
constexpr std::size_t kMaxStandpoints = 64;
constexpr int kFusionSteps = 3;  // of Gauss-Newton: means differ by millimetres, the first step is nearly exact
constexpr double kInsideMargin_m = 0.02;  // the map's resolution
constexpr int kNoInstance = -1;
// Of a brick's shortest edge, by which the middles of two bricks are apart at least; the rest is what looks may be off.
constexpr double kClearance = 0.8;

Matrix6d diagonal(double std_m, double std_rad) {
  Vector6d variances;
  variances << Eigen::Vector3d::Constant(std_m * std_m), Eigen::Vector3d::Constant(std_rad * std_rad);
  return variances.asDiagonal();
}

Matrix6d inverseOf(const Matrix6d& covariance) {
  return covariance.ldlt().solve(Matrix6d::Identity());
}

}  // namespace

BrickTracker::BrickTracker(const BrickCatalogue& catalogue, const BrickTrackerConfig& config)
    : catalogue_(catalogue), config_(config) {
  interactive_mapping::requireValid("impossible tracker:", config_);
  floor_ = diagonal(config_.floor_std_m, config_.floor_std_rad);
}

BrickTracker::Look BrickTracker::makeLook(const Eigen::Isometry3d& T_map_camera, const BrickSighting& sighting) const {
  Look look;
  look.T_map_camera = T_map_camera;
  look.T_map_brick = T_map_camera * sighting.T_camera_brick;
  Matrix6d turn = Matrix6d::Zero();
  turn.topLeftCorner<3, 3>() = turn.bottomRightCorner<3, 3>() = T_map_camera.linear();
  look.covariance = turn * sighting.covariance * turn.transpose();
  // A camera at t + dt, turned by dr, takes the brick along on its arm: dt + dr x arm.
  const Eigen::Vector3d arm = look.T_map_brick.translation() - T_map_camera.translation();
  Matrix6d by_camera = Matrix6d::Identity();
  by_camera.topRightCorner<3, 3>() = -skew(arm);
  look.camera_covariance = by_camera * diagonal(config_.camera_std_m, config_.camera_std_rad) * by_camera.transpose();
  look.drift_covariance =
      by_camera * diagonal(config_.localisation_std_m, config_.localisation_std_rad) * by_camera.transpose();
  return look;
}

/// How far a look's camera was from a standpoint: 0 there, 1 and more elsewhere.
double BrickTracker::separation(const Look& look, const Standpoint& standpoint) const {
  const Vector6d step = stepBetween(standpoint.mean.T_map_camera, look.T_map_camera);
  return std::max(step.head<3>().norm() / kStandpoint_m, step.tail<3>().norm() / kStandpoint_rad);
}

void BrickTracker::add(const Look& look, Place* place) const {
  ++place->num_looks;
  Standpoint* nearest = nullptr;
  for (Standpoint& standpoint : place->standpoints) {
    if (separation(look, standpoint) < (nearest ? separation(look, *nearest) : 1.0)) nearest = &standpoint;
  }
  const Matrix6d information = inverseOf(look.covariance);
  if (!nearest) {
    if (place->standpoints.size() == kMaxStandpoints) place->standpoints.erase(place->standpoints.begin());
    place->standpoints.push_back({look, information, 1});
  } else {
    // The information filter's step: the mean moves by the look's share of the information.
    const int looks = std::min(nearest->num_looks + 1, config_.looks_per_standpoint);
    nearest->information = (looks - 1.0) / nearest->num_looks * nearest->information + information;
    nearest->num_looks = looks;
    const Vector6d off = stepBetween(nearest->mean.T_map_brick, look.T_map_brick);
    nearest->mean.T_map_brick = moved(nearest->mean.T_map_brick, nearest->information.ldlt().solve(information * off));
    nearest->mean.covariance = inverseOf(nearest->information);
    std::rotate(nearest, nearest + 1, place->standpoints.data() + place->standpoints.size());
  }
  fuse(place);
}

void BrickTracker::fuse(Place* place) const {
  place->T_map_brick = place->standpoints.front().mean.T_map_brick;
  Matrix6d information = Matrix6d::Zero();
  for (int i = 0; i < kFusionSteps; ++i) {
    information.setZero();
    Vector6d sum = Vector6d::Zero();
    for (const Standpoint& standpoint : place->standpoints) {
      Matrix6d covariance = standpoint.mean.covariance + standpoint.mean.camera_covariance;
      if (&standpoint != &place->standpoints.back()) covariance += standpoint.mean.drift_covariance;
      const Matrix6d own = inverseOf(covariance);
      information += own;
      sum += own * stepBetween(place->T_map_brick, standpoint.mean.T_map_brick);
    }
    place->T_map_brick = moved(place->T_map_brick, information.ldlt().solve(sum));
  }
  place->covariance = inverseOf(information) + floor_;
  place->covariance = (0.5 * (place->covariance + place->covariance.transpose())).eval();
}

/// Of a look against a place, six degrees of freedom. Against all other looks the errors of camera and localisation count in
/// full; against those from nearly the same standpoint it is nearly the same error, and a brick that was moved by little is told.
double BrickTracker::chi2(const Look& look, const Place& place) const {
  const auto of = [&look](const Eigen::Isometry3d& T_map_brick, const Matrix6d& covariance) {
    const Vector6d off = stepBetween(T_map_brick, look.T_map_brick);
    return off.dot((covariance + look.covariance).ldlt().solve(off));
  };
  double largest = of(place.T_map_brick, place.covariance + look.camera_covariance + look.drift_covariance);
  for (const Standpoint& standpoint : place.standpoints) {
    const double apart = separation(look, standpoint);
    if (apart >= 1.0) continue;
    const Matrix6d camera = apart * apart * (look.camera_covariance + standpoint.mean.camera_covariance);
    largest = std::max(largest, of(standpoint.mean.T_map_brick, standpoint.mean.covariance + floor_ + camera));
  }
  return largest;
}

int BrickTracker::freeInstance(int id) const {
  std::set<int> taken;
  for (const Track& track : tracks_) {
    if (track.brick.id == id) taken.insert(track.brick.instance);
  }
  int instance = 0;
  while (taken.count(instance) > 0) ++instance;
  return instance;
}

/// Gives the looks at one id, all of one image, to the tracks of that id.
class BrickTracker::Assignment {
 public:
  Assignment(BrickTracker* tracker, int id, double stamp_s, const std::vector<BrickSighting>& sightings,
             const std::vector<Look>& looks, std::vector<std::pair<int, int>>* seen_as)
      : tracker_(*tracker), id_(id), stamp_s_(stamp_s), sightings_(sightings), looks_(looks), seen_as_(*seen_as) {
    for (std::size_t i = 0; i < sightings.size(); ++i) {
      if (sightings[i].brick_id == id) open_looks_.push_back(i);
    }
    for (std::size_t i = 0; i < tracker->tracks_.size(); ++i) {
      if (tracker->tracks_[i].brick.id == id) open_tracks_.push_back(i);
    }
    num_looks_ = open_looks_.size();
  }

  void run() {
    pairKnown();
    if (open_looks_.empty()) {
      if (num_looks_ == 1) tracker_.dropUnconfirmed(id_, stamp_s_);
      return;
    }
    // What is in the hand, or was when the image was taken, is not part of the world.
    if (tracker_.attached_ && tracker_.attached_->id == id_) return;
    if (!addReleased() || open_looks_.empty()) return;
    pairMoved();
    for (const std::size_t i : open_looks_) addNew(i, tracker_.freeInstance(id_));
  }

 private:
  /// Takes the pair of least measure up to a limit out of those that are open, again and again, `max_pairs` times at most.
  template <typename Measure, typename Use>
  void pairUp(double limit, const Measure& measure, const Use& use, std::size_t* max_pairs) {
    for (; *max_pairs > 0; --*max_pairs) {
      std::tuple<double, std::size_t, std::size_t> best(limit, 0, 0);
      bool has_pair = false;
      for (std::size_t i = 0; i < open_looks_.size(); ++i) {
        for (std::size_t k = 0; k < open_tracks_.size(); ++k) {
          const double value = measure(looks_[open_looks_[i]], tracker_.tracks_[open_tracks_[k]]);
          if (!(value <= std::get<0>(best)) || (has_pair && value == std::get<0>(best))) continue;
          best = {value, i, k};
          has_pair = true;
        }
      }
      if (!has_pair) return;
      const auto [value, i, k] = best;
      use(open_looks_[i], &tracker_.tracks_[open_tracks_[k]]);
      open_looks_.erase(open_looks_.begin() + static_cast<std::ptrdiff_t>(i));
      open_tracks_.erase(open_tracks_.begin() + static_cast<std::ptrdiff_t>(k));
    }
  }

  /// Where they are known to be.
  void pairKnown() {
    std::size_t all = std::numeric_limits<std::size_t>::max();
    pairUp(
        tracker_.config_.gate_chi2,
        [this](const Look& look, const Track& track) { return tracker_.chi2(look, track.place); },
        [this](std::size_t i, Track* track) {
          tracker_.add(looks_[i], &track->place);
          track->moved_to.reset();
          markSeen(i, 1, track);
        },
        &all);
  }

  /// What was let go is where it is first seen again. False while the image is older than that.
  bool addReleased() {
    std::vector<Held>& released = tracker_.released_;
    while (!open_looks_.empty()) {
      const auto held =
          std::find_if(released.begin(), released.end(), [this](const Held& one) { return one.id == id_; });
      if (held == released.end()) break;
      if (stamp_s_ < held->released_s) return false;
      const int instance = held->instance ? *held->instance : tracker_.freeInstance(id_);
      released.erase(held);
      addNew(open_looks_.front(), instance);
      open_looks_.erase(open_looks_.begin());
    }
    return true;
  }

  /// Where they may have moved to: once more there, or the nearest that is not seen where it was.
  void pairMoved() {
    // Others in the image that carry the id are seen, too, or were refused: so many carriers there are at least. Those
    // beyond the known ones are new, and the rest of what is left has moved.
    const auto num_tracks =
        static_cast<std::size_t>(std::count_if(tracker_.tracks_.begin(), tracker_.tracks_.end(),
                                               [this](const Track& track) { return track.brick.id == id_; }));
    const bool is_lone_duplicate = num_looks_ == 1 && sightings_[open_looks_.front()].has_duplicate;
    const std::size_t num_carriers = num_looks_ + (is_lone_duplicate ? 1 : 0);
    const std::size_t num_new = num_carriers > num_tracks ? num_carriers - num_tracks : 0;
    std::size_t num_moved = open_looks_.size() - std::min(open_looks_.size(), num_new);
    const auto use = [this](std::size_t i, Track* track) { addMoved(i, track); };
    pairUp(
        tracker_.config_.gate_chi2,
        [this](const Look& look, const Track& track) {
          return track.moved_to ? tracker_.chi2(look, *track.moved_to) : std::numeric_limits<double>::infinity();
        },
        use, &num_moved);
    pairUp(
        std::numeric_limits<double>::max(),
        [](const Look& look, const Track& track) {
          return (look.T_map_brick.translation() - track.place.T_map_brick.translation()).norm();
        },
        use, &num_moved);
  }

  void addMoved(std::size_t i, Track* track) {
    const BrickTrackerConfig& config = tracker_.config_;
    if (!track->moved_to || tracker_.chi2(looks_[i], *track->moved_to) > config.gate_chi2) track->moved_to = Place();
    tracker_.add(looks_[i], &*track->moved_to);
    if (track->moved_to->num_looks < config.moved_looks) return;
    track->place = std::move(*track->moved_to);
    track->moved_to.reset();
    markSeen(i, track->place.num_looks, track);
  }

  void addNew(std::size_t i, int instance) {
    Track track;
    track.brick.id = id_;
    track.brick.instance = instance;
    track.brick.first_seen_s = stamp_s_;
    tracker_.add(looks_[i], &track.place);
    markSeen(i, 1, &track);
    tracker_.tracks_.push_back(std::move(track));
  }

  void markSeen(std::size_t i, int num_agreeing, Track* track) {
    TrackedBrick& brick = track->brick;
    brick.num_looks += num_agreeing;
    brick.last_seen_s = stamp_s_;
    for (const auto face : sightings_[i].faces) brick.faces_seen[static_cast<std::size_t>(face)] = true;
    track->was_duplicate = sightings_[i].has_duplicate;
    seen_as_[i] = {id_, brick.instance};
  }

  BrickTracker& tracker_;
  int id_;
  double stamp_s_;
  const std::vector<BrickSighting>& sightings_;
  const std::vector<Look>& looks_;             // of the same indices
  std::vector<std::pair<int, int>>& seen_as_;  // id and instance, of the same indices
  std::vector<std::size_t> open_looks_;
  std::vector<std::size_t> open_tracks_;
  std::size_t num_looks_{0};
};

/// A brick that was seen where it is known to be, and no other: those that have hardly been seen were bad looks at it.
void BrickTracker::dropUnconfirmed(int id, double stamp_s) {
  const bool is_duplicate = std::any_of(tracks_.begin(), tracks_.end(), [&](const Track& track) {
    return track.brick.id == id && track.brick.last_seen_s == stamp_s && track.was_duplicate;
  });
  if (is_duplicate) return;
  tracks_.erase(std::remove_if(tracks_.begin(), tracks_.end(),
                               [&](const Track& track) {
                                 return track.brick.id == id && track.brick.last_seen_s < stamp_s &&
                                        track.brick.num_looks < config_.moved_looks;
                               }),
                tracks_.end());
}

/// Two bricks are never within each other: of instances that would be, the one that was seen most often is the brick.
void BrickTracker::dropImpossible(int id) {
  const double least_m = kClearance * catalogue_.typeOf(id).size_m.minCoeff();
  const auto isWithinABetterOne = [&](const Track& track) {
    return std::any_of(tracks_.begin(), tracks_.end(), [&](const Track& other) {
      return other.brick.id == id && other.brick.num_looks > track.brick.num_looks &&
             (other.place.T_map_brick.translation() - track.place.T_map_brick.translation()).norm() < least_m;
    });
  };
  std::vector<Track> kept;
  for (const Track& track : tracks_) {
    if (track.brick.id != id || !isWithinABetterOne(track)) kept.push_back(track);
  }
  tracks_ = std::move(kept);
}

std::vector<std::optional<std::size_t>> BrickTracker::addLook(double stamp_s, const Eigen::Isometry3d& T_map_camera,
                                                              const std::vector<BrickSighting>& sightings) {
  if (!std::isfinite(stamp_s) || stamp_s < last_look_s_) {
    throw std::invalid_argument("stamp_s = " + std::to_string(stamp_s) + " s, must be finite and at least " +
                                std::to_string(last_look_s_) + " s, the last look's");
  }
  if (!interactive_mapping::isRigid(T_map_camera))
    throw std::invalid_argument("T_map_camera must be finite, and a rotation and a shift");
  std::set<int> ids;
  std::vector<Look> looks;
  for (const BrickSighting& sighting : sightings) {
    catalogue_.typeOf(sighting.brick_id);  // throws
    ids.insert(sighting.brick_id);
    if (!interactive_mapping::isRigid(sighting.T_camera_brick)) {
      throw std::invalid_argument("T_camera_brick of brick " + std::to_string(sighting.brick_id) +
                                  " must be finite, and a rotation and a shift");
    }
    if (!sighting.covariance.allFinite() || sighting.covariance.llt().info() != Eigen::Success) {
      throw std::invalid_argument("covariance of brick " + std::to_string(sighting.brick_id) +
                                  " must be finite and positive definite");
    }
    looks.push_back(makeLook(T_map_camera, sighting));
  }

  last_look_s_ = stamp_s;
  std::vector<std::pair<int, int>> seen_as(sightings.size(), {0, kNoInstance});
  for (const int id : ids) {
    Assignment(this, id, stamp_s, sightings, looks, &seen_as).run();
    dropImpossible(id);
  }
  publish();

  std::vector<std::optional<std::size_t>> indices(sightings.size());
  for (std::size_t i = 0; i < sightings.size(); ++i) {
    for (std::size_t k = 0; k < bricks_.size(); ++k) {
      if (std::make_pair(bricks_[k].id, bricks_[k].instance) == seen_as[i]) indices[i] = k;
    }
  }
  return indices;
}

void BrickTracker::publish() {
  std::sort(tracks_.begin(), tracks_.end(), [](const Track& a, const Track& b) {
    return std::tie(a.brick.id, a.brick.instance) < std::tie(b.brick.id, b.brick.instance);
  });
  std::multiset<int> carriers;
  for (const Track& track : tracks_) carriers.insert(track.brick.id);
  for (const Held& held : released_) carriers.insert(held.id);
  if (attached_) carriers.insert(attached_->id);
  bricks_.clear();
  for (Track& track : tracks_) {
    track.brick.T_map_brick = track.place.T_map_brick;
    track.brick.covariance = track.place.covariance;
    track.brick.has_duplicate = track.was_duplicate || carriers.count(track.brick.id) > 1;
    bricks_.push_back(track.brick);
  }
}

std::vector<Eigen::Matrix3Xd> BrickTracker::insidePoints() const {
  std::vector<Eigen::Matrix3Xd> all;
  const int num = config_.inside_samples;
  for (const TrackedBrick& brick : bricks_) {
    const Eigen::Vector3d half_m = 0.5 * catalogue_.typeOf(brick.id).size_m;
    const Eigen::Vector3d reach_m = (half_m.array() - kInsideMargin_m).max(0.5 * half_m.array());
    const auto at = [num](int i) { return num == 1 ? 0.0 : 2.0 * i / (num - 1) - 1.0; };
    Eigen::Matrix3Xd points(3, num * num * num);
    int column = 0;
    for (int x = 0; x < num; ++x) {
      for (int y = 0; y < num; ++y) {
        for (int z = 0; z < num; ++z) {
          points.col(column++) = brick.T_map_brick * reach_m.cwiseProduct(Eigen::Vector3d(at(x), at(y), at(z)));
        }
      }
    }
    all.push_back(std::move(points));
  }
  return all;
}

std::vector<int> BrickTracker::dropFree(const std::vector<double>& free_share, double map_stamp_s) {
  if (free_share.size() != bricks_.size()) {
    throw std::invalid_argument("free_share holds " + std::to_string(free_share.size()) + " numbers, must be " +
                                std::to_string(bricks_.size()) + ": one for each brick");
  }
  for (const double share : free_share) {
    if (!(share >= 0.0 && share <= 1.0)) {
      throw std::invalid_argument("free_share = " + std::to_string(share) + ", must be in [0, 1]");
    }
  }
  if (!std::isfinite(map_stamp_s)) throw std::invalid_argument("map_stamp_s must be finite");
  std::vector<int> dropped;
  std::vector<Track> kept;
  for (std::size_t i = 0; i < tracks_.size(); ++i) {
    if (free_share[i] >= config_.free_share && tracks_[i].brick.last_seen_s < map_stamp_s) {
      dropped.push_back(tracks_[i].brick.id);
    } else {
      kept.push_back(std::move(tracks_[i]));
    }
  }
  tracks_ = std::move(kept);
  publish();
  return dropped;
}

bool BrickTracker::attach(int id, const Eigen::Vector3d& p_map) {
  catalogue_.typeOf(id);  // throws
  if (!p_map.allFinite()) throw std::invalid_argument("p_map must be finite");
  detach();  // the hand holds one brick
  attached_ = Held{id, std::nullopt, std::numeric_limits<double>::infinity()};
  auto nearest = tracks_.end();
  const auto distance = [&p_map](const Track& track) { return (track.place.T_map_brick.translation() - p_map).norm(); };
  for (auto track = tracks_.begin(); track != tracks_.end(); ++track) {
    if (track->brick.id == id && (nearest == tracks_.end() || distance(*track) < distance(*nearest))) nearest = track;
  }
  const bool was_known = nearest != tracks_.end();
  if (was_known) {
    attached_->instance = nearest->brick.instance;
    tracks_.erase(nearest);
  } else {
    // Let go and taken again before it was seen.
    const auto released =
        std::find_if(released_.begin(), released_.end(), [id](const Held& held) { return held.id == id; });
    if (released != released_.end()) {
      attached_->instance = released->instance;
      released_.erase(released);
    }
  }
  publish();
  return was_known;
}

void BrickTracker::detach(double stamp_s) {
  if (!attached_) return;
  attached_->released_s = stamp_s;
  released_.push_back(*attached_);
  attached_.reset();
}

void BrickTracker::clear() {
  tracks_.clear();
  bricks_.clear();
  if (attached_) attached_->instance.reset();
  released_.clear();
  last_look_s_ = -std::numeric_limits<double>::infinity();
}

}  // namespace brick_detection
