// SPDX-License-Identifier: BSD-3-Clause
#include "base_navigation/base_navigator.h"
