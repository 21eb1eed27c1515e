// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>

#include <interactive_mapping_common/enums/enum_names.h>

#include "support/tag_renderer.h"

namespace brick_detection {

/// What can be wrong with a tag that is decoded all the same.
enum class Spoilt {
  kClean,
  kCover,   ///< something white, grey or dark lies over part of a side: a glove, paper, a neighbour's corner
  kTape,    ///< a strip of tape across the border, at any angle
  kGlare,   ///< a lamp mirrored in the label
  kBend,    ///< the label is not flat
  kShadow,  ///< the edge of a shadow on it
};
inline constexpr interactive_mapping::Names<Spoilt> kSpoiltNames = {
    {"clean", Spoilt::kClean}, {"cover", Spoilt::kCover}, {"tape", Spoilt::kTape},
    {"glare", Spoilt::kGlare}, {"bend", Spoilt::kBend},   {"shadow", Spoilt::kShadow}};
constexpr int kNumSpoilt = static_cast<int>(kSpoiltNames.size());
constexpr const char* toString(Spoilt kind) {
  return interactive_mapping::nameOf(kind, kSpoiltNames);
}

/// A camera of 640 x 480 px without distortion, tag36h11 of 0.12 m.
struct SpoiltTag {
  RenderedView view;
  CameraModel camera;
  int id{0};
  double edge_m{0.12};
  Eigen::Isometry3d T_camera_tag{Eigen::Isometry3d::Identity()};
};

/// One tag at 0.5 to 2 m, tilted by up to 65 degrees, with the noise and blur of a good camera. The same for the same seed.
SpoiltTag drawSpoiltTag(Spoilt kind, std::uint32_t seed);

}  // namespace brick_detection
