// SPDX-License-Identifier: BSD-3-Clause
#include "depth_camera_ros/cloud_to_depth.h"

#include <cmath>

#include <Eigen/Geometry>
#include <interactive_mapping_common_ros/params.h>
#include <sensor_msgs/CameraInfo.h>
#include <sensor_msgs/Image.h>
#include <sensor_msgs/image_encodings.h>
#include <sensor_msgs/point_cloud2_iterator.h>

#include "depth_camera/cloud_projection.h"

namespace depth_camera_ros {
namespace {

constexpr double kWarnPeriod_s = 5.0;

sensor_msgs::Image toMessage(const depth_camera::DepthImage& image, const std_msgs::Header& header) {
  sensor_msgs::Image message;
  message.header = header;
  message.width = static_cast<std::uint32_t>(image.width);
  message.height = static_cast<std::uint32_t>(image.height);
  message.encoding = sensor_msgs::image_encodings::TYPE_32FC1;
  message.step = message.width * static_cast<std::uint32_t>(sizeof(float));
  const auto* bytes = reinterpret_cast<const std::uint8_t*>(image.depth_m.data());
  message.data.assign(bytes, bytes + image.depth_m.size() * sizeof(float));
  return message;
}

sensor_msgs::CameraInfo toMessage(const depth_camera::CameraModel& camera, const std_msgs::Header& header) {
  sensor_msgs::CameraInfo message;
  message.header = header;
  message.width = static_cast<std::uint32_t>(camera.width);
  message.height = static_cast<std::uint32_t>(camera.height);
  message.distortion_model = "plumb_bob";
  message.D.assign(5, 0.0);
  message.K = {camera.fx, 0.0, camera.cx, 0.0, camera.fy, camera.cy, 0.0, 0.0, 1.0};
  message.R = {1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0};
  message.P = {camera.fx, 0.0, camera.cx, 0.0, 0.0, camera.fy, camera.cy, 0.0, 0.0, 0.0, 1.0, 0.0};
  return message;
}

}  // namespace

depth_camera::CameraModel CloudToDepthParams::camera() const {
  const double fx = 0.5 * width_px / std::tan(0.5 * horizontal_rad);
  const double fy = 0.5 * height_px / std::tan(0.5 * vertical_rad);
  return {width_px, height_px, fx, fy, 0.5 * (width_px - 1), 0.5 * (height_px - 1)};
}

std::optional<Eigen::Matrix3Xf> pointsOf(const sensor_msgs::PointCloud2& cloud, std::string* problem) {
  for (const char* axis : {"x", "y", "z"}) {
    bool is_there = false;
    for (const sensor_msgs::PointField& field : cloud.fields) {
      is_there |= field.name == axis && field.datatype == sensor_msgs::PointField::FLOAT32 && field.count <= 1 &&
                  std::uint64_t{field.offset} + sizeof(float) <= cloud.point_step;
    }
    if (is_there) continue;
    *problem = std::string("the cloud has no field ") + axis + " of type FLOAT32 within point_step";
    return std::nullopt;
  }
  const std::uint64_t row = std::uint64_t{cloud.width} * cloud.point_step;
  const std::uint64_t needed = row * cloud.height;
  if (cloud.is_bigendian || (cloud.height > 1 && cloud.row_step != row) || cloud.data.size() < needed) {
    *problem = "the cloud has " + std::to_string(cloud.data.size()) + " bytes, rows of " +
               std::to_string(cloud.row_step) + (cloud.is_bigendian ? ", big endian" : "") + "; must have " +
               std::to_string(needed) + ", rows of " + std::to_string(row) + ", little endian";
    return std::nullopt;
  }
  Eigen::Matrix3Xf points(3, static_cast<Eigen::Index>(cloud.width) * cloud.height);
  if (points.cols() == 0) return points;  // the iterators look at the first byte
  sensor_msgs::PointCloud2ConstIterator<float> x(cloud, "x"), y(cloud, "y"), z(cloud, "z");
  for (Eigen::Index i = 0; i < points.cols(); ++i, ++x, ++y, ++z) points.col(i) << *x, *y, *z;
  return points;
}

CloudToDepth::CloudToDepth(ros::NodeHandle nh, const ros::NodeHandle& private_nh)
    : params_(interactive_mapping_ros::loadParams<CloudToDepthParams>(private_nh)), camera_(params_.camera()) {
  Eigen::Matrix3f R_optical_body;  // x forward, y left, z up becomes x right, y down, z forward
  R_optical_body << 0, -1, 0, 0, 0, -1, 1, 0, 0;
  ros::NodeHandle pnh(private_nh);
  for (int i = 0; i < params_.views; ++i) {
    const Eigen::AngleAxisf turn(static_cast<float>(-2.0 * M_PI * i / params_.views), Eigen::Vector3f::UnitZ());
    const std::string name = "view_" + std::to_string(i);
    const Eigen::Matrix3f R_view_cloud =
        params_.is_optical ? Eigen::Matrix3f::Identity() : Eigen::Matrix3f(R_optical_body * turn);
    views_.push_back({R_view_cloud, pnh.advertise<sensor_msgs::Image>(name + "/image_rect", 1),
                      pnh.advertise<sensor_msgs::CameraInfo>(name + "/camera_info", 1)});
  }
  subscriber_ = nh.subscribe("cloud", 1, &CloudToDepth::onCloud, this, ros::TransportHints().tcpNoDelay());
}

void CloudToDepth::onCloud(const sensor_msgs::PointCloud2& cloud) {
  std::string problem;
  const std::optional<Eigen::Matrix3Xf> points = pointsOf(cloud, &problem);
  if (!points || cloud.header.frame_id.empty()) {
    ROS_WARN_STREAM_THROTTLE(kWarnPeriod_s, "cloud left out: " << (points ? "its frame_id is empty" : problem));
    return;
  }
  if (cloud.header.frame_id != cloud_frame_) sendTransforms(cloud.header.frame_id);
  for (std::size_t i = 0; i < views_.size(); ++i) {
    const depth_camera::DepthImage image = depth_camera::projectPoints(*points, views_[i].R_view_cloud, camera_);
    if (!depth_camera::holdsMeasurement(image)) continue;  // no reader could use it
    std_msgs::Header header = cloud.header;
    header.frame_id = frameOf(i);
    views_[i].info.publish(toMessage(camera_, header));
    views_[i].image.publish(toMessage(image, header));
  }
}

void CloudToDepth::sendTransforms(const std::string& cloud_frame) {
  cloud_frame_ = cloud_frame;
  std::vector<geometry_msgs::TransformStamped> transforms(views_.size());
  for (std::size_t i = 0; i < views_.size(); ++i) {
    const Eigen::Quaternionf q(Eigen::Matrix3f(views_[i].R_view_cloud.transpose()));
    transforms[i].header.stamp = ros::Time::now();
    transforms[i].header.frame_id = cloud_frame;
    transforms[i].child_frame_id = frameOf(i);
    transforms[i].transform.rotation.x = q.x();
    transforms[i].transform.rotation.y = q.y();
    transforms[i].transform.rotation.z = q.z();
    transforms[i].transform.rotation.w = q.w();
  }
  transforms_.sendTransform(transforms);
}

}  // namespace depth_camera_ros
