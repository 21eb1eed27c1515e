// SPDX-License-Identifier: BSD-3-Clause
#include "base_navigation/path_follower.h"
