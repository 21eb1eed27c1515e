// SPDX-License-Identifier: BSD-3-Clause
#ifndef GPIS_MAPPING_ROS_QUERY_SERVICE_H
#define GPIS_MAPPING_ROS_QUERY_SERVICE_H

#include <cstdint>
#include <functional>
#include <string>

#include <interactive_mapping_msgs/QueryMap.h>
#include <ros/time.h>
#include <tf2_ros/buffer.h>

#include "gpis_mapping/map_snapshot.h"

namespace gpis_mapping_ros {

/// A map of one moment, as the service ~query needs it.
struct QueriedMap {
  ros::Time stamp;  // of the last image
  std::uint64_t num_updates{0};
  bool is_empty{false};
  double prior_variance{0.0};  // [m^2]
  std::function<gpis_mapping::QueryResult(const gpis_mapping::Points3d& points_map,
                                          const gpis_mapping::QueryOptions& options)>
      query;
};

/// Points into the map's frame, answers back into the asked one; what is wrong with the request is in the message.
/// `map` is called once if the request is possible. Never throws.
void answerQuery(const interactive_mapping_msgs::QueryMap::Request& request, const std::string& map_frame,
                 const tf2_ros::Buffer& tf, const std::function<QueriedMap()>& map,
                 interactive_mapping_msgs::QueryMap::Response* response);

}  // namespace gpis_mapping_ros

#endif  // GPIS_MAPPING_ROS_QUERY_SERVICE_H
