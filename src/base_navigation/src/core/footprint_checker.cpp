// SPDX-License-Identifier: BSD-3-Clause
#include "base_navigation/footprint_checker.h"
