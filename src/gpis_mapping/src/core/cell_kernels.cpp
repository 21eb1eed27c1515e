// SPDX-License-Identifier: BSD-3-Clause
#include "cell_kernels.h"

namespace gpis_mapping {

namespace portable {
const CellKernels& kernels();
}
namespace avx2 {
const CellKernels& kernels();
}

const CellKernels& portableCellKernels() {
  return portable::kernels();
}

const CellKernels* avx2CellKernels() {
#ifdef GPIS_MAPPING_HAS_AVX2
  if (__builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma")) return &avx2::kernels();
#endif
  return nullptr;
}

const CellKernels& cellKernels() {
  static const CellKernels* const best = avx2CellKernels();
  return best != nullptr ? *best : portableCellKernels();
}

}  // namespace gpis_mapping
