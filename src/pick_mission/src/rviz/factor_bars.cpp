// SPDX-License-Identifier: BSD-3-Clause
#include "factor_bars.h"

#include <algorithm>

#include <QPainter>

namespace pick_mission_rviz {
namespace {

constexpr int kSpace_px = 6;
constexpr int kLeastBar_px = 60;

}  // namespace

FactorBars::FactorBars(QWidget* parent) : QWidget(parent) {
  setSizePolicy(QSizePolicy::Expanding, QSizePolicy::Fixed);
}

void FactorBars::setBars(const std::vector<MissionView::Bar>& bars) {
  bars_ = bars;
  updateGeometry();
  update();
}

int FactorBars::rowHeight() const {
  return QFontMetrics(font()).height() + 4;
}

QSize FactorBars::sizeHint() const {
  return {280, rowHeight() * static_cast<int>(bars_.size())};
}

void FactorBars::paintEvent(QPaintEvent* /*event*/) {
  QPainter painter(this);
  painter.setRenderHint(QPainter::Antialiasing);
  if (!isEnabled()) painter.setOpacity(kGreyed);
  const QFontMetrics metrics(font());
  int name_px = 0;
  for (const MissionView::Bar& bar : bars_) {
    name_px = std::max(name_px, metrics.horizontalAdvance(QString::fromStdString(bar.name)));
  }
  const int value_px = metrics.horizontalAdvance("0.00");
  const int left = name_px + kSpace_px;
  const int length = std::max(kLeastBar_px, width() - left - kSpace_px - value_px);
  const int height = rowHeight();
  const QColor ink = palette().color(QPalette::WindowText);
  QColor track = ink;
  track.setAlphaF(0.12);
  for (int i = 0; i < static_cast<int>(bars_.size()); ++i) {
    const MissionView::Bar& bar = bars_[static_cast<std::size_t>(i)];
    const QRect row(0, i * height, width(), height);
    QColor text = ink;
    if (bar.is_off) text.setAlphaF(0.5);
    painter.setPen(text);
    painter.drawText(row, Qt::AlignLeft | Qt::AlignVCenter, QString::fromStdString(bar.name));
    painter.drawText(row, Qt::AlignRight | Qt::AlignVCenter, QString::fromStdString(bar.value));
    const QRectF full(left, row.top() + 4, length, height - 8);
    painter.setPen(Qt::NoPen);
    painter.setBrush(track);
    painter.drawRect(full);
    QColor fill(bar.color.r, bar.color.g, bar.color.b);
    if (bar.is_off) fill.setAlphaF(0.3);
    painter.setBrush(fill);
    painter.drawRect(QRectF(full.topLeft(), QSizeF(bar.share * full.width(), full.height())));
  }
}

}  // namespace pick_mission_rviz
