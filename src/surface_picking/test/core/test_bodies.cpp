// SPDX-License-Identifier: BSD-3-Clause
#include "surface_picking/bodies.h"

#include <cmath>
#include <stdexcept>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <interactive_mapping_common/testing/temporary_folder.h>

#include "support/mapped_scene.h"

namespace surface_picking {
namespace {

using test_support::pose;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;

Cuboid cuboidAt(const Eigen::Isometry3d& T_map_body, const Eigen::Vector3d& size_m = {0.3, 0.2, 0.2}) {
  Cuboid cuboid;
  cuboid.type = "brick";
  cuboid.size_m = size_m;
  cuboid.T_map_body = T_map_body;
  cuboid.covariance *= 1e-6;
  return cuboid;
}

SpaceQuery everywhere(SpaceState state) {
  return [state](const Eigen::Matrix3Xd& points) {
    return std::vector<SpaceState>(static_cast<std::size_t>(points.cols()), state);
  };
}

std::vector<int> idsOf(const BodyTracker& tracker) {
  std::vector<int> ids;
  for (const Body& body : tracker.bodies()) ids.push_back(body.id);
  return ids;
}

class Bodies : public testing::Test {
 protected:
  BodyTracker::Update see(const std::vector<Cuboid>& cuboids, const SpaceQuery& space = {},
                          const Eigen::AlignedBox3d& looked_at = gpis_mapping::kEverywhere) {
    return tracker_.update(stamp_s_ += 1.0, cuboids, space, looked_at);
  }

  BodyTracker tracker_{BodyConfig()};
  double stamp_s_{0.0};
};

TEST_F(Bodies, KeepTheirIdsThroughSmallMovesAndAnyOrder) {
  const Cuboid a = cuboidAt(pose(0.0, 0.0, 0.1));
  const Cuboid b = cuboidAt(pose(0.4, 0.0, 0.1));
  see({a, b});
  Cuboid moved = a;
  moved.T_map_body.translation().x() += 0.03;
  see({b, moved});
  ASSERT_THAT(idsOf(tracker_), ElementsAre(0, 1));
  EXPECT_DOUBLE_EQ(tracker_.bodies()[0].cuboid.T_map_body.translation().x(), 0.03);
  EXPECT_EQ(tracker_.bodies()[0].num_looks, 2);
  EXPECT_DOUBLE_EQ(tracker_.bodies()[1].first_seen_s, 1.0);
  EXPECT_DOUBLE_EQ(tracker_.bodies()[1].last_seen_s, 2.0);
}

// The same body described with other axes: a brick of 0.3 x 0.2 x 0.2 has eight such descriptions.
TEST_F(Bodies, StayWholeWhenTheMapDoesNotAnswer) {
  const Cuboid a = cuboidAt(pose(0.0, 0.0, 0.1));
  see({a, cuboidAt(pose(0.4, 0.0, 0.1))});
  const SpaceQuery space = [](const auto&) -> std::vector<SpaceState> { throw std::runtime_error("no answer"); };
  EXPECT_THROW(see({a}, space), std::runtime_error);
  ASSERT_THAT(idsOf(tracker_), ElementsAre(0, 1));
  for (const Body& body : tracker_.bodies()) EXPECT_EQ(body.cuboid.type, a.type);
}

TEST_F(Bodies, AreToldApartFromThoseOfATrackerBefore) {
  see({cuboidAt(pose(0.0, 0.0, 0.1))});
  BodyTracker next(BodyConfig(), tracker_.nextId());
  next.update(1.0, {cuboidAt(pose(0.4, 0.0, 0.1))}, {}, gpis_mapping::kEverywhere);
  EXPECT_THAT(idsOf(next), ElementsAre(1));
}

TEST_F(Bodies, NameTheirAxesAsBefore) {
  const Eigen::Isometry3d T = pose(0.0, 0.0, 0.1, 0.3);
  Cuboid first = cuboidAt(T);
  first.faces[0].patch = 7;  // +x
  see({first});
  Cuboid again = cuboidAt(T * Eigen::AngleAxisd(M_PI, Eigen::Vector3d::UnitZ()));
  again.faces[1].patch = 7;  // the same face, now called -x
  see({again});
  ASSERT_EQ(tracker_.bodies().size(), 1u);
  const Cuboid& known = tracker_.bodies()[0].cuboid;
  EXPECT_LT((known.T_map_body.matrix() - T.matrix()).norm(), 1e-12);  // rounding
  EXPECT_EQ(known.faces[0].patch, 7);
  EXPECT_EQ(known.faces[1].patch, -1);
}

TEST_F(Bodies, WithSwappedPlacesEachTakesTheNearest) {
  // 7 cm apart, closer than the gate: the nearest pair is taken first, whatever the order.
  const Cuboid low = cuboidAt(pose(0.0, 0.0, 0.1), {0.06, 0.06, 0.06});
  const Cuboid high = cuboidAt(pose(0.07, 0.0, 0.1), {0.06, 0.06, 0.06});
  see({low, high});
  see({high, low});
  EXPECT_DOUBLE_EQ(tracker_.bodies()[0].cuboid.T_map_body.translation().x(), 0.0);
  EXPECT_DOUBLE_EQ(tracker_.bodies()[1].cuboid.T_map_body.translation().x(), 0.07);
}

TEST_F(Bodies, OneThatWasSeenWronglyKeepsItsId) {
  see({cuboidAt(pose(0.0, 0.0, 0.1))});
  see({cuboidAt(pose(0.0, 0.0, 0.15, 0.0, M_PI / 2))});  // it stands upright after all
  EXPECT_THAT(idsOf(tracker_), ElementsAre(0));
}

TEST_F(Bodies, TwoThatTurnOutToBeOneAreOne) {
  see({cuboidAt(pose(-0.1, 0.0, 0.1)), cuboidAt(pose(0.22, 0.0, 0.1))});
  const auto update = see({cuboidAt(pose(-0.06, 0.0, 0.1))});
  EXPECT_THAT(idsOf(tracker_), ElementsAre(0, 1)) << "they share 2 cm: within the tolerance";
  const auto merged = see({cuboidAt(pose(0.0, 0.0, 0.1))});
  EXPECT_THAT(merged.dropped, ElementsAre(1));
  EXPECT_THAT(idsOf(tracker_), ElementsAre(0));
  EXPECT_THAT(update.dropped, IsEmpty());
}

TEST_F(Bodies, OneThatTurnsOutToBeTwoIsTwo) {
  see({cuboidAt(pose(0.0, 0.0, 0.1))});
  see({cuboidAt(pose(-0.05, 0.0, 0.1), {0.1, 0.2, 0.2}), cuboidAt(pose(0.06, 0.0, 0.1), {0.1, 0.2, 0.2})});
  EXPECT_THAT(idsOf(tracker_), ElementsAre(0, 1)) << "the nearer one is the known one";
  EXPECT_DOUBLE_EQ(tracker_.bodies()[0].cuboid.T_map_body.translation().x(), -0.05);
}

TEST_F(Bodies, AreForgottenWhenTheirPlaceIsFreeOrAfterAWhile) {
  const Cuboid a = cuboidAt(pose(0.0, 0.0, 0.1));
  see({a});
  for (int missed = 1; missed <= BodyConfig().max_missed; ++missed) {
    EXPECT_THAT(see({}, everywhere(SpaceState::kUnknown)).seen, IsEmpty());
    EXPECT_THAT(idsOf(tracker_), ElementsAre(0)) << missed;
  }
  EXPECT_THAT(see({}).dropped, ElementsAre(0));
  see({a});
  EXPECT_THAT(idsOf(tracker_), ElementsAre(1)) << "an id is never given again";
  EXPECT_THAT(see({}, everywhere(SpaceState::kFree)).dropped, ElementsAre(1));
}

TEST_F(Bodies, OnlyThoseLookedForAreSeenOrMissed) {
  const Cuboid a = cuboidAt(pose(0.0, 0.0, 0.1));
  const Cuboid b = cuboidAt(pose(0.5, 0.0, 0.1));
  see({a, b});
  const Eigen::AlignedBox3d around_a(Eigen::Vector3d(-0.2, -0.2, -0.1), Eigen::Vector3d(0.45, 0.2, 0.3));  // cuts b
  for (int i = 0; i <= BodyConfig().max_missed; ++i) {
    const auto update = see({a}, everywhere(SpaceState::kFree), around_a);
    EXPECT_THAT(update.seen, ElementsAre(0));
    EXPECT_THAT(update.dropped, IsEmpty());
  }
  Cuboid cut = b;
  cut.T_map_body.translation().x() -= 0.02;
  see({a, cut}, {}, around_a);
  EXPECT_DOUBLE_EQ(tracker_.bodies()[1].cuboid.T_map_body.translation().x(), 0.5);
  see({a, cuboidAt(pose(0.28, 0.0, 0.1))}, {}, around_a);  // so b cannot be where it was
  EXPECT_THAT(idsOf(tracker_), ElementsAre(0, 2));

  tracker_.attach(0);
  tracker_.detach(stamp_s_);
  for (int i = 0; i <= BodyConfig::kGoneUpdates; ++i) see({}, {}, Eigen::AlignedBox3d());
  see({a}, {}, around_a);
  EXPECT_THAT(idsOf(tracker_), ElementsAre(0, 2)) << "the same that was put back: nobody looked before";
}

TEST_F(Bodies, WhatIsInTheHandIsNotSeenAtItsOldPlace) {
  const Cuboid a = cuboidAt(pose(0.0, 0.0, 0.1));
  const Cuboid b = cuboidAt(pose(0.5, 0.0, 0.1));
  see({a, b});
  EXPECT_FALSE(tracker_.attach(7));
  EXPECT_TRUE(tracker_.attach(0));
  see({a, b});  // the map has not seen it leave
  EXPECT_THAT(idsOf(tracker_), ElementsAre(1));
  tracker_.detach(stamp_s_);
  see({a, b});  // put back
  EXPECT_THAT(idsOf(tracker_), ElementsAre(0, 1));
  EXPECT_EQ(tracker_.bodies()[0].num_looks, 2);
}

// The arm hides the place from the camera, and the map keeps what it had there.
TEST_F(Bodies, WhatTheMapStillHasOfABodyThatWasPutElsewhereIsNone) {
  const Cuboid a = cuboidAt(pose(0.0, 0.0, 0.1));
  see({a});
  tracker_.attach(0);
  tracker_.detach(stamp_s_, Eigen::Vector3d(0.0, 1.0, 0.6));
  for (int i = 0; i < 2 * BodyConfig::kGoneUpdates; ++i) {
    see({a});
    EXPECT_THAT(idsOf(tracker_), IsEmpty());
  }
  for (int i = 0; i <= BodyConfig::kGoneUpdates; ++i) see({});
  see({a});
  EXPECT_THAT(idsOf(tracker_), ElementsAre(1));

  tracker_.attach(1);
  tracker_.detach(stamp_s_, Eigen::Vector3d(0.0, 0.05, 0.1));  // put back
  see({a});
  EXPECT_THAT(idsOf(tracker_), ElementsAre(1));
}

TEST_F(Bodies, WhatAppearsElsewhereOrLaterIsAnother) {
  const Cuboid a = cuboidAt(pose(0.0, 0.0, 0.1));
  see({a});
  tracker_.attach(0);
  tracker_.detach(stamp_s_);
  see({cuboidAt(pose(0.0, 0.25, 0.1))});  // was hidden behind it
  EXPECT_THAT(idsOf(tracker_), ElementsAre(1));
  for (int i = 0; i < BodyConfig::kGoneUpdates; ++i) see({});
  see({a});
  EXPECT_THAT(idsOf(tracker_), testing::Contains(2));
}

TEST_F(Bodies, RefuseWhatIsNoUpdate) {
  see({});
  const auto messageOf = [&](double stamp_s, const std::vector<Cuboid>& cuboids) {
    return test_support::messageOf<std::invalid_argument>([&] { tracker_.update(stamp_s, cuboids, {}); });
  };
  EXPECT_THAT(messageOf(0.5, {}), HasSubstr("stamp = 0.5"));
  EXPECT_THAT(messageOf(NAN, {}), HasSubstr("must be finite"));
  Cuboid bad = cuboidAt(pose(0.0, 0.0, 0.1));
  bad.T_map_body.translation().x() = NAN;
  EXPECT_THAT(messageOf(2.0, {bad}), HasSubstr("'brick' must be finite"));
  EXPECT_THAT(tracker_.bodies(), IsEmpty());
  BodyConfig config;
  config.gate_m = -1.0;
  EXPECT_THAT(test_support::messageOf<std::invalid_argument>([&] { BodyTracker{config}; }), HasSubstr("gate_m = -1"));
}

}  // namespace
}  // namespace surface_picking
