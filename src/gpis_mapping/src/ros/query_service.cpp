// SPDX-License-Identifier: BSD-3-Clause
#include "gpis_mapping_ros/query_service.h"

#include <exception>

#include <interactive_mapping_common_ros/poses.h>

#include "gpis_mapping_ros/map_messages.h"

namespace gpis_mapping_ros {

void answerQuery(const interactive_mapping_msgs::QueryMap::Request& request, const std::string& map_frame,
                 const tf2_ros::Buffer& tf, const std::function<QueriedMap()>& map,
                 interactive_mapping_msgs::QueryMap::Response* response) {
  if (request.with_variance_gradient && !request.with_variance) {
    // Not silently one or the other: who forgot a flag would read arrays that are not there.
    response->message = "with_variance_gradient = true needs with_variance = true";
    return;
  }
  try {
    Eigen::Isometry3d T_map_query = Eigen::Isometry3d::Identity();
    response->header.frame_id = map_frame;
    const std::string frame = interactive_mapping_ros::withoutSlash(request.frame_id);
    if (!frame.empty() && frame != map_frame) {
      std::string reason;
      const auto T =
          interactive_mapping_ros::toIsometry(tf.lookupTransform(map_frame, frame, ros::Time(0)).transform, &reason);
      if (!T) {
        response->message = "frame_id '" + frame + "': " + reason;
        return;
      }
      T_map_query = *T;
      response->header.frame_id = frame;
    }
    const QueriedMap now = map();
    response->header.stamp = now.stamp;
    response->update = now.num_updates;
    response->prior_variance = now.prior_variance;
    const gpis_mapping::Points3d points = T_map_query * toPoints(request.points);
    for (Eigen::Index i = 0; i < points.cols(); ++i) response->num_invalid += points.col(i).allFinite() ? 0U : 1U;
    gpis_mapping::QueryOptions options;
    options.variance = request.with_variance != 0;
    options.variance_gradient = request.with_variance_gradient != 0;
    fillAnswer(now.query(points, options), T_map_query.linear().transpose(), options.variance, response);
    response->success = true;
    if (now.is_empty) {
      response->message = "the map is empty";
    } else if (response->num_invalid > 0) {
      response->message = std::to_string(response->num_invalid) + " of " + std::to_string(points.cols()) +
                          " points are not finite and got no answer";
    }
  } catch (const std::exception& error) {  // tf, or out of memory
    *response = interactive_mapping_msgs::QueryMap::Response();
    response->message = error.what();
  }
}

}  // namespace gpis_mapping_ros
