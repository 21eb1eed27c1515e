// SPDX-License-Identifier: BSD-3-Clause
#include <interactive_mapping_common_ros/node_main.h>

#include "system_diagnostics_ros/system_diagnostics_ros.h"

int main(int argc, char** argv) {
  return interactive_mapping_ros::runNode<system_diagnostics_ros::SystemDiagnosticsRos>(
      argc, argv, "system_diagnostics", 1);  // one callback at a time
}
