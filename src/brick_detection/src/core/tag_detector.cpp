// SPDX-License-Identifier: BSD-3-Clause
#include "brick_detection/tag_detector.h"
