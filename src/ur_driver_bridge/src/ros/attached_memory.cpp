// SPDX-License-Identifier: BSD-3-Clause
#include "ur_driver_bridge_ros/attached_memory.h"

#include <cmath>
#include <stdexcept>
#include <string>
#include <vector>

#include <XmlRpcException.h>
#include <interactive_mapping_common_ros/poses.h>
#include <ros/console.h>

namespace ur_driver_bridge_ros {
namespace {

using interactive_mapping_msgs::AttachedBrick;

XmlRpc::XmlRpcValue toList(const std::vector<double>& values) {
  XmlRpc::XmlRpcValue list;
  list.setSize(static_cast<int>(values.size()));
  for (std::size_t i = 0; i < values.size(); ++i) list[static_cast<int>(i)] = values[i];
  return list;
}

std::vector<double> fromList(XmlRpc::XmlRpcValue& list, int size) {
  if (list.getType() != XmlRpc::XmlRpcValue::TypeArray || list.size() != size) {
    throw std::invalid_argument("a list of other than " + std::to_string(size) + " numbers");
  }
  std::vector<double> values;
  for (int i = 0; i < size; ++i) {
    values.push_back(static_cast<double>(list[i]));
    if (!std::isfinite(values.back())) throw std::invalid_argument("a number that is not finite");
  }
  return values;
}

XmlRpc::XmlRpcValue toParameter(const AttachedBrick& brick) {
  const geometry_msgs::Point& p = brick.pose.position;
  const geometry_msgs::Quaternion& q = brick.pose.orientation;
  XmlRpc::XmlRpcValue value;
  value["stamp_s"] = brick.header.stamp.toSec();
  value["frame_id"] = brick.header.frame_id;
  value["id"] = static_cast<int>(brick.id);
  value["type"] = brick.type;
  value["size_m"] = toList({brick.size.x, brick.size.y, brick.size.z});
  value["position_m"] = toList({p.x, p.y, p.z});
  value["orientation_xyzw"] = toList({q.x, q.y, q.z, q.w});
  return value;
}

/// Throws XmlRpc::XmlRpcException or std::exception.
AttachedBrick fromParameter(XmlRpc::XmlRpcValue& value) {
  // XmlRpcValue takes a member that is missing for one that is 0 or empty.
  for (const char* key : {"stamp_s", "frame_id", "id", "type", "size_m", "position_m", "orientation_xyzw"}) {
    if (!value.hasMember(key)) throw std::invalid_argument(std::string("no ") + key);
  }
  AttachedBrick brick;
  brick.is_attached = 1;
  brick.header.stamp.fromSec(static_cast<double>(value["stamp_s"]));
  brick.header.frame_id = static_cast<std::string>(value["frame_id"]);
  brick.id = static_cast<int>(value["id"]);
  brick.type = static_cast<std::string>(value["type"]);
  const std::vector<double> size = fromList(value["size_m"], 3);
  const std::vector<double> p = fromList(value["position_m"], 3);
  const std::vector<double> q = fromList(value["orientation_xyzw"], 4);
  brick.size.x = size[0];
  brick.size.y = size[1];
  brick.size.z = size[2];
  brick.pose.position.x = p[0];
  brick.pose.position.y = p[1];
  brick.pose.position.z = p[2];
  brick.pose.orientation.x = q[0];
  brick.pose.orientation.y = q[1];
  brick.pose.orientation.z = q[2];
  brick.pose.orientation.w = q[3];
  if (!interactive_mapping_ros::toIsometry(brick.pose)) throw std::invalid_argument("a pose that is no rotation");
  return brick;
}

}  // namespace

constexpr char AttachedMemory::kParam[];

std::optional<AttachedBrick> AttachedMemory::recall() const {
  XmlRpc::XmlRpcValue value;
  if (!nh_.getParam(kParam, value) || value.getType() != XmlRpc::XmlRpcValue::TypeStruct) return std::nullopt;
  std::string problem;
  try {
    return fromParameter(value);
  } catch (const XmlRpc::XmlRpcException& error) {
    problem = error.getMessage();
  } catch (const std::exception& error) {
    problem = error.what();
  }
  ROS_WARN_NAMED("bridge", "%s is not readable: %s", nh_.resolveName(kParam).c_str(), problem.c_str());
  return std::nullopt;
}

void AttachedMemory::keep(const AttachedBrick& attached) {
  calls_.post([nh = nh_, attached] {
    if (attached.is_attached != 0) {
      nh.setParam(kParam, toParameter(attached));
    } else {
      nh.setParam(kParam, false);
    }
  });
}

}  // namespace ur_driver_bridge_ros
