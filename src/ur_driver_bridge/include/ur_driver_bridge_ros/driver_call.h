// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>

#include <ros/node_handle.h>

#include "ur_driver_bridge/arm_call.h"

namespace ur_driver_bridge_ros {

constexpr const char* kHardware = "ur_hardware_interface/";

/// Calls a service whose response has `success`, and waits for the answer; `message` finds words in it.
template <typename Service>
ur_driver_bridge::CallReply callDriver(const ros::NodeHandle& nh, const std::string& name, const std::string& md5sum,
                                       const typename Service::Request& request,
                                       std::string (*message)(const typename Service::Response&)) {
  ros::ServiceClientOptions options;
  options.service = name;
  options.md5sum = md5sum;
  options.persistent = true;  // a connection that closes right after its answer looks like a failed call
  ros::ServiceClient client = ros::NodeHandle(nh).serviceClient(options);
  typename Service::Response response;
  ur_driver_bridge::CallReply reply;
  if (client.isValid() && client.call(request, response, md5sum)) {
    reply.success = response.success != 0;
    reply.message = message(response);
  } else {
    reply.is_gone = true;
    reply.message = "service " + nh.resolveName(name) + " does not answer";
  }
  return reply;
}

}  // namespace ur_driver_bridge_ros
