// SPDX-License-Identifier: BSD-3-Clause
#define GPIS_MAPPING_KERNELS avx2
#include "cell_kernels_impl.h"
