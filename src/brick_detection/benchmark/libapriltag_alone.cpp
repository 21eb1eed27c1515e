// SPDX-License-Identifier: BSD-3-Clause
#include "libapriltag_alone.h"

#include <cstdlib>

extern "C" {
#include <apriltag/apriltag.h>
#include <apriltag/apriltag_pose.h>
#include <apriltag/tag36h11.h>
}

namespace brick_detection {

struct LibapriltagAlone::Library {
  std::unique_ptr<apriltag_family_t, void (*)(apriltag_family_t*)> family{tag36h11_create(), tag36h11_destroy};
  std::unique_ptr<apriltag_detector_t, void (*)(apriltag_detector_t*)> detector{apriltag_detector_create(),
                                                                                apriltag_detector_destroy};
};

LibapriltagAlone::LibapriltagAlone(double decimate) : library_(std::make_unique<Library>()) {
  apriltag_detector_add_family_bits(library_->detector.get(), library_->family.get(), 2);
  library_->detector->quad_decimate = static_cast<float>(decimate);
}

LibapriltagAlone::~LibapriltagAlone() = default;

std::vector<LibapriltagAlone::Tag> LibapriltagAlone::detect(const cv::Mat& grey, const CameraModel& camera,
                                                            double edge_m) {
  const cv::Mat input = grey;
  image_u8_t image = {input.cols, input.rows, static_cast<int>(input.step), input.data};
  const std::unique_ptr<zarray_t, void (*)(zarray_t*)> found(apriltag_detector_detect(library_->detector.get(), &image),
                                                             apriltag_detections_destroy);
  std::vector<Tag> tags;
  for (int i = 0; i < zarray_size(found.get()); ++i) {
    apriltag_detection_t* detection = nullptr;
    zarray_get(found.get(), i, static_cast<void*>(&detection));
    apriltag_detection_info_t info;
    info.det = detection;
    info.tagsize = edge_m;
    info.fx = camera.fx_px;
    info.fy = camera.fy_px;
    info.cx = camera.cx_px + 0.5;  // the library's pixel centres are at .5
    info.cy = camera.cy_px + 0.5;
    apriltag_pose_t pose;
    estimate_tag_pose(&info, &pose);
    Tag tag;
    tag.id = detection->id;
    for (int row = 0; row < 3; ++row) {
      tag.T_camera_tag.translation()(row) = MATD_EL(pose.t, row, 0);
      for (int column = 0; column < 3; ++column) tag.T_camera_tag.linear()(row, column) = MATD_EL(pose.R, row, column);
    }
    // The library's frame is ours turned by pi about x.
    tag.T_camera_tag.rotate(Eigen::AngleAxisd(3.14159265358979323846, Eigen::Vector3d::UnitX()));
    std::free(pose.R);
    std::free(pose.t);
    tags.push_back(tag);
  }
  return tags;
}

}  // namespace brick_detection
