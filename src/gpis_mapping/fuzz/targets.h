// SPDX-License-Identifier: BSD-3-Clause
#ifndef GPIS_MAPPING_FUZZ_TARGETS_H
#define GPIS_MAPPING_FUZZ_TARGETS_H

#include <string>
#include <vector>

#include "fuzz/fuzz_engine.h"

namespace gpis_mapping_fuzz {

std::vector<TargetInfo> mapTargets();
std::vector<TargetInfo> textTargets();
std::vector<TargetInfo> messageTargets();

/// What YAML readers stumble over, and numbers at and beyond the borders of the settings.
const std::vector<std::string>& yamlDictionary();

}  // namespace gpis_mapping_fuzz

#endif  // GPIS_MAPPING_FUZZ_TARGETS_H
