// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include <QWidget>

#include "mission_view_model.h"

namespace pick_mission_rviz {

/// Name, bar from 0 to 1 and value of each, in rows.
class FactorBars : public QWidget {
  Q_OBJECT
 public:
  explicit FactorBars(QWidget* parent = nullptr);

  void setBars(const std::vector<MissionView::Bar>& bars);
  QSize sizeHint() const override;
  QSize minimumSizeHint() const override { return sizeHint(); }

 protected:
  void paintEvent(QPaintEvent* event) override;

 private:
  int rowHeight() const;

  std::vector<MissionView::Bar> bars_;
};

}  // namespace pick_mission_rviz
