// SPDX-License-Identifier: BSD-3-Clause
#include "mission_panel.h"

#include <QVBoxLayout>
#include <pluginlib/class_list_macros.hpp>

#include "mission_widget.h"

namespace pick_mission_rviz {
namespace {

const char kNodeKey[] = "Node";

}  // namespace

MissionPanel::MissionPanel(QWidget* parent) : rviz::Panel(parent), widget_(new MissionWidget) {
  auto* layout = new QVBoxLayout(this);
  layout->setContentsMargins(0, 0, 0, 0);
  layout->addWidget(widget_);
  connect(widget_, &MissionWidget::nodeChanged, this, &MissionPanel::configChanged);
}

void MissionPanel::load(const rviz::Config& config) {
  rviz::Panel::load(config);
  QString node;
  if (config.mapGetString(kNodeKey, &node)) widget_->setNode(node);
}

void MissionPanel::save(rviz::Config config) const {
  rviz::Panel::save(config);
  config.mapSetValue(kNodeKey, widget_->node());
}

}  // namespace pick_mission_rviz

PLUGINLIB_EXPORT_CLASS(pick_mission_rviz::MissionPanel, rviz::Panel)
