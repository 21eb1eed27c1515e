// SPDX-License-Identifier: BSD-3-Clause
#include "base_navigation/distance_field.h"
