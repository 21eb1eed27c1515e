// SPDX-License-Identifier: BSD-3-Clause
#include "nbv_selection/outline.h"
