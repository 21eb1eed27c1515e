// SPDX-License-Identifier: BSD-3-Clause
#include "brick_detection/camera_model.h"
