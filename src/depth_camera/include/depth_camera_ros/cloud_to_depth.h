// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <string>
#include <vector>

#include <interactive_mapping_common/config/schema.h>
#include <ros/node_handle.h>
#include <ros/publisher.h>
#include <ros/subscriber.h>
#include <sensor_msgs/PointCloud2.h>
#include <tf2_ros/static_transform_broadcaster.h>

#include "depth_camera/depth_image.h"

namespace depth_camera_ros {

/// Parameters of the node cloud_to_depth. SI units.
struct CloudToDepthParams {
  int views{4};
  bool is_optical{false};
  double horizontal_rad{1.5708};
  double vertical_rad{1.0};
  int width_px{240};
  int height_px{160};

  static void fields(CloudToDepthParams& c, interactive_mapping::Fields& f) {
    f("views", c.views, 1, 8, "", "depth images per cloud, evenly about the cloud's z axis; the first looks along x");
    f("is_optical", c.is_optical, "the cloud's frame has z along the view, as a camera's: one view, along z");
    f("horizontal_rad", c.horizontal_rad, 0.1, 2.4, "rad", "angle of view of each; 4 views see all round with 1.5708");
    f("vertical_rad", c.vertical_rad, 0.1, 2.4, "rad", "the same from top to bottom");
    f("width_px", c.width_px, 16, 4096, "px", "of each view; a pixel should be no finer than the sensor's own step");
    f("height_px", c.height_px, 16, 4096, "px", "the same from top to bottom");
    f.require(!c.is_optical || c.views == 1, "views = " + std::to_string(c.views) + ", must be 1 with is_optical");
  }

  /// The pinhole of each view.
  depth_camera::CameraModel camera() const;
};

/// Points in `cloud` [m], in its frame. Nothing, and the reason in `problem`, if x, y, z are not 32-bit floats in this
/// machine's byte order. Also if the data are shorter than the layout says.
std::optional<Eigen::Matrix3Xf> pointsOf(const sensor_msgs::PointCloud2& cloud, std::string* problem);

/// Makes depth images of point clouds, for nodes that read depth images. Subscribes `cloud`; publishes
/// `~view_N/image_rect` (32FC1), `~view_N/camera_info` and, on tf, the frame of each view below that of the cloud.
class CloudToDepth {
 public:
  /// Throws std::invalid_argument that lists everything wrong with the `~` parameters.
  CloudToDepth(ros::NodeHandle nh, const ros::NodeHandle& private_nh);

 private:
  struct View {
    Eigen::Matrix3f R_view_cloud;
    ros::Publisher image, info;
  };

  void onCloud(const sensor_msgs::PointCloud2& cloud);
  void sendTransforms(const std::string& cloud_frame);
  std::string frameOf(std::size_t view) const { return cloud_frame_ + "_view_" + std::to_string(view); }

  const CloudToDepthParams params_;
  const depth_camera::CameraModel camera_;
  std::vector<View> views_;
  std::string cloud_frame_;  // whose views are on tf
  tf2_ros::StaticTransformBroadcaster transforms_;
  ros::Subscriber subscriber_;
};

}  // namespace depth_camera_ros
