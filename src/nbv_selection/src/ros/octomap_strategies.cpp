// SPDX-License-Identifier: BSD-3-Clause
// The systems this work is compared with. They see nothing but an OctoMap.
#include <memory>
#include <mutex>
#include <optional>

#include <interactive_mapping_common_ros/params.h>
#include <interactive_mapping_common_ros/poses.h>
#include <interactive_mapping_common_ros/worker_action_server.h>
#include <octomap_baseline_ros/octomap_messages.h>
#include <octomap_msgs/GetOctomap.h>
#include <pluginlib/class_list_macros.hpp>

#include "nbv_selection_ros/live_selector.h"
#include "nbv_selection_ros/service_call.h"

namespace nbv_selection_ros {
namespace {

class OctomapStrategy : public Strategy {
 public:
  void initialize(const StrategyContext& context) override {
    context_ = context;
    params_ = interactive_mapping_ros::loadParams<OctomapStrategyParams>(context.private_nh);
    selector_ = std::make_unique<LiveSelector<OctomapStrategyParams>>(context, params_);
    service_ = context_.nh.resolveName("octomap_full");
  }

  nbv_selection::Selection select(const nbv_selection::SelectionRequest& request,
                                  const nbv_selection::FailureMemory& failures, const ros::Time& min_map_stamp,
                                  const Tell& tell, const IsCancelled& is_cancelled) override {
    const auto selector = selector_->get();
    const std::optional<octomap_msgs::Octomap> map = awaitMap(min_map_stamp, is_cancelled);
    if (!map) throw SelectionCancelled("cancelled while waiting for the map");
    if (interactive_mapping_ros::withoutSlash(map->header.frame_id) != context_.map_frame) {
      throw MapUnusable("the octomap's frame is '" + map->header.frame_id + "', must be '" + context_.map_frame +
                        "' (map_frame)");
    }
    std::string why_not;
    std::shared_ptr<const octomap::OcTree> tree = octomap_baseline_ros::toTree(*map, &why_not);
    if (!tree) throw MapUnavailable(service_ + ": " + why_not);
    const nbv_selection::OctomapScene scene(tree, 0, map->header.stamp.toSec(), params_.scene);
    return selector->select(scene, failures, request, tell, is_cancelled);
  }

  void diagnose(diagnostic_updater::DiagnosticStatusWrapper& status) const override {
    if (!ros::service::exists(service_, false)) {
      status.summary(diagnostic_msgs::DiagnosticStatus::WARN, "no service " + service_);
      return;
    }
    status.summary(diagnostic_msgs::DiagnosticStatus::OK, "ready");
    const std::lock_guard<std::mutex> lock(mutex_);
    status.add("octomap: bytes", last_bytes_);
    status.add("octomap: stamp [s]", last_stamp_.toSec());
  }

  std::string configuration() const override { return interactive_mapping::toYaml(params_); }

 private:
  /// None: cancelled. What asks for it may be asked once only: a goal that another replaces goes on if that is withdrawn.
  std::optional<octomap_msgs::Octomap> awaitMap(const ros::Time& min_stamp, const IsCancelled& is_cancelled) {
    octomap_msgs::GetOctomap call;
    bool has_answered = false;
    bool is_there = false;
    bool has_been_cancelled = false;
    ros::WallTime next_try;
    const auto ask = [&] {
      call = octomap_msgs::GetOctomap();
      ros::NodeHandle nh(context_.nh);
      const ros::ServiceClient client = nh.serviceClient<octomap_msgs::GetOctomap>("octomap_full");
      const CallEnd end = ros::service::exists(service_, false)
                              ? callWithin(client, &call, context_.answer_timeout_s, is_cancelled)
                              : CallEnd::kFailed;
      if (end == CallEnd::kTimedOut) {
        throw MapUnavailable(service_ + " has not answered for " + std::to_string(context_.answer_timeout_s) +
                             " s (input/answer_timeout_s)");
      }
      if (end == CallEnd::kCancelled) throw SelectionCancelled("cancelled while " + service_ + " was asked");
      has_answered = end == CallEnd::kAnswered;
      is_there = has_answered && call.response.map.header.stamp >= min_stamp;
    };
    const auto isOver = [&] {
      has_been_cancelled = is_cancelled && is_cancelled();
      if (has_been_cancelled || is_there) return true;
      if (ros::WallTime::now() < next_try) return false;  // a whole map comes with each answer
      next_try = ros::WallTime::now() + ros::WallDuration(0.1);
      ask();
      return is_there;
    };
    interactive_mapping_ros::waitUntil(ros::Time::now() + ros::Duration(context_.map_wait_s), context_.stall_s, isOver);
    if (has_been_cancelled) return std::nullopt;
    if (!is_there) ask();
    if (!is_there) {
      if (!has_answered) throw MapUnavailable("no service " + service_ + ", or it does not answer");
      throw MapUnavailable("the octomap is of " + std::to_string(call.response.map.header.stamp.toSec()) +
                           " s, asked for is one of " + std::to_string(min_stamp.toSec()) + " s or later (waited " +
                           std::to_string(context_.map_wait_s) + " s, input/map_wait_s)");
    }
    const std::lock_guard<std::mutex> lock(mutex_);
    last_bytes_ = call.response.map.data.size();
    last_stamp_ = call.response.map.header.stamp;
    return call.response.map;
  }

  StrategyContext context_;
  OctomapStrategyParams params_;
  std::unique_ptr<LiveSelector<OctomapStrategyParams>> selector_;
  std::string service_;
  mutable std::mutex mutex_;  // guards what follows
  std::size_t last_bytes_{0};
  ros::Time last_stamp_;
};

}  // namespace
}  // namespace nbv_selection_ros

PLUGINLIB_EXPORT_CLASS(nbv_selection_ros::OctomapStrategy, nbv_selection_ros::Strategy)
