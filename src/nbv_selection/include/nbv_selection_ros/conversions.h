// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>

#include <interactive_mapping_common_ros/poses.h>
#include <interactive_mapping_msgs/NbvSelection.h>
#include <interactive_mapping_msgs/SelectionOutcome.h>
#include <std_msgs/Header.h>

#include "nbv_selection/view_selector.h"

namespace nbv_selection_ros {

using interactive_mapping_ros::toPose;

/// SelectionOutcome's constant.
std::uint8_t toStatus(nbv_selection::SelectionStatus status);

interactive_mapping_msgs::NbvSelection toMessage(const nbv_selection::Selection& selection, const std::string& strategy,
                                                 const std_msgs::Header& header);

}  // namespace nbv_selection_ros
