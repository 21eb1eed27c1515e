// SPDX-License-Identifier: BSD-3-Clause
#include "gpis_mapping/partition_of_unity.h"

#include <cmath>

namespace gpis_mapping {
namespace {

/// The one or two cells that share a coordinate.
struct AxisBlend {
  int count;
  std::int32_t index[2];
  double weight[2];
  double derivative[2];
};

AxisBlend blendAxis(double x_map, double size, double margin) {
  const double x = x_map + 0.5 * size;  // from the lower face of cell 0
  // Beyond the lattice (see LatticeKey::of), and for NaN, the cell at its border alone.
  constexpr double kLimit = 1 << 30;
  if (!(std::abs(x / size) < kLimit)) {
    const std::int32_t border = x > 0.0 ? 1 << 30 : -(1 << 30);
    return {1, {border, 0}, {1.0, 0.0}, {0.0, 0.0}};
  }
  const std::int32_t cell = static_cast<std::int32_t>(std::floor(x / size));
  const double from_low = x - cell * size;
  const double from_high = size - from_low;
  if (from_low >= margin && from_high >= margin) return {1, {cell, 0}, {1.0, 0.0}, {0.0, 0.0}};
  const bool low = from_low < from_high;
  // t runs from 0 to 1 across the band; quintic smoothstep has two continuous derivatives.
  const double t = 0.5 * (1.0 + (low ? from_low : -from_high) / margin);
  const double upper = t * t * t * (t * (6.0 * t - 15.0) + 10.0);
  const double slope = 30.0 * t * t * (t - 1.0) * (t - 1.0) * 0.5 / margin;
  const std::int32_t below = low ? cell - 1 : cell;
  return {2, {below, below + 1}, {1.0 - upper, upper}, {-slope, slope}};
}

}  // namespace

int blendWeights(const Eigen::Vector3d& x_map, const GpisConfig::Cells& cells, BlendWeight result[8]) {
  const AxisBlend x = blendAxis(x_map.x(), cells.size_m, cells.blend_margin_m);
  const AxisBlend y = blendAxis(x_map.y(), cells.size_m, cells.blend_margin_m);
  const AxisBlend z = blendAxis(x_map.z(), cells.size_m, cells.blend_margin_m);
  int count = 0;
  for (int i = 0; i < x.count; ++i) {
    for (int j = 0; j < y.count; ++j) {
      for (int k = 0; k < z.count; ++k) {
        BlendWeight& entry = result[count++];
        entry.key = {x.index[i], y.index[j], z.index[k]};
        entry.weight = x.weight[i] * y.weight[j] * z.weight[k];
        entry.gradient = {x.derivative[i] * y.weight[j] * z.weight[k], x.weight[i] * y.derivative[j] * z.weight[k],
                          x.weight[i] * y.weight[j] * z.derivative[k]};
      }
    }
  }
  return count;
}

}  // namespace gpis_mapping
