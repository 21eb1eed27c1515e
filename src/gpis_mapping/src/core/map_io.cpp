// SPDX-License-Identifier: BSD-3-Clause
#include "gpis_mapping/map_io.h"

#include <zlib.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <limits>
#include <type_traits>
#include <vector>

#include <interactive_mapping_common/files/atomic_file.h>

// File layout, all numbers little-endian:
//   magic (8), format version u32, number of sections u32, length of the whole file u64,
//   sections in this order: tag (4), length u64, payload;
//   CRC-32 of everything before it u32.
//   CONF  configuration as YAML text
//   META  epoch f64, number of updates u64
//   PNTS  count u64, per point: position 3 f64, normal 3 f32, variance f32, normal variance f32, last seen f32,
//         looks u16, misses u16
//   OBSV  block size f64, blocks per chunk side u32, count u64, per chunk: key 3 i32, last seen free f32 per block
namespace gpis_mapping {
namespace {

using interactive_mapping::AtomicFile;
using interactive_mapping::FileError;

#if defined(__BYTE_ORDER__) && __BYTE_ORDER__ != __ORDER_LITTLE_ENDIAN__
#error "map files are read and written on little-endian machines only"
#endif

constexpr std::array<char, 8> kMagic{'G', 'P', 'I', 'S', 'M', 'A', 'P', '\x1A'};
constexpr std::uint32_t kFormatVersion = 1;
constexpr std::array<const char*, 4> kTags{"CONF", "META", "PNTS", "OBSV"};
constexpr std::size_t kHeaderBytes = 24;
constexpr std::size_t kSectionHeaderBytes = 12;
constexpr std::size_t kCrcBytes = 4;
constexpr std::size_t kPointBytes = 52;
constexpr std::size_t kChunkBytes = 12 + sizeof(ObservedLayer::Chunk);
// Lattice indices of cells are 32 bits; beyond this a position would not fit them.
constexpr double kMaxLatticeIndex = 1e9;
constexpr float kUnitTolerance = 1e-3f;  // normals are computed in float: rounding stays below 1e-6

/// Appends little-endian numbers to a byte buffer.
class Writer {
 public:
  template <typename T>
  void put(T value) {
    static_assert(std::is_arithmetic<T>::value, "numbers only");
    putBytes(&value, sizeof(T));
  }
  void putBytes(const void* data, std::size_t size) {
    const char* bytes = static_cast<const char*>(data);
    bytes_.insert(bytes_.end(), bytes, bytes + size);
  }
  std::vector<char>& bytes() { return bytes_; }

 private:
  std::vector<char> bytes_;
};

/// Takes numbers out of a byte range; never reads past its end.
class Reader {
 public:
  Reader(const char* begin, std::size_t size) : at_(begin), left_(size) {}

  template <typename T>
  T get() {
    T value;
    getBytes(&value, sizeof(T));
    return value;
  }
  void getBytes(void* out, std::size_t size) {
    if (size > left_) throw MapFileError("a section is shorter than its contents");
    std::memcpy(out, at_, size);
    at_ += size;
    left_ -= size;
  }
  const char* position() const { return at_; }
  std::size_t left() const { return left_; }
  void skip(std::size_t size) {
    if (size > left_) throw MapFileError("a section reaches past the end of the file");
    at_ += size;
    left_ -= size;
  }

 private:
  const char* at_;
  std::size_t left_;
};

std::uint32_t checksum(const char* data, std::size_t size) {
  uLong crc = ::crc32(0L, Z_NULL, 0);
  while (size > 0) {  // zlib counts in 32 bits
    const auto part = static_cast<uInt>(std::min<std::size_t>(size, 1U << 30));
    crc = ::crc32(crc, reinterpret_cast<const Bytef*>(data), part);
    data += part;
    size -= part;
  }
  return static_cast<std::uint32_t>(crc);
}

/// Empty if the point can be trained on; otherwise what is wrong with it.
std::string problemOf(const SurfacePoint& point, double cell_size_m) {
  if (!point.position_map.allFinite()) return "position is not finite";
  if (point.position_map.cwiseAbs().maxCoeff() / cell_size_m > kMaxLatticeIndex) return "position is out of reach";
  if (!point.normal_map.allFinite() || std::abs(point.normal_map.norm() - 1.0f) > kUnitTolerance) {
    return "normal is not a unit vector";
  }
  if (!std::isfinite(point.variance_m2) || point.variance_m2 < 0.0f) return "variance is not finite and >= 0";
  if (!std::isfinite(point.normal_variance) || point.normal_variance < 0.0f) {
    return "normal variance is not finite and >= 0";
  }
  return std::isfinite(point.last_seen_s) ? "" : "time of last look is not finite";
}

void requireUsable(const SurfacePoint& point, std::size_t index, double cell_size_m) {
  const std::string problem = problemOf(point, cell_size_m);
  if (!problem.empty()) throw MapFileError("point " + std::to_string(index) + ": " + problem);
}

void requireUsableEpoch(double epoch_s) {
  if (!(std::abs(epoch_s) <= kMaxStamp_s)) {  // true for NaN
    throw MapFileError("the map's epoch is not finite or beyond +-1e12 s");
  }
}

void requireUsable(const ObservedLayer::Chunk& chunk) {
  const bool finite = std::all_of(chunk.begin(), chunk.end(), [](float stamp_s) { return std::isfinite(stamp_s); });
  if (!finite) throw MapFileError("observed layer: a stamp is not finite");
}

void putSection(Writer* file, const char* tag, Writer* payload) {
  file->putBytes(tag, 4);
  file->put<std::uint64_t>(payload->bytes().size());
  file->putBytes(payload->bytes().data(), payload->bytes().size());
}

void putPoints(const MapContents& contents, Writer* out) {
  out->put<std::uint64_t>(contents.points.size());
  for (std::size_t i = 0; i < contents.points.size(); ++i) {
    const SurfacePoint& point = contents.points[i];
    requireUsable(point, i, contents.config.cells.size_m);
    for (int axis = 0; axis < 3; ++axis) out->put<double>(point.position_map[axis]);
    for (int axis = 0; axis < 3; ++axis) out->put<float>(point.normal_map[axis]);
    out->put<float>(point.variance_m2);
    out->put<float>(point.normal_variance);
    out->put<float>(point.last_seen_s);
    out->put<std::uint16_t>(point.num_looks);
    out->put<std::uint16_t>(point.num_misses);
  }
}

void putObserved(const ObservedLayer& observed, Writer* out) {
  out->put<double>(observed.blockSize());
  out->put<std::uint32_t>(ObservedLayer::kChunkBlocks);
  const ObservedLayer::Chunks chunks = observed.chunks();  // in order: the same map gives the same file
  out->put<std::uint64_t>(chunks.size());
  for (const auto& [key, chunk] : chunks) {
    requireUsable(*chunk);
    out->put<std::int32_t>(key.x);
    out->put<std::int32_t>(key.y);
    out->put<std::int32_t>(key.z);
    out->putBytes(chunk->data(), sizeof(ObservedLayer::Chunk));
  }
}

std::vector<char> serialise(const MapContents& contents) {
  requireUsableEpoch(contents.epoch_s);
  Writer sections;
  sections.bytes().reserve(4096 + contents.points.size() * kPointBytes + contents.observed.numChunks() * kChunkBytes);
  Writer payload;
  const std::string yaml = toYaml(contents.config);
  payload.putBytes(yaml.data(), yaml.size());
  putSection(&sections, kTags[0], &payload);
  payload.bytes().clear();
  payload.put<double>(contents.epoch_s);
  payload.put<std::uint64_t>(contents.num_updates);
  putSection(&sections, kTags[1], &payload);
  payload.bytes().clear();
  putPoints(contents, &payload);
  putSection(&sections, kTags[2], &payload);
  payload.bytes().clear();
  putObserved(contents.observed, &payload);
  putSection(&sections, kTags[3], &payload);

  Writer file;
  file.bytes().reserve(kHeaderBytes + sections.bytes().size() + kCrcBytes);
  file.putBytes(kMagic.data(), kMagic.size());
  file.put<std::uint32_t>(kFormatVersion);
  file.put<std::uint32_t>(kTags.size());
  file.put<std::uint64_t>(kHeaderBytes + sections.bytes().size() + kCrcBytes);
  file.putBytes(sections.bytes().data(), sections.bytes().size());
  file.put<std::uint32_t>(checksum(file.bytes().data(), file.bytes().size()));
  return std::move(file.bytes());
}

/// Count of equally sized records that must fill the rest of a section exactly; checked before anything is allocated.
std::size_t recordCount(Reader* in, std::size_t record_bytes, const std::string& what) {
  const auto count = in->get<std::uint64_t>();
  if (count != in->left() / record_bytes || in->left() % record_bytes != 0) {
    throw MapFileError("says " + std::to_string(count) + " " + what + ", but holds " + std::to_string(in->left()) +
                       " bytes of them");
  }
  return static_cast<std::size_t>(count);
}

std::vector<SurfacePoint> getPoints(Reader* in, double cell_size_m) {
  std::vector<SurfacePoint> points(recordCount(in, kPointBytes, "points"));
  for (std::size_t i = 0; i < points.size(); ++i) {
    SurfacePoint& point = points[i];
    for (int axis = 0; axis < 3; ++axis) point.position_map[axis] = in->get<double>();
    for (int axis = 0; axis < 3; ++axis) point.normal_map[axis] = in->get<float>();
    point.variance_m2 = in->get<float>();
    point.normal_variance = in->get<float>();
    point.last_seen_s = in->get<float>();
    point.num_looks = in->get<std::uint16_t>();
    point.num_misses = in->get<std::uint16_t>();
    requireUsable(point, i, cell_size_m);
  }
  return points;
}

ObservedLayer getObserved(Reader* in, double block_size_m) {
  const auto stored_block_size_m = in->get<double>();
  const auto blocks = in->get<std::uint32_t>();
  if (stored_block_size_m != block_size_m || blocks != static_cast<std::uint32_t>(ObservedLayer::kChunkBlocks)) {
    throw MapFileError("observed layer: its block size contradicts the configuration");
  }
  ObservedLayer observed(block_size_m);
  const std::size_t count = recordCount(in, kChunkBytes, "observed chunks");
  for (std::size_t i = 0; i < count; ++i) {
    LatticeKey key;
    key.x = in->get<std::int32_t>();
    key.y = in->get<std::int32_t>();
    key.z = in->get<std::int32_t>();
    ObservedLayer::Chunk chunk;
    in->getBytes(chunk.data(), sizeof(chunk));
    requireUsable(chunk);
    if (observed.chunk(key) != nullptr) throw MapFileError("observed layer: a chunk is there twice");
    observed.setChunk(key, chunk);
  }
  return observed;
}

Reader section(Reader* file, const std::string& tag) {
  std::array<char, 4> found;
  file->getBytes(found.data(), found.size());
  const auto length = file->get<std::uint64_t>();
  if (std::string(found.data(), found.size()) != tag) throw MapFileError("section " + tag + " is not where it must be");
  Reader payload(file->position(), static_cast<std::size_t>(std::min<std::uint64_t>(length, file->left())));
  if (length > file->left()) throw MapFileError("section " + tag + " reaches past the end of the file");
  file->skip(static_cast<std::size_t>(length));
  return payload;
}

void requireEmpty(const Reader& reader, const std::string& what) {
  if (reader.left() != 0) throw MapFileError(what + " has " + std::to_string(reader.left()) + " bytes too many");
}

MapContents parse(const std::vector<char>& bytes, const std::string& path) {
  Reader file(bytes.data() + kHeaderBytes, bytes.size() - kHeaderBytes - kCrcBytes);
  MapContents contents;
  Reader conf = section(&file, kTags[0]);
  contents.config = parseGpisConfig(std::string(conf.position(), conf.left()), "configuration in " + path);
  Reader meta = section(&file, kTags[1]);
  contents.epoch_s = meta.get<double>();
  contents.num_updates = meta.get<std::uint64_t>();
  requireEmpty(meta, "section META");
  requireUsableEpoch(contents.epoch_s);
  Reader points = section(&file, kTags[2]);
  contents.points = getPoints(&points, contents.config.cells.size_m);
  Reader observed = section(&file, kTags[3]);
  contents.observed = getObserved(&observed, contents.config.observed.block_size_m);
  requireEmpty(file, "the file");
  return contents;
}

/// Checks magic, version and length by the header alone, then reads the rest and checks its sum.
std::vector<char> readChecked(const std::string& path) {
  // Opening a pipe would wait for somebody to write to it.
  std::error_code ignored;
  const std::filesystem::file_status status = std::filesystem::status(path, ignored);
  if (std::filesystem::exists(status) && !std::filesystem::is_regular_file(status)) {
    throw MapFileError("is not a regular file");
  }
  errno = 0;
  std::ifstream in(path, std::ios::binary | std::ios::ate);
  if (!in) throw MapFileError(std::string("cannot be read: ") + std::strerror(errno == 0 ? EIO : errno));
  const std::streamoff end = in.tellg();
  // Opening a directory for reading succeeds; its size is nonsense.
  if (end < 0 || end == std::numeric_limits<std::streamoff>::max()) throw MapFileError("is not a readable file");
  const auto file_size = static_cast<std::uint64_t>(end);
  in.seekg(0);
  std::array<char, kHeaderBytes> header{};
  in.read(header.data(), static_cast<std::streamsize>(std::min<std::uint64_t>(file_size, kHeaderBytes)));
  if (!in) throw MapFileError("is not a readable file");
  const std::size_t magic_bytes = std::min<std::size_t>(kMagic.size(), static_cast<std::size_t>(file_size));
  if (file_size == 0) throw MapFileError("is empty");
  if (!std::equal(kMagic.begin(), kMagic.begin() + magic_bytes, header.begin())) {
    throw MapFileError("is not a map file (its first bytes are not GPISMAP)");
  }
  if (file_size < kHeaderBytes) throw MapFileError("is truncated: " + std::to_string(file_size) + " bytes");
  Reader numbers(header.data() + kMagic.size(), kHeaderBytes - kMagic.size());
  const auto version = numbers.get<std::uint32_t>();
  const auto num_sections = numbers.get<std::uint32_t>();
  const auto length = numbers.get<std::uint64_t>();
  if (version != kFormatVersion) {
    throw MapFileError("has format version " + std::to_string(version) + ", this program reads version " +
                       std::to_string(kFormatVersion));
  }
  if (length > file_size) {
    throw MapFileError("is truncated: " + std::to_string(file_size) + " bytes, should have " + std::to_string(length));
  }
  if (length < file_size) {
    throw MapFileError("has " + std::to_string(file_size - length) + " bytes after its end");
  }
  if (length < kHeaderBytes + kTags.size() * kSectionHeaderBytes + kCrcBytes || num_sections != kTags.size()) {
    throw MapFileError("is corrupted: impossible header");
  }
  std::vector<char> bytes(static_cast<std::size_t>(length));
  std::copy(header.begin(), header.end(), bytes.begin());
  in.read(bytes.data() + kHeaderBytes, static_cast<std::streamsize>(bytes.size() - kHeaderBytes));
  if (!in) throw MapFileError("cannot be read to its end");
  std::uint32_t stored = 0;
  std::memcpy(&stored, bytes.data() + bytes.size() - kCrcBytes, kCrcBytes);
  if (checksum(bytes.data(), bytes.size() - kCrcBytes) != stored) throw MapFileError("is corrupted: checksum differs");
  return bytes;
}

}  // namespace

void saveMap(const MapContents& contents, const std::string& path) {
  try {
    const std::vector<char> bytes = serialise(contents);
    AtomicFile file(path);
    file.write(bytes.data(), bytes.size());
    file.commit();
  } catch (const FileError& error) {
    throw MapFileError(error.what());
  } catch (const MapFileError& error) {
    throw MapFileError(path + ": map cannot be saved: " + error.what());
  }
}

MapContents loadMap(const std::string& path) {
  try {
    return parse(readChecked(path), path);
  } catch (const MapFileError& error) {
    throw MapFileError(path + ": " + error.what());
  } catch (const std::invalid_argument& error) {
    throw MapFileError(path + ": unusable configuration: " + error.what());
  }
}

}  // namespace gpis_mapping
