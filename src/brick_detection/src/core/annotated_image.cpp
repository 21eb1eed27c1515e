// SPDX-License-Identifier: BSD-3-Clause
#include "brick_detection/annotated_image.h"
