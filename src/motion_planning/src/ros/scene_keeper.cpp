// SPDX-License-Identifier: BSD-3-Clause
#include "motion_planning_ros/scene_keeper.h"

#include <chrono>
#include <exception>
#include <stdexcept>
#include <utility>

#include <interactive_mapping_common/formatted.h>
#include <interactive_mapping_common_ros/markers.h>
#include <interactive_mapping_common_ros/poses.h>
#include <interactive_mapping_msgs/GetMesh.h>
#include <interactive_mapping_msgs/MapUpdate.h>
#include <interactive_mapping_msgs/QueryMap.h>
#include <ros/console.h>
#include <ros/service_client.h>

#include "motion_planning_ros/conversions.h"

namespace motion_planning_ros {
namespace {

using gpis_mapping::SpaceState;
using interactive_mapping_msgs::GetMesh;
using interactive_mapping_msgs::MapUpdate;
using interactive_mapping_msgs::QueryMap;

constexpr double kMaxTry_s = 5.0;                       // wall time; a scene takes some 0.1 s
constexpr std::chrono::milliseconds kCancelPeriod(10);  // how soon a waiting request notices that it was cancelled

SpaceState toSpaceState(std::uint8_t state) {
  if (state == QueryMap::Response::FREE) return SpaceState::kFree;
  return state == QueryMap::Response::OCCUPIED ? SpaceState::kOccupied : SpaceState::kUnknown;
}

template <typename Service>
void call(ros::ServiceClient& client, Service* service) {
  if (!client.isValid()) throw std::runtime_error("no service " + client.getService());
  if (!client.call(*service)) throw std::runtime_error("call of " + client.getService() + " failed");
}

/// The map in another process.
class ServiceView : public motion_planning::MapView {
 public:
  ServiceView(ros::NodeHandle& nh, const std::string& map_frame)
      : client_(nh.serviceClient<QueryMap>("map/query", true)), map_frame_(map_frame) {}

  motion_planning::MapAnswers query(const gpis_mapping::Points3d& points_map) const override {
    const auto count = static_cast<std::size_t>(points_map.cols());
    QueryMap query;
    query.request.frame_id = map_frame_;
    query.request.points.resize(count);
    for (std::size_t i = 0; i < count; ++i) {
      const auto column = static_cast<Eigen::Index>(i);
      query.request.points[i].x = points_map(0, column);
      query.request.points[i].y = points_map(1, column);
      query.request.points[i].z = points_map(2, column);
    }
    call(client_, &query);
    const QueryMap::Response& response = query.response;
    if (!response.success || response.state.size() != count || response.distance.size() != count ||
        response.surface_std.size() != count) {
      throw std::runtime_error(client_.getService() + " gave " + std::to_string(response.state.size()) +
                               " answers to " + std::to_string(count) + " points: " + response.message);
    }
    motion_planning::MapAnswers answers;
    const auto size = static_cast<Eigen::Index>(count);
    answers.distance_m = Eigen::Map<const Eigen::VectorXd>(response.distance.data(), size);
    answers.surface_std_m = Eigen::Map<const Eigen::VectorXd>(response.surface_std.data(), size);
    answers.state.reserve(count);
    for (const std::uint8_t state : response.state) answers.state.push_back(toSpaceState(state));
    return answers;
  }

 private:
  mutable ros::ServiceClient client_;
  std::string map_frame_;
};

}  // namespace

SceneKeeper::SceneKeeper(const ros::NodeHandle& nh, const RobotState& robot, const MotionPlanningParams& params,
                         std::function<void(const MapScene&)> on_scene)
    : nh_(nh), robot_(robot), params_(params), on_scene_(std::move(on_scene)) {}

void SceneKeeper::start() {
  update_subscriber_ = nh_.subscribe<MapUpdate>("map/update", 10, [this](const MapUpdate::ConstPtr& update) {
    if (update->status != MapUpdate::ACCEPTED) return;
    {
      const std::lock_guard<std::mutex> lock(mutex_);
      image_stamp_ = update->header.stamp;
      ++counters_.images;
      counters_.last_image = ros::WallTime::now();
    }
    changed_.notify_all();
  });
  worker_ = std::thread(&SceneKeeper::work, this);
}

SceneKeeper::~SceneKeeper() {
  stop();
}

void SceneKeeper::stop() {
  update_subscriber_.shutdown();
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    is_stopping_ = true;
  }
  changed_.notify_all();
  if (worker_.joinable()) worker_.join();
}

bool SceneKeeper::follow(bool is_followed) {
  bool was_followed = is_followed;
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    std::swap(was_followed, is_followed_);
  }
  changed_.notify_all();
  return was_followed;
}

std::shared_ptr<const MapScene> SceneKeeper::last() const {
  const std::lock_guard<std::mutex> lock(mutex_);
  return last_;
}

ros::Time SceneKeeper::imageStamp() const {
  const std::lock_guard<std::mutex> lock(mutex_);
  return image_stamp_;
}

SceneKeeper::Counters SceneKeeper::counters() const {
  const std::lock_guard<std::mutex> lock(mutex_);
  return counters_;
}

std::string SceneKeeper::problem() const {
  const std::lock_guard<std::mutex> lock(mutex_);
  if (!counters_.last_failure.empty() || trying_since_.isZero()) return counters_.last_failure;
  const double tried_s = (ros::SteadyTime::now() - trying_since_).toSec();
  return tried_s > kMaxTry_s ? interactive_mapping::formatted("the map has not answered for %.1f s", tried_s) : "";
}

bool SceneKeeper::isNear(const Eigen::Isometry3d& T_map_base, const Eigen::Isometry3d& other) const {
  const Eigen::Isometry3d step = T_map_base.inverse() * other;
  return step.translation().norm() <= params_.state.max_shift_m &&
         Eigen::AngleAxisd(step.linear()).angle() <= params_.state.max_turn_rad;
}

std::shared_ptr<const MapScene> SceneKeeper::current(const Eigen::Isometry3d& T_map_base,
                                                     const std::function<bool()>& is_cancelled, std::string* why_not) {
  std::unique_lock<std::mutex> lock(mutex_);
  asked_pose_ = T_map_base;
  const std::uint64_t asked = ++asked_number_;
  changed_.notify_all();
  while (done_asked_number_ < asked) {
    if (is_stopping_ || (is_cancelled && is_cancelled())) {
      *why_not = "cancelled while the scene was being made";
      return nullptr;
    }
    changed_.wait_for(lock, kCancelPeriod);
  }
  if (counters_.last_failure.empty() && isNear(T_map_base, last_->T_map_base)) return last_;
  *why_not = counters_.last_failure.empty() ? "another request moved the scene" : counters_.last_failure;
  return nullptr;
}

void SceneKeeper::work() {
  motion_planning::CollisionSceneBuilder builder(params_.scene);
  motion_planning::CollisionSceneBuilder watched_builder(params_.watchedScene());
  std::uint64_t revision = 0;  // of the map that the last scene was made from
  while (true) {
    std::uint64_t images = 0;
    std::uint64_t asked_number = 0;
    std::optional<Eigen::Isometry3d> T_map_base;
    std::shared_ptr<const MapScene> last;
    {
      std::unique_lock<std::mutex> lock(mutex_);
      changed_.wait(lock, [this] {
        const bool is_next_due = counters_.images > done_images_ && (is_followed_ || !last_);
        return is_stopping_ || is_next_due || asked_number_ > done_asked_number_;
      });
      if (is_stopping_) return;
      images = counters_.images;
      asked_number = asked_number_;
      if (asked_number_ > done_asked_number_) T_map_base = asked_pose_;
      last = last_;
      trying_since_ = ros::SteadyTime::now();
    }
    std::shared_ptr<MapScene> made;
    std::string failure;
    try {
      if (!T_map_base) T_map_base = robot_.base(&failure);
      if (T_map_base) {
        GetMesh map;
        map.request.revision = last && isNear(*T_map_base, last->T_map_base) ? revision : 0;
        const Eigen::AlignedBox3d box_map = motion_planning::regionBox(*T_map_base, builder.config());
        map.request.min = interactive_mapping_ros::toPoint(box_map.min());
        map.request.max = interactive_mapping_ros::toPoint(box_map.max());
        auto client = nh_.serviceClient<GetMesh>("map/get_mesh", true);
        call(client, &map);
        const interactive_mapping_msgs::SurfaceMesh& mesh = map.response.mesh;
        if (withoutSlash(mesh.header.frame_id) != params_.map_frame) {
          throw std::runtime_error("the mesh's frame is '" + mesh.header.frame_id + "', must be '" + params_.map_frame +
                                   "'");
        }
        if (map.request.revision == 0 || map.request.revision != map.response.revision) {
          made = std::make_shared<MapScene>();
          const ServiceView service(nh_, params_.map_frame);
          const motion_planning::AskedOnceView view(service);  // the two builders are in step
          const auto surface = motion_planning::prepareSurface(toSurface(mesh), *T_map_base, builder.config());
          watched_builder.update(surface, view);
          made->statistics = builder.update(surface, view);
          made->watched = watched_builder.scene();
          made->scene = builder.scene();
          made->T_map_base = *T_map_base;
          made->stamp = mesh.header.stamp;
          made->map_update = mesh.update;
          revision = map.response.revision;
        }
      }
    } catch (const std::exception& error) {
      failure = error.what();
      made.reset();
      revision = 0;  // the builders may be half way
    }
    if (!failure.empty())
      ROS_WARN_THROTTLE_NAMED(10.0, "motion_planning", "no scene of the newest map: %s", failure.c_str());
    {
      const std::lock_guard<std::mutex> lock(mutex_);
      // A map that failed is not tried again by itself: the next image's is, or the next request.
      done_images_ = images;
      done_asked_number_ = asked_number;
      counters_.last_failure = failure;
      trying_since_ = ros::SteadyTime();
      if (made) {
        last_ = made;
        ++counters_.scenes;
      }
    }
    changed_.notify_all();
    if (made) on_scene_(*made);
  }
}

}  // namespace motion_planning_ros
