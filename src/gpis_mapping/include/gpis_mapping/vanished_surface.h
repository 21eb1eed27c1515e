// SPDX-License-Identifier: BSD-3-Clause
#ifndef GPIS_MAPPING_VANISHED_SURFACE_H
#define GPIS_MAPPING_VANISHED_SURFACE_H

#include <cstdint>
#include <vector>

#include <Eigen/Core>

namespace gpis_mapping {

/// A stored point whose pixel is a hole: the sensor says nothing about it.
struct HiddenPoint {
  Eigen::Vector3d position_map;
  Eigen::Vector3f normal_map;
  bool is_due;  // the sensor measured it from about here before
};

/// A stored point that the same frame, or one shortly before, confirms or sees past.
struct Witness {
  Eigen::Vector3d position_map;
  Eigen::Vector3f normal_map;
  bool is_gone;  // seen past
};

enum class HiddenFate : std::uint8_t {
  kStands,    // no evidence: a hole of the sensor in a surface, or a surface that nothing is known of from here
  kSuspect,   // a piece so small that a sensor drops it by chance: gone if the next look agrees
  kVanished,  // gone
};

/// Decides from evidence which hidden points belong to a surface that is gone. Points of one face, each within `reach_m`
/// of the next, are one piece and share their fate. A piece is gone when at least half of it is due. No more of its
/// face round it may be confirmed than is seen past. A sensor loses parts of a surface; an object leaves as a whole. An
/// eighth due is enough where the face is seen past and nothing of it confirmed. One fate per point.
std::vector<HiddenFate> judgeHidden(const std::vector<HiddenPoint>& hidden, const std::vector<Witness>& witnesses,
                                    double reach_m);

/// Pieces with fewer points are kSuspect before they are kVanished.
constexpr std::size_t kMinVanishedPoints = 6;

}  // namespace gpis_mapping

#endif  // GPIS_MAPPING_VANISHED_SURFACE_H
