// SPDX-License-Identifier: BSD-3-Clause
#ifndef GPIS_MAPPING_MAP_IO_H
#define GPIS_MAPPING_MAP_IO_H

#include <stdexcept>
#include <string>

#include "gpis_mapping/gpis_map.h"

namespace gpis_mapping {

/// A map file that cannot be used: missing, foreign, of another version, truncated, corrupted. what() says which.
class MapFileError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

/// Writes a map file: magic, version, sections, CRC-32 of everything. Goes to a temporary file beside `path`, is
/// flushed to disk and renamed, so that a crash leaves the old file or the new one. Throws MapFileError.
void saveMap(const MapContents& contents, const std::string& path);

/// Reads a map file. Throws MapFileError and touches nothing else.
MapContents loadMap(const std::string& path);

}  // namespace gpis_mapping

#endif  // GPIS_MAPPING_MAP_IO_H
