// SPDX-License-Identifier: BSD-3-Clause
// Apart from the classes: a plugin of another package links these, and its loader must not find two libraries' plugins.
#include <pluginlib/class_list_macros.hpp>

#include "nbv_selection_ros/gpis_strategy.h"

PLUGINLIB_EXPORT_CLASS(nbv_selection_ros::GpisStrategy, nbv_selection_ros::Strategy)
