// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <functional>
#include <limits>

#include "nbv_selection/scene_model.h"

namespace nbv_selection_test {

/// A scene whose answers are functions of the point: an oracle knows them in closed form. Counts how often it is asked.
class FunctionScene : public nbv_selection::SceneModel {
 public:
  struct Occupancy {
    double probability{0.0};
    Eigen::Vector3d normal{Eigen::Vector3d::Zero()};
    bool is_supported{false};
  };

  nbv_selection::MappedSurface mapped;
  std::function<double(const Eigen::Vector3d&)> value;  // u
  std::function<Eigen::Vector3d(const Eigen::Vector3d&)> gradient;
  std::function<Occupancy(const Eigen::Vector3d&)> occupied;
  double prior{1.0};
  mutable int num_questions{0};
  mutable Eigen::Index num_points{0};

  nbv_selection::MappedSurface surface() const override { return mapped; }

  nbv_selection::UncertaintyField uncertainty(const gpis_mapping::Points3d& points_map) const override {
    count(points_map);
    nbv_selection::UncertaintyField field{Eigen::VectorXd(points_map.cols()),
                                          gpis_mapping::Points3d(3, points_map.cols())};
    for (Eigen::Index i = 0; i < points_map.cols(); ++i) {
      field.value[i] = value(points_map.col(i));
      field.gradient.col(i) = gradient(points_map.col(i));
    }
    return field;
  }

  nbv_selection::OccupancyField occupancy(const gpis_mapping::Points3d& points_map) const override {
    count(points_map);
    nbv_selection::OccupancyField field{
        Eigen::VectorXd(points_map.cols()), gpis_mapping::Points3d(3, points_map.cols()), {}};
    for (Eigen::Index i = 0; i < points_map.cols(); ++i) {
      const Occupancy answer = occupied(points_map.col(i));
      // What is unsupported means nothing: whoever uses it shall notice.
      field.probability[i] = answer.is_supported ? answer.probability : std::numeric_limits<double>::quiet_NaN();
      field.normal.col(i) = answer.normal;
      field.is_supported.push_back(answer.is_supported);
    }
    return field;
  }

  double priorUncertainty() const override { return prior; }

 private:
  void count(const gpis_mapping::Points3d& points_map) const {
    ++num_questions;
    num_points += points_map.cols();
  }
};

}  // namespace nbv_selection_test
