// SPDX-License-Identifier: BSD-3-Clause
// The plugin as rviz gets hold of it; main() is in test_mission_widget.cpp.
#include <memory>

#include <QLineEdit>
#include <gmock/gmock.h>
#include <pluginlib/class_loader.hpp>
#include <rviz/config.h>
#include <rviz/panel.h>

namespace {

// After the loader: a panel must not outlive its library.
class MissionPanelTest : public testing::Test {
 protected:
  MissionPanelTest() : loader_("rviz", "rviz::Panel") {
    panel_.reset(loader_.createUnmanagedInstance("pick_mission_rviz/MissionPanel"));
  }
  std::string nodeShown() const { return panel_->findChild<QLineEdit*>("node")->text().toStdString(); }

  pluginlib::ClassLoader<rviz::Panel> loader_;
  std::unique_ptr<rviz::Panel> panel_;
};

TEST_F(MissionPanelTest, KeepsItsNodeInTheConfiguration) {
  EXPECT_EQ(nodeShown(), "/pick_mission");
  rviz::Config config;
  config.mapSetValue("Name", "Mission");
  config.mapSetValue("Node", "/robot_2/pick_mission");
  panel_->load(config);
  EXPECT_EQ(nodeShown(), "/robot_2/pick_mission");
  rviz::Config saved;
  panel_->save(saved);
  QString node;
  ASSERT_TRUE(saved.mapGetString("Node", &node));
  EXPECT_EQ(node.toStdString(), "/robot_2/pick_mission");
}

TEST_F(MissionPanelTest, AConfigurationWithoutANodeChangesNothing) {
  panel_->load(rviz::Config());
  EXPECT_EQ(nodeShown(), "/pick_mission");
}

// rviz asks whether to save what was changed: that a panel was loaded is no change.
TEST_F(MissionPanelTest, TellsRvizOfAChangeByThePersonAlone) {
  int changes = 0;
  QObject::connect(panel_.get(), &rviz::Panel::configChanged, [&] { ++changes; });
  rviz::Config config;
  config.mapSetValue("Node", "/one");
  panel_->load(config);
  EXPECT_EQ(changes, 0);
  auto* line = panel_->findChild<QLineEdit*>("node");
  line->setText("/two");
  Q_EMIT line->editingFinished();
  EXPECT_EQ(changes, 1);
}

}  // namespace
