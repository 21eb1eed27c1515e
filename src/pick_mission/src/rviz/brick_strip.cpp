// SPDX-License-Identifier: BSD-3-Clause
#include "brick_strip.h"

#include <algorithm>

#include <QHelpEvent>
#include <QPainter>
#include <QToolTip>
#include <interactive_mapping_msgs/MissionBrick.h>

namespace pick_mission_rviz {
namespace {

using interactive_mapping_msgs::MissionBrick;

constexpr int kGap_px = 3;

QColor toColor(const Rgb& rgb) {
  return {rgb.r, rgb.g, rgb.b};
}

}  // namespace

BrickStrip::BrickStrip(QWidget* parent) : QWidget(parent) {
  QSizePolicy policy(QSizePolicy::Expanding, QSizePolicy::Fixed);
  policy.setHeightForWidth(true);
  setSizePolicy(policy);
}

void BrickStrip::setBricks(const std::vector<MissionView::Brick>& bricks) {
  bricks_ = bricks;
  setFixedHeight(heightForWidth(width()));
  updateGeometry();
  update();
}

QSize BrickStrip::cellSize() const {
  const QFontMetrics metrics(font());
  return {metrics.horizontalAdvance("000") + 8, metrics.height() + 6};
}

int BrickStrip::columns(int width) const {
  return std::max(1, (width + kGap_px) / (cellSize().width() + kGap_px));
}

int BrickStrip::heightForWidth(int width) const {
  const int count = static_cast<int>(bricks_.size());
  const int rows = (count + columns(width) - 1) / columns(width);
  return std::max(0, rows * (cellSize().height() + kGap_px) - kGap_px);
}

QSize BrickStrip::sizeHint() const {
  return {320, heightForWidth(320)};
}

QRect BrickStrip::cell(int index) const {
  const QSize size = cellSize();
  const int row = index / columns(width());
  const int column = index % columns(width());
  return {QPoint(column * (size.width() + kGap_px), row * (size.height() + kGap_px)), size};
}

void BrickStrip::resizeEvent(QResizeEvent* event) {
  QWidget::resizeEvent(event);
  setFixedHeight(heightForWidth(width()));
}

void BrickStrip::paintEvent(QPaintEvent* /*event*/) {
  QPainter painter(this);
  painter.setRenderHint(QPainter::Antialiasing);
  if (!isEnabled()) painter.setOpacity(kGreyed);
  for (int i = 0; i < static_cast<int>(bricks_.size()); ++i) {
    const MissionView::Brick& brick = bricks_[static_cast<std::size_t>(i)];
    const QRectF box = QRectF(cell(i)).adjusted(1.0, 1.0, -1.0, -1.0);
    const bool is_away = brick.status == MissionBrick::AWAY;
    const QColor fill = toColor(brick.fill);
    QPen edge(is_away ? palette().color(QPalette::WindowText) : fill.darker(150), 1.0);
    if (is_away) edge.setStyle(Qt::DashLine);
    painter.setPen(edge);
    painter.setBrush(fill);
    painter.drawRoundedRect(box, 3.0, 3.0);
    if (brick.status == MissionBrick::EXHAUSTED) {
      QColor line = toColor(brick.ink);
      line.setAlphaF(0.45);  // the id stays readable
      painter.setPen(QPen(line, 1.5));
      painter.drawLine(box.bottomLeft(), box.topRight());
      painter.drawLine(box.topLeft(), box.bottomRight());
    }
    QFont letters = font();
    letters.setBold(brick.status == MissionBrick::CURRENT);
    painter.setFont(letters);
    painter.setPen(toColor(brick.ink));
    painter.drawText(box, Qt::AlignCenter, QString::number(brick.id));
  }
}

bool BrickStrip::event(QEvent* event) {
  if (event->type() != QEvent::ToolTip) return QWidget::event(event);
  const auto* help = static_cast<QHelpEvent*>(event);
  for (int i = 0; i < static_cast<int>(bricks_.size()); ++i) {
    if (!cell(i).contains(help->pos())) continue;
    QToolTip::showText(help->globalPos(), QString::fromStdString(bricks_[static_cast<std::size_t>(i)].hint), this);
    return true;
  }
  QToolTip::hideText();
  return true;
}

}  // namespace pick_mission_rviz
