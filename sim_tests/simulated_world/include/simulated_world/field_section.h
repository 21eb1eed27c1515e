// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <interactive_mapping_common/config/schema.h>

namespace simulated_world {

/// A section of parameters whose members lie in several structs: `declare` names them.
template <typename Declare>
void fieldSection(interactive_mapping::Fields& f, const char* key, const Declare& declare) {
  struct Section {
    const Declare& body;
    static void fields(Section& section, interactive_mapping::Fields& /*f*/) { section.body(); }
  } section{declare};
  f.section(key, section);
}

}  // namespace simulated_world
