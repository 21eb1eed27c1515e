// SPDX-License-Identifier: BSD-3-Clause
#include "collision/block_lattice.h"

#include <array>

namespace motion_planning {
namespace {

/// Calls `work(first index, stride)` for each line of blocks along an axis.
template <class Work>
void forEachLine(const BlockLattice& lattice, int axis, const Work& work) {
  const std::array<std::size_t, 3> size = {static_cast<std::size_t>(lattice.size()[0]),
                                           static_cast<std::size_t>(lattice.size()[1]),
                                           static_cast<std::size_t>(lattice.size()[2])};
  const std::array<std::size_t, 3> stride = {1, size[0], size[0] * size[1]};
  const std::size_t a = static_cast<std::size_t>(axis);
  const std::size_t u = a == 0 ? 1 : 0;
  const std::size_t v = a == 2 ? 1 : 2;
  for (std::size_t j = 0; j < size[v]; ++j) {
    for (std::size_t i = 0; i < size[u]; ++i) work(i * stride[u] + j * stride[v], stride[a]);
  }
}

}  // namespace

std::vector<std::int32_t> squaredDistances(const BlockLattice& lattice, const std::vector<std::uint8_t>& is_set) {
  std::vector<std::int32_t> squared(lattice.count());
  // Along x the squared distance to the last set block, from both ends.
  const int size_x = lattice.size()[0];
  forEachLine(lattice, 0, [&](std::size_t first, std::size_t) {
    std::int32_t steps = 1 << 14;  // squared it is kNoBlock; never reached by a real distance
    for (int i = 0; i < size_x; ++i) {
      steps = is_set[first + static_cast<std::size_t>(i)] ? 0 : std::min(steps + 1, 1 << 14);
      squared[first + static_cast<std::size_t>(i)] = steps * steps;
    }
    steps = 1 << 14;
    for (int i = size_x - 1; i >= 0; --i) {
      steps = is_set[first + static_cast<std::size_t>(i)] ? 0 : std::min(steps + 1, 1 << 14);
      std::int32_t& value = squared[first + static_cast<std::size_t>(i)];
      value = std::min(value, steps * steps);
    }
  });
  for (int axis = 1; axis < 3; ++axis) {
    const int size = lattice.size()[axis];
    std::vector<std::int32_t> line(static_cast<std::size_t>(size));
    std::vector<int> apex(static_cast<std::size_t>(size));      // of the parabolas of the envelope
    std::vector<double> begin(static_cast<std::size_t>(size));  // where each becomes the lowest
    forEachLine(lattice, axis, [&](std::size_t first, std::size_t stride) {
      int count = 0;
      for (int i = 0; i < size; ++i) {
        const std::int32_t value = squared[first + static_cast<std::size_t>(i) * stride];
        line[static_cast<std::size_t>(i)] = value;
        if (value >= kNoBlock) continue;
        double meet = -1.0;
        while (count > 0) {
          const int j = apex[static_cast<std::size_t>(count - 1)];
          meet = 0.5 * ((value + i * i) - (line[static_cast<std::size_t>(j)] + j * j)) / (i - j);
          if (count == 1 || meet > begin[static_cast<std::size_t>(count - 1)]) break;
          --count;
        }
        if (count == 1 && meet <= 0.0) count = 0;  // the first one is nowhere the lowest within the line
        apex[static_cast<std::size_t>(count)] = i;
        begin[static_cast<std::size_t>(count)] = count == 0 ? -1.0 : meet;
        ++count;
      }
      if (count == 0) return;
      int k = 0;
      for (int i = 0; i < size; ++i) {
        while (k + 1 < count && begin[static_cast<std::size_t>(k + 1)] < i) ++k;
        const int j = apex[static_cast<std::size_t>(k)];
        squared[first + static_cast<std::size_t>(i) * stride] = (i - j) * (i - j) + line[static_cast<std::size_t>(j)];
      }
    });
  }
  return squared;
}

std::vector<std::uint8_t> dilate(const BlockLattice& lattice, std::vector<std::uint8_t> is_set) {
  for (int axis = 0; axis < 3; ++axis) {
    const int size = lattice.size()[axis];
    forEachLine(lattice, axis, [&](std::size_t first, std::size_t stride) {
      std::uint8_t before = 0;
      for (int i = 0; i < size; ++i) {
        const std::size_t at = first + static_cast<std::size_t>(i) * stride;
        const std::uint8_t here = is_set[at];
        const std::uint8_t after = i + 1 < size ? is_set[at + stride] : 0;
        is_set[at] = before | here | after;
        before = here;
      }
    });
  }
  return is_set;
}

}  // namespace motion_planning
