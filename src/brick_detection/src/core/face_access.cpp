// SPDX-License-Identifier: BSD-3-Clause
#include "brick_detection/face_access.h"
