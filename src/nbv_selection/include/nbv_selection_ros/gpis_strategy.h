// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

#include <interactive_mapping_msgs/MapUpdate.h>
#include <interactive_mapping_msgs/SurfaceMesh.h>
#include <ros/subscriber.h>

#include "nbv_selection_ros/live_selector.h"

namespace nbv_selection_ros {

/// The shipped strategy on the map of gpis_mapping (plugin nbv_selection/Gpis). Base class of other strategies on that map:
/// override choose() or extraFactors(), and export the class with pluginlib. A derived class has all parameters of this one.
/// Its own ones are in the section `own`, which it reads from ros::NodeHandle(context().private_nh, "own").
class GpisStrategy : public Strategy {
 public:
  void initialize(const StrategyContext& context) override;
  nbv_selection::Selection select(const nbv_selection::SelectionRequest& request,
                                  const nbv_selection::FailureMemory& failures, const ros::Time& min_map_stamp,
                                  const Tell& tell, const IsCancelled& is_cancelled) override;
  void diagnose(diagnostic_updater::DiagnosticStatusWrapper& status) const override;
  std::string configuration() const override;

 protected:
  const StrategyContext& context() const { return context_; }

  /// More factors of the utility. Called once, by initialize(); the functions are called while a view is selected.
  virtual std::vector<nbv_selection::ExtraFactor> extraFactors();

  /// Index of the segment to drive to, see nbv_selection::Extension::choose. Called if there is a candidate; the default
  /// keeps the shipped choice.
  virtual std::optional<std::size_t> choose(const nbv_selection::Selection& selection);

 private:
  ros::Time imageStamp() const;
  std::string noImage() const;
  /// The map's surface, with an image of `min_stamp` or later in it.
  interactive_mapping_msgs::SurfaceMesh awaitMesh(const ros::Time& min_stamp, const IsCancelled& is_cancelled) const;

  StrategyContext context_;
  GpisStrategyParams params_;
  std::unique_ptr<LiveSelector<GpisStrategyParams>> selector_;
  mutable std::mutex mutex_;           // guards image_stamp_
  ros::Time image_stamp_;              // of the newest image in the map
  ros::Subscriber update_subscriber_;  // last: its callback uses the rest
};

}  // namespace nbv_selection_ros
