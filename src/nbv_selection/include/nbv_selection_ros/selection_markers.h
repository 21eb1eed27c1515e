// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <map>
#include <string>

#include <ros/node_handle.h>
#include <ros/publisher.h>
#include <std_msgs/Header.h>
#include <visualization_msgs/MarkerArray.h>

#include "nbv_selection/view_selector.h"

namespace nbv_selection_ros {

/// A selection for rviz, as in the paper's Figs 1 and 4, a topic for each view, latched: ~markers/utility and
/// ~markers/<factor>. All have the outline in red, and green bars on the segments, as high as the value. Bars of
/// segments that cannot be reached are faint. The best of the others is red, with an arrow from its standing pose.
/// Imaginary segments have grey bars, as high as their uncertainty. manipulability also has, in blue, the samples that
/// count for the candidate with the largest one. pick_order's bars are orange and as high as the pile.
class SelectionMarkers {
 public:
  explicit SelectionMarkers(const ros::NodeHandle& private_nh);

  void show(const nbv_selection::Selection& selection, const nbv_selection::RobotBody& robot,
            const std_msgs::Header& header);

 private:
  std::map<std::string, ros::Publisher> publishers_;
};

/// What one view shows; `view` is "utility" or the name of a factor.
visualization_msgs::MarkerArray toMarkers(const nbv_selection::Selection& selection,
                                          const nbv_selection::RobotBody& robot, const std::string& view,
                                          const std_msgs::Header& header);

/// Those of ~markers/failures: cells of the ground where something failed, and how long ago.
visualization_msgs::MarkerArray toMarkers(const nbv_selection::FailureMemory& failures, const std_msgs::Header& header);

}  // namespace nbv_selection_ros
