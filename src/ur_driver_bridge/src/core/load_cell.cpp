// SPDX-License-Identifier: BSD-3-Clause
#include "ur_driver_bridge/load_cell.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <sstream>
#include <stdexcept>

namespace ur_driver_bridge {
namespace {

constexpr std::size_t kMinForLoss = 3;  // samples: one alone is no median

double median(std::vector<double>* values) {
  const auto middle = values->begin() + static_cast<std::ptrdiff_t>(values->size() / 2);
  std::nth_element(values->begin(), middle, values->end());
  if (values->size() % 2 == 1) return *middle;
  return 0.5 * (*middle + *std::max_element(values->begin(), middle));
}

}  // namespace

LoadCell::LoadCell(const LoadCellConfig& config)
    : config_(interactive_mapping::requireValid("impossible load cell:", config)) {}

void LoadCell::add(const Stamped<ToolForce>& sample, const Eigen::Matrix3d& R_world_tool) {
  const double vertical_N = R_world_tool.row(2).dot(sample.value.force_N);
  if (!std::isfinite(sample.stamp_s) || !std::isfinite(vertical_N)) return;
  if (!samples_.empty() && sample.stamp_s <= samples_.back().stamp_s) return;
  samples_.push_back({sample.stamp_s, vertical_N});
  if (held_ && !held_->since_s) held_->since_s = sample.stamp_s;
  // Twice of what any question looks back, so that a window is known to be full.
  const double keep_s = 2.0 * std::max(config_.weigh_s, lossWindow());
  while (samples_.front().stamp_s < sample.stamp_s - keep_s) samples_.pop_front();
}

void LoadCell::reset() {
  samples_.clear();
  if (held_) held_->since_s.reset();
}

std::optional<LoadCell::Weight> LoadCell::weigh(double from_s, std::string* why) const {
  const auto refuse = [why](const std::string& text) -> std::optional<Weight> {
    if (why) *why = text;
    return std::nullopt;
  };
  if (!std::isfinite(from_s)) throw std::invalid_argument("from_s is not finite");
  const auto first = std::find_if(samples_.begin(), samples_.end(),
                                  [from_s](const Sample& sample) { return sample.stamp_s >= from_s; });
  if (first == samples_.end()) return refuse("no force has been heard since then");
  const double newest_s = samples_.back().stamp_s;
  const double covered_s = newest_s - first->stamp_s;
  std::ostringstream text;
  if (covered_s < config_.weigh_s - kRounding_s) {
    text << "the force is known for " << covered_s << " s, needed are " << config_.weigh_s << " s";
    return refuse(text.str());
  }
  Weight weight;
  double sum_N = 0.0;
  const auto is_in_window = [&](const Sample& sample) {
    return sample.stamp_s >= from_s && sample.stamp_s >= newest_s - config_.weigh_s - kRounding_s;
  };
  for (const Sample& sample : samples_) {
    if (!is_in_window(sample)) continue;
    sum_N += sample.vertical_N;
    ++weight.samples;
  }
  if (weight.samples < config_.min_samples) {
    text << weight.samples << " samples of the force in " << config_.weigh_s << " s, needed are "
         << config_.min_samples;
    return refuse(text.str());
  }
  const double mean_N = sum_N / weight.samples;
  double squares = 0.0;
  for (const Sample& sample : samples_) {
    if (is_in_window(sample)) squares += (sample.vertical_N - mean_N) * (sample.vertical_N - mean_N);
  }
  weight.spread_N = std::sqrt(squares / (weight.samples - 1));
  weight.mass_kg = -mean_N / kGravity_m_s2;
  if (weight.spread_N > config_.max_spread_N) {
    text << "the vertical force scatters by " << weight.spread_N << " N, allowed " << config_.max_spread_N
         << " N: the arm is not stationary";
    return refuse(text.str());
  }
  return weight;
}

double LoadCell::loss(double mass_kg, double weighed_kg) const {
  return std::max(0.0, weighed_kg - mass_kg) + config_.lost_share * mass_kg;
}

void LoadCell::hold(double mass_kg, double weighed_kg, const Weight& reference) {
  if (!(mass_kg > 0.0) || !std::isfinite(mass_kg)) {
    throw std::invalid_argument("mass_kg = " + std::to_string(mass_kg) + " kg, must be > 0 kg and finite");
  }
  if (!std::isfinite(reference.mass_kg)) throw std::invalid_argument("reference.mass_kg is not finite");
  if (!std::isfinite(weighed_kg)) throw std::invalid_argument("weighed_kg is not finite");
  held_ = Held{loss(mass_kg, weighed_kg), reference.mass_kg, std::nullopt};
  if (!samples_.empty()) held_->since_s = samples_.back().stamp_s;
}

void LoadCell::release() {
  held_.reset();
}

std::optional<double> LoadCell::excess() const {
  if (!held_ || !held_->since_s || samples_.empty()) return std::nullopt;
  if (samples_.back().stamp_s - *held_->since_s < config_.lost_s - kRounding_s) return std::nullopt;
  const std::optional<double> load_kg = medianLoad(lossWindow(), kMinForLoss);
  if (!load_kg) return std::nullopt;
  return *load_kg - held_->reference_kg;
}

bool LoadCell::isLost() const {
  const std::optional<double> excess_kg = excess();
  return excess_kg && -*excess_kg >= held_->loss_kg;
}

std::optional<double> LoadCell::load() const {
  if (samples_.empty()) return std::nullopt;
  return medianLoad(config_.lost_s, 1);
}

std::optional<double> LoadCell::medianLoad(double window_s, std::size_t min_samples) const {
  std::vector<double> vertical_N;
  const double from_s = samples_.back().stamp_s - window_s - kRounding_s;
  for (const Sample& sample : samples_) {
    if (sample.stamp_s >= from_s) vertical_N.push_back(sample.vertical_N);
  }
  if (vertical_N.size() < min_samples) return std::nullopt;
  return -median(&vertical_N) / kGravity_m_s2;
}

}  // namespace ur_driver_bridge
