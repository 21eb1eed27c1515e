// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <deque>
#include <optional>
#include <string>

#include <Eigen/Geometry>
#include <interactive_mapping_common/config/schema.h>

#include "ur_driver_bridge/arm_state.h"

namespace ur_driver_bridge {

constexpr double kGravity_m_s2 = 9.81;

struct LoadCellConfig {
  double weigh_s{0.3};
  int min_samples{10};
  double max_spread_N{3.0};
  double min_share{0.5};
  double max_share{1.8};
  double lost_share{0.5};
  double lost_s{0.1};

  static void fields(LoadCellConfig& c, interactive_mapping::Fields& f) {
    f("weigh_s", c.weigh_s, 0.01, 10.0, "s", "time over which a weight is averaged");
    f("min_samples", c.min_samples, 2, 10000, "", "samples of the force that a weight needs");
    f("max_spread_N", c.max_spread_N, 0.01, 100.0, "N",
      "standard deviation of the vertical force while weighing; with more the arm is not at rest");
    f("min_share", c.min_share, 0.0, 1.0, "", "share of the brick's mass below which nothing hangs on the magnet");
    f("max_share", c.max_share, 1.0, 10.0, "", "share of the brick's mass above which more than the brick hangs there");
    f("lost_share", c.lost_share, 0.05, 1.0, "", "a brick is lost when this share of its weight is gone for lost_s");
    f("lost_s", c.lost_s, 0.01, 2.0, "s",
      "time that it must be gone, by the median over twice as long: the arm shakes");
  }
};

/// Weighs what hangs on the magnet by the force that the robot tells. The robot itself takes tool and declared payload out
/// of the force, so what is measured is the load beside these.
class LoadCell {
 public:
  struct Weight {
    double mass_kg{0.0};
    double spread_N{0.0};  // standard deviation of one sample
    int samples{0};
  };

  /// Throws std::invalid_argument listing every impossible value.
  explicit LoadCell(const LoadCellConfig& config);

  /// `R_world_tool`: of the tool's frame when the sample was taken, z of the world up. Samples in the order of time; not
  /// finite or not newer: ignored.
  void add(const Stamped<ToolForce>& sample, const Eigen::Matrix3d& R_world_tool);
  /// Forgets the samples, when the sensor was zeroed for instance. What is held stays held.
  void reset();

  /// Of the newest samples since `from_s`, as soon as they cover weigh_s: mass = -mean(F_z) / g. Nothing: not enough yet,
  /// or the spread is too large (`why` says so).
  std::optional<Weight> weigh(double from_s, std::string* why = nullptr) const;

  /// By how much the load falls at least when a brick of this mass has gone [kg]: lost_share of the mass, and what the lift
  /// weighed beyond it. That excess may be something that rests on the brick and can slide off alone.
  double loss(double mass_kg, double weighed_kg) const;
  /// From now on the load is as it is: a sample that tells of loss() less is lost weight. Call after the payload was declared
  /// and the force has settled; `reference` from weigh(). Once the robot compensates the brick's weight the reference is
  /// about 0, and a lost brick reads as -mass_kg. Throws std::invalid_argument unless the mass is > 0 and all are finite.
  void hold(double mass_kg, double weighed_kg, const Weight& reference);
  void release();
  bool isHolding() const { return held_.has_value(); }
  /// The median over the last 2 lost_s tells that the held load has gone: that is, it has gone for lost_s. False within
  /// lost_s of hold() or reset(), and without samples: see to the age of the force.
  bool isLost() const;
  double lossWindow() const { return 2.0 * config_.lost_s; }  ///< [s] so far back isLost() and excess() look
  /// By the same median, how much more than what is held pulls at the magnet [kg]; nothing where isLost() knows nothing.
  std::optional<double> excess() const;
  /// Median over the last lost_s of the load beside the declared payload [kg]; nothing before there are samples.
  std::optional<double> load() const;

  const LoadCellConfig& config() const { return config_; }

 private:
  struct Sample {
    double stamp_s;
    double vertical_N;  // upward force on the tool
  };
  struct Held {
    double loss_kg;
    double reference_kg;
    std::optional<double> since_s;  // nothing: from the next sample on
  };

  std::optional<double> medianLoad(double window_s, std::size_t min_samples) const;

  LoadCellConfig config_;
  std::deque<Sample> samples_;
  std::optional<Held> held_;
};

}  // namespace ur_driver_bridge
