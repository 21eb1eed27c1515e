// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include <QWidget>

#include "mission_view_model.h"

namespace pick_mission_rviz {

/// A cell with its id for each brick, in as many rows as it takes; what is known of a brick as its tooltip. To eyes that
/// do not tell red from green: exhausted ones are crossed out, those that are away have a broken edge.
class BrickStrip : public QWidget {
  Q_OBJECT
 public:
  explicit BrickStrip(QWidget* parent = nullptr);

  void setBricks(const std::vector<MissionView::Brick>& bricks);
  QSize sizeHint() const override;
  bool hasHeightForWidth() const override { return true; }
  int heightForWidth(int width) const override;

 protected:
  void paintEvent(QPaintEvent* event) override;
  void resizeEvent(QResizeEvent* event) override;
  bool event(QEvent* event) override;

 private:
  QSize cellSize() const;
  int columns(int width) const;
  QRect cell(int index) const;

  std::vector<MissionView::Brick> bricks_;
};

}  // namespace pick_mission_rviz
