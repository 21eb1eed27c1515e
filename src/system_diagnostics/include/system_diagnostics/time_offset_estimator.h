// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <deque>
#include <limits>
#include <vector>

#include <interactive_mapping_common/config/schema.h>

namespace system_diagnostics {

inline constexpr double kMaxOffset_s = 0.2;      // the search spans offsets of both signs up to this
inline constexpr double kMinTurn_rad = 1.0;      // turned in the window, to and fro added up; less determines no offset
inline constexpr double kMaxOffsetStd_s = 0.01;  // of the estimate; a worse one is not reported

struct TimeOffsetConfig {
  double window_s{60.0};
  int min_images{20};
  double min_correlation{0.8};

  static void fields(TimeOffsetConfig& c, interactive_mapping::Fields& f) {
    f("window_s", c.window_s, 1.0, 3600.0, "s", "images and odometry of this last time are used");
    f("min_images", c.min_images, 5, 100000, "", "pairs of images in the window that an estimate needs");
    f("min_correlation", c.min_correlation, 0.1, 1.0, "",
      "least correlation of turning and shifts at the best offset; with less there is no estimate");
  }
};

enum class TimeOffsetStatus {
  kEstimated,
  kTooLittleTurning,
  kTooFewImages,
  kNoCorrelation,
  kBeyondRange,
  kTooUncertain
};

struct TimeOffsetEstimate {
  TimeOffsetStatus status{TimeOffsetStatus::kTooFewImages};
  double offset_s{std::numeric_limits<double>::quiet_NaN()};  // stamps of images are late by this
  double std_s{std::numeric_limits<double>::quiet_NaN()};     // if errors of shifts are independent
  double correlation{0.0};                                    // at the best offset
  double turned_rad{0.0};
  int images{0};  // pairs that were used
};

/// By how much the camera's stamps are late against the odometry's, from a base that turns. When the base turns to the
/// left, objects in its camera's image move to the right. Images stamped t0, t1 shift, up to a factor, by the turn of
/// the base between t0 - offset and t1 - offset. The offset is where the two correlate best. Positive: the image was
/// taken before the time it is stamped with. Only changes of the speed of turning tell: a steady turn fits any offset.
///
/// The camera is upright (or pitched, not upside down) and fixed to the base. Times are seconds of one clock.
class TimeOffsetEstimator {
 public:
  /// Throws std::invalid_argument listing every impossible value.
  explicit TimeOffsetEstimator(const TimeOffsetConfig& config);

  /// Of odometry, any multiple of 2 pi; stamps that are not later than the newest, or not finite, are left out.
  void addYaw(double stamp_s, double yaw_rad);

  /// Of what is seen, to the right, between two images; px of any scale.
  void addShift(double start_stamp_s, double end_stamp_s, double shift_px);

  TimeOffsetEstimate estimate() const;
  void clear();

 private:
  struct Yaw {
    double stamp_s;
    double yaw_rad;  // unwrapped
  };
  struct Shift {
    double start_s;
    double end_s;
    double shift_px;
  };

  /// Where the correlation is highest; at an end of the search it may be higher beyond.
  struct Peak {
    double offset_s;
    bool is_at_end;
  };

  /// By yaws at every offset of the search, or correlations could not be compared.
  std::vector<Shift> coveredShifts() const;
  std::vector<double> turnsAt(double offset_s, const std::vector<Shift>& used) const;
  static std::vector<double> pixelsOf(const std::vector<Shift>& used);
  Peak findPeak(const std::vector<Shift>& used) const;
  /// Wrong shifts - somebody walks through the image - are far off what the others agree on.
  std::vector<Shift> withoutOutliers(const std::vector<Shift>& used, double offset_s) const;
  /// Least squares: the variance of a shift over what an offset would change of all of them. Mean and factor are fitted
  /// too, so only the part of that change counts which they cannot explain.
  double stdOf(double offset_s, const std::vector<Shift>& used) const;
  bool isCovered(double from_s, double to_s) const;
  double yawAt(double stamp_s) const;

  TimeOffsetConfig config_;
  std::deque<Yaw> yaws_;
  std::deque<Shift> shifts_;
};

}  // namespace system_diagnostics
