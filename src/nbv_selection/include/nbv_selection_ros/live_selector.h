// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <memory>
#include <mutex>
#include <utility>

#include <interactive_mapping_common_ros/live_params.h>

#include "nbv_selection_ros/strategy.h"
#include "nbv_selection_ros/strategy_params.h"

namespace nbv_selection_ros {

/// The selector of a strategy whose weights and logistic functions are live. `Params`: StrategyParams or derived.
template <typename Params>
class LiveSelector {
 public:
  /// Throws std::invalid_argument for parameters that the robot does not allow.
  LiveSelector(const StrategyContext& context, const Params& params, nbv_selection::Extension extension = {})
      : robot_(context.robot),
        extension_(std::move(extension)),
        selector_(makeSelector(params)),
        live_(context.private_nh, params, [this](const Params& changed) {
          auto next = makeSelector(changed);
          const std::lock_guard<std::mutex> lock(mutex_);
          selector_ = std::move(next);
        }) {}

  /// With the values in use. A selection asks once, so a change waits for the next one.
  std::shared_ptr<const nbv_selection::ViewSelector> get() const {
    const std::lock_guard<std::mutex> lock(mutex_);
    return selector_;
  }

 private:
  std::shared_ptr<const nbv_selection::ViewSelector> makeSelector(const Params& params) const {
    return std::make_shared<const nbv_selection::ViewSelector>(params.effective(), robot_, extension_);
  }

  const nbv_selection::RobotBody robot_;
  const nbv_selection::Extension extension_;
  mutable std::mutex mutex_;  // guards selector_
  std::shared_ptr<const nbv_selection::ViewSelector> selector_;
  interactive_mapping_ros::LiveParams<Params> live_;  // last: its callback uses the rest
};

}  // namespace nbv_selection_ros
