// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>

#include "synthetic_depth/scene.h"

namespace synthetic_depth {

/// Reads a scene file (keys: README, "Scene file"). An unreadable file, malformed YAML, an unknown or doubled key, a
/// wrong type and a value out of range all end in one std::invalid_argument that lists every problem, one line each:
/// file, key, value seen, value allowed, unit.
Scene loadScene(const std::string& path);

/// The same from text; `name` stands for the file in messages.
Scene parseScene(const std::string& text, const std::string& name);

}  // namespace synthetic_depth
