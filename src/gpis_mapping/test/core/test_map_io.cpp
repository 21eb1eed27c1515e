// SPDX-License-Identifier: BSD-3-Clause
#include "gpis_mapping/map_io.h"

#include <unistd.h>
#include <zlib.h>
#include <sys/resource.h>
#include <sys/stat.h>

#include <csignal>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <limits>
#include <random>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <interactive_mapping_common/testing/temporary_folder.h>

namespace gpis_mapping {
namespace {

using test_support::messageOf;
using test_support::readText;
using test_support::TemporaryFolder;
using test_support::writeText;
using testing::HasSubstr;

/// Like a map far from its origin (UTM coordinates), where floats would lose centimetres.
MapContents someContents(std::size_t num_points = 40) {
  std::mt19937 random(7);
  std::uniform_real_distribution<double> uniform(-1.0, 1.0);
  MapContents contents;
  contents.config.sensor.max_range_m = 3.25;
  contents.config.sensor.hole_policy = HolePolicy::kWall;
  contents.config.region.min_m = Eigen::Vector3d(-1e7, -1e7, -1e7);
  contents.config.region.max_m = Eigen::Vector3d(1e7, 1e7, 1e7);
  contents.epoch_s = 1305031102.175304;
  contents.num_updates = 123456789012345ULL;
  for (std::size_t i = 0; i < num_points; ++i) {
    SurfacePoint point;
    point.position_map = Eigen::Vector3d(5e5 + uniform(random), 4.2e6 + uniform(random), uniform(random));
    point.normal_map =
        Eigen::Vector3d(uniform(random), uniform(random), 2.0 + uniform(random)).normalized().cast<float>();
    point.variance_m2 = static_cast<float>(1e-6 * (2.0 + uniform(random)));
    point.normal_variance = 0.01f;
    point.last_seen_s = static_cast<float>(i) / 30.0f;
    point.num_looks = static_cast<std::uint16_t>(65535 - i);
    point.num_misses = static_cast<std::uint16_t>(i);
    contents.points.push_back(point);
  }
  contents.observed = ObservedLayer(contents.config.observed.block_size_m);
  ObservedLayer::Chunk chunk;
  chunk.fill(ObservedLayer::kNever);
  chunk[17] = 4.5f;
  contents.observed.setChunk({625000, -5250001, 3}, chunk);
  chunk.back() = -0.25f;
  contents.observed.setChunk({-2, 0, 1}, chunk);
  return contents;
}

/// Bytes with the checksum at their end made right again, as a careful forger would.
std::string withChecksum(std::string bytes) {
  const auto* data = reinterpret_cast<const Bytef*>(bytes.data());
  const auto crc = static_cast<std::uint32_t>(::crc32(0L, data, static_cast<uInt>(bytes.size() - 4)));
  std::memcpy(&bytes[bytes.size() - 4], &crc, 4);
  return bytes;
}

template <typename T>
void poke(std::string* bytes, std::size_t at, T value) {
  std::memcpy(&(*bytes)[at], &value, sizeof(T));
}

/// Where the payload of the section begins.
std::size_t payloadOf(const std::string& bytes, const std::string& tag) {
  return bytes.find(tag) + 12;
}

class MapFile : public testing::Test {
 protected:
  MapFile() : path_(folder_.file("a.gpis")) {}

  std::string savedBytes() {
    saveMap(someContents(), path_);
    return readText(path_);
  }
  /// What loadMap says about these bytes.
  std::string refusalOf(const std::string& bytes) {
    writeText(path_, bytes);
    const std::string message = messageOf<MapFileError>([this] { loadMap(path_); });
    if (!message.empty()) {
      EXPECT_THAT(message, HasSubstr(path_));
      EXPECT_EQ(message.find('\n'), std::string::npos) << message;
    }
    return message;
  }

  TemporaryFolder folder_;
  std::string path_;
};

TEST_F(MapFile, RoundTripKeepsEveryBit) {
  const MapContents saved = someContents();
  saveMap(saved, path_);
  const MapContents loaded = loadMap(path_);
  EXPECT_EQ(toYaml(loaded.config), toYaml(saved.config));
  EXPECT_EQ(loaded.epoch_s, saved.epoch_s);
  EXPECT_EQ(loaded.num_updates, saved.num_updates);
  ASSERT_EQ(loaded.points.size(), saved.points.size());
  for (std::size_t i = 0; i < saved.points.size(); ++i) {
    const SurfacePoint& a = saved.points[i];
    const SurfacePoint& b = loaded.points[i];
    EXPECT_EQ(a.position_map, b.position_map);
    EXPECT_EQ(a.normal_map, b.normal_map);
    EXPECT_EQ(a.variance_m2, b.variance_m2);
    EXPECT_EQ(a.normal_variance, b.normal_variance);
    EXPECT_EQ(a.last_seen_s, b.last_seen_s);
    EXPECT_EQ(a.num_looks, b.num_looks);
    EXPECT_EQ(a.num_misses, b.num_misses);
  }
  EXPECT_EQ(loaded.observed.blockSize(), saved.observed.blockSize());
  ASSERT_EQ(loaded.observed.numChunks(), saved.observed.numChunks());
  for (const auto& [key, chunk] : saved.observed.chunks()) {
    ASSERT_NE(loaded.observed.chunk(key), nullptr);
    EXPECT_EQ(*loaded.observed.chunk(key), *chunk);
  }
}

TEST_F(MapFile, SameMapGivesSameBytes) {
  const std::string first = savedBytes();
  EXPECT_EQ(savedBytes(), first);
  saveMap(loadMap(path_), path_);
  EXPECT_EQ(readText(path_), first);
}

TEST_F(MapFile, RoundTripOfAnEmptyMap) {
  saveMap(MapContents{}, path_);
  const MapContents loaded = loadMap(path_);
  EXPECT_TRUE(loaded.points.empty());
  EXPECT_EQ(loaded.observed.numChunks(), 0U);
}

TEST_F(MapFile, RefusesEveryFlippedByte) {
  const std::string good = savedBytes();
  std::fstream file(path_, std::ios::in | std::ios::out | std::ios::binary);
  const auto put = [&file](std::size_t at, char byte) {
    file.seekp(static_cast<std::streamoff>(at));
    file.put(byte);
    file.flush();
  };
  // Every byte up to the end of the points, then a sample: the chunks are 16 KiB each of the same.
  for (std::size_t i = 0; i < good.size(); i += i < 4000 ? 1 : 97) {
    for (const unsigned char flip : {0x01, 0x80, 0xFF}) {
      put(i, static_cast<char>(static_cast<unsigned char>(good[i]) ^ flip));
      EXPECT_NE(messageOf<MapFileError>([this] { loadMap(path_); }), "") << "byte " << i;
    }
    put(i, good[i]);
  }
  EXPECT_EQ(loadMap(path_).points.size(), someContents().points.size());
}

TEST_F(MapFile, RefusesEveryTruncation) {
  const std::string good = savedBytes();
  std::string message;
  for (std::size_t length = good.size() - 1; length > 0; length -= length <= 200 ? 1 : 53) {
    std::filesystem::resize_file(path_, length);
    message = messageOf<MapFileError>([this] { loadMap(path_); });
    EXPECT_THAT(message, HasSubstr(length < 8 ? "a.gpis" : "is truncated")) << length;
  }
  EXPECT_THAT(refusalOf(""), HasSubstr("is empty"));
}

TEST_F(MapFile, RefusesTrailingBytes) {
  const std::string good = savedBytes();
  EXPECT_THAT(refusalOf(good + "x"), HasSubstr("has 1 bytes after its end"));
  EXPECT_NE(refusalOf(good + good), "");
}

TEST_F(MapFile, RefusesForeignFiles) {
  EXPECT_THAT(refusalOf("ply\nformat ascii 1.0\n"), HasSubstr("is not a map file"));
  EXPECT_THAT(refusalOf(std::string(100000, '\0')), HasSubstr("is not a map file"));
  EXPECT_THAT(refusalOf("x"), HasSubstr("is not a map file"));
}

TEST_F(MapFile, RefusesAnotherVersionAndNamesBoth) {
  std::string bytes = savedBytes();
  poke<std::uint32_t>(&bytes, 8, 2);
  const std::string message = refusalOf(withChecksum(bytes));
  EXPECT_THAT(message, HasSubstr("version 2"));
  EXPECT_THAT(message, HasSubstr("reads version 1"));
}

TEST_F(MapFile, RefusesAbsurdCountsWithoutAllocatingThem) {
  const std::string good = savedBytes();
  // Eight petabytes of points, and counts whose product with the record size wraps around.
  for (const std::uint64_t count : {std::uint64_t{1} << 53, ~std::uint64_t{0}, (~std::uint64_t{0}) / 52 + 41,
                                    std::uint64_t{39}, std::uint64_t{41}}) {
    std::string bytes = good;
    poke(&bytes, payloadOf(bytes, "PNTS"), count);
    EXPECT_THAT(refusalOf(withChecksum(bytes)), HasSubstr("points")) << count;
    bytes = good;
    poke(&bytes, payloadOf(bytes, "OBSV") + 12, count);
    EXPECT_THAT(refusalOf(withChecksum(bytes)), HasSubstr("chunks")) << count;
    bytes = good;
    poke(&bytes, payloadOf(bytes, "PNTS") - 8, count);
    EXPECT_NE(refusalOf(withChecksum(bytes)), "") << count;
    bytes = good;
    poke(&bytes, 16, count);  // length of the file
    EXPECT_NE(refusalOf(withChecksum(bytes)), "") << count;
  }
}

TEST_F(MapFile, RefusesImpossiblePoints) {
  const std::string good = savedBytes();
  const std::size_t first = payloadOf(good, "PNTS") + 8;
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const float infinity = std::numeric_limits<float>::infinity();
  std::string bytes = good;
  poke(&bytes, first + 52, nan);
  EXPECT_THAT(refusalOf(withChecksum(bytes)), HasSubstr("point 1: position is not finite"));
  bytes = good;
  poke(&bytes, first + 8, 1e300);
  EXPECT_THAT(refusalOf(withChecksum(bytes)), HasSubstr("point 0: position is out of reach"));
  bytes = good;
  poke(&bytes, first + 24, 5.0f);
  EXPECT_THAT(refusalOf(withChecksum(bytes)), HasSubstr("normal is not a unit vector"));
  bytes = good;
  poke(&bytes, first + 36, -1.0f);
  EXPECT_THAT(refusalOf(withChecksum(bytes)), HasSubstr("variance"));
  bytes = good;
  poke(&bytes, first + 44, infinity);
  EXPECT_THAT(refusalOf(withChecksum(bytes)), HasSubstr("last look"));
  bytes = good;
  poke(&bytes, payloadOf(bytes, "META"), nan);
  EXPECT_THAT(refusalOf(withChecksum(bytes)), HasSubstr("epoch"));
  bytes = good;
  poke(&bytes, payloadOf(bytes, "META"), -1e300);
  EXPECT_THAT(refusalOf(withChecksum(bytes)), HasSubstr("epoch"));
  bytes = good;
  poke(&bytes, payloadOf(bytes, "OBSV") + 20 + 12, infinity);
  EXPECT_THAT(refusalOf(withChecksum(bytes)), HasSubstr("observed layer"));
}

TEST_F(MapFile, RefusesAnImpossibleConfiguration) {
  std::string bytes = savedBytes();
  const std::size_t at = bytes.find("max_range_m: 3.25");
  ASSERT_NE(at, std::string::npos);
  bytes.replace(at, 17, "max_range_m: -3.2");
  writeText(path_, withChecksum(bytes));
  EXPECT_THAT(messageOf<MapFileError>([this] { loadMap(path_); }), HasSubstr("sensor/max_range_m"));
}

TEST_F(MapFile, WillNotSaveWhatItWouldRefuse) {
  MapContents contents = someContents();
  contents.points[3].position_map.y() = std::numeric_limits<double>::quiet_NaN();
  EXPECT_THAT(messageOf<MapFileError>([&] { saveMap(contents, path_); }), HasSubstr("point 3"));
  EXPECT_EQ(folder_.numEntries(), 0u);
}

TEST_F(MapFile, SaysWhyItCannotRead) {
  EXPECT_THAT(messageOf<MapFileError>([this] { loadMap(folder_.file("none.gpis")); }), HasSubstr("No such file"));
  EXPECT_THAT(messageOf<MapFileError>([this] { loadMap(folder_.path()); }), HasSubstr(folder_.path()));
  // Would wait for a writer for ever if it were opened.
  const std::string pipe = folder_.file("pipe.gpis");
  ASSERT_EQ(mkfifo(pipe.c_str(), 0600), 0);
  EXPECT_THAT(messageOf<MapFileError>([&] { loadMap(pipe); }), HasSubstr("is not a regular file"));
}

TEST_F(MapFile, SaysWhyItCannotWrite) {
  const MapContents contents = someContents();
  EXPECT_THAT(messageOf<MapFileError>([&] { saveMap(contents, folder_.file("no/such/a.gpis")); }),
              HasSubstr("No such file or directory"));
  EXPECT_THAT(messageOf<MapFileError>([&] { saveMap(contents, folder_.path()); }), HasSubstr("is a directory"));
  // A pipe of our own stands for devices: a bug here must never replace one of the machine's.
  ASSERT_EQ(::mkfifo(folder_.file("pipe").c_str(), 0600), 0);
  EXPECT_THAT(messageOf<MapFileError>([&] { saveMap(contents, folder_.file("pipe")); }),
              HasSubstr("not a regular file"));
  if (::geteuid() != 0) {  // root may write anywhere
    const std::string locked = folder_.file("locked");
    std::filesystem::create_directory(locked);
    ::chmod(locked.c_str(), 0500);
    EXPECT_THAT(messageOf<MapFileError>([&] { saveMap(contents, locked + "/a.gpis"); }), HasSubstr("denied"));
  }
}

TEST_F(MapFile, FailedWriteLeavesTheOldFileAndNoTemporary) {
  const std::string old = savedBytes();
  // A limit on file sizes stands for a full disk: the write fails half way.
  rlimit before{};
  ASSERT_EQ(::getrlimit(RLIMIT_FSIZE, &before), 0);
  const auto handler = std::signal(SIGXFSZ, SIG_IGN);
  rlimit small = before;
  small.rlim_cur = 10000;
  ASSERT_EQ(::setrlimit(RLIMIT_FSIZE, &small), 0);
  const std::string message = messageOf<MapFileError>([this] { saveMap(someContents(5000), path_); });
  ::setrlimit(RLIMIT_FSIZE, &before);
  std::signal(SIGXFSZ, handler);
  EXPECT_THAT(message, HasSubstr("cannot be written"));
  EXPECT_EQ(readText(path_), old);
  EXPECT_EQ(folder_.numEntries(), 1u);
}

TEST_F(MapFile, ReplacingKeepsThePermissions) {
  savedBytes();
  ::chmod(path_.c_str(), 0640);
  savedBytes();
  EXPECT_EQ(static_cast<unsigned>(std::filesystem::status(path_).permissions()), 0640u);
  EXPECT_EQ(folder_.numEntries(), 1u);
}

}  // namespace
}  // namespace gpis_mapping
