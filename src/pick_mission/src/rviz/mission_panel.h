// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <rviz/panel.h>

namespace pick_mission_rviz {

class MissionWidget;

/// MissionWidget as a panel of rviz; the node's name is kept in rviz' configuration as `Node`.
class MissionPanel : public rviz::Panel {
  Q_OBJECT
 public:
  explicit MissionPanel(QWidget* parent = nullptr);

  void load(const rviz::Config& config) override;
  void save(rviz::Config config) const override;

 private:
  MissionWidget* widget_;
};

}  // namespace pick_mission_rviz
