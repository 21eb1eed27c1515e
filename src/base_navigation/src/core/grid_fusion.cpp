// SPDX-License-Identifier: BSD-3-Clause
#include "base_navigation/grid_fusion.h"
