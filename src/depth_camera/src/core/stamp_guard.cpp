// SPDX-License-Identifier: BSD-3-Clause
#include "depth_camera/stamp_guard.h"

#include <interactive_mapping_common/formatted.h>

namespace depth_camera {
namespace {

using interactive_mapping::formatted;

/// Stamps that step back by less are images out of order, not time that runs anew.
constexpr double kOutOfOrder_s = 1.0;

}  // namespace

StampGuard::Verdict StampGuard::check(double stamp_s) {
  if (stamp_s == 0.0) {
    message_ = "stamp is 0, must be the time of exposure";
    return Verdict::kZero;
  }
  const double back_s = last_stamp_s_ ? *last_stamp_s_ - stamp_s : -1.0;
  if (back_s < 0.0) {
    last_stamp_s_ = stamp_s;
    return Verdict::kGood;
  }
  if (back_s < kOutOfOrder_s) {
    message_ = formatted("stamp is %.3f s before the last one, must be after it", back_s);
    return Verdict::kOutOfOrder;
  }
  message_ = formatted("time ran back by %.3f s (a looped bag?)", back_s);
  last_stamp_s_ = stamp_s;
  return Verdict::kRestarted;
}

}  // namespace depth_camera
