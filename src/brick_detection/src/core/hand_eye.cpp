// SPDX-License-Identifier: BSD-3-Clause
#include "brick_detection/hand_eye.h"
