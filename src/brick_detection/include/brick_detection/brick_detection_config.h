// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <interactive_mapping_common/config/schema.h>

#include "brick_detection/brick_pose.h"
#include "brick_detection/brick_tracker.h"
#include "brick_detection/face_access.h"
#include "brick_detection/marker_sightings.h"
#include "brick_detection/tag_detector.h"

namespace brick_detection {

/// All settings of a BrickDetector. `detector.family` is not one of them: bricks.yaml says it.
struct BrickDetectionConfig {
  TagDetectorConfig detector;
  BrickPoseConfig pose;
  MarkerConfig alvar;
  BrickTrackerConfig tracker;
  FaceAccessConfig access;

  static void fields(BrickDetectionConfig& c, interactive_mapping::Fields& f) {
    f.section("detector", c.detector);
    f.section("pose", c.pose);
    f.section("alvar", c.alvar);
    f.section("tracker", c.tracker);
    f.section("access", c.access);
  }
};

}  // namespace brick_detection
