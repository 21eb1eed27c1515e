// SPDX-License-Identifier: BSD-3-Clause
#include "brick_detection_ros/camera_calibrator_params.h"

#include <stdexcept>
#include <vector>

#include <interactive_mapping_common/files/atomic_file.h>
#include <interactive_mapping_common_ros/params.h>

namespace brick_detection_ros {

CameraCalibratorParams loadCameraCalibratorParams(const ros::NodeHandle& private_nh) {
  return interactive_mapping_ros::loadParams<CameraCalibratorParams>(
      private_nh, {"image_transport"}, [](const CameraCalibratorParams& params) {
        std::vector<std::string> problems;
        try {
          if (!params.output_file.empty()) interactive_mapping::requireUsablePath(params.output_file);
        } catch (const std::invalid_argument& error) {
          problems.push_back(std::string("output_file = ") + error.what());
        }
        return problems;
      });
}

}  // namespace brick_detection_ros
