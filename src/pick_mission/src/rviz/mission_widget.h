// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <string>

#include <QElapsedTimer>
#include <QLabel>
#include <QLineEdit>
#include <QProgressBar>
#include <QPushButton>
#include <QTimer>
#include <QWidget>
#include <interactive_mapping_msgs/MissionState.h>

#include "mission_connection.h"
#include "mission_view_model.h"

namespace pick_mission_rviz {

class BrickStrip;
class FactorBars;

/// A mission to look at, and its buttons. Hold can be pressed at any time, also while nothing comes of the node: nothing
/// here is modal. Needs ros::init(); waits for nobody.
class MissionWidget : public QWidget {
  Q_OBJECT
 public:
  explicit MissionWidget(QWidget* parent = nullptr);

  /// The node whose mission it is. A name that is none is not taken, and the panel says why.
  void setNode(const QString& node);
  QString node() const;

 Q_SIGNALS:
  void nodeChanged();

 private:
  QWidget* makeHead();
  QWidget* makeButtons();
  QWidget* makeStopQuestion();
  QWidget* makeDetails();
  QWidget* makeFoot();
  void request(Request request);
  void display(const MissionView& view);
  void refresh();
  void say(const std::string& sentence, bool is_bad);
  double ageOfState() const;  // [s], wall time

  MissionConnection connection_;
  interactive_mapping_msgs::MissionState::ConstPtr state_;
  QElapsedTimer since_state_;  // or since it waits for the first
  std::optional<Request> waits_for_;
  QElapsedTimer since_request_;
  QTimer timer_;

  QLabel* title_{nullptr};
  QLabel* since_{nullptr};
  QLabel* note_{nullptr};
  QProgressBar* time_{nullptr};
  QPushButton* start_{nullptr};
  QPushButton* pause_{nullptr};  // or resume
  QPushButton* stop_{nullptr};
  QPushButton* hold_{nullptr};
  QWidget* stop_question_{nullptr};
  QLabel* answer_{nullptr};
  QWidget* details_{nullptr};
  QLabel* bricks_text_{nullptr};
  BrickStrip* bricks_{nullptr};
  QLabel* counts_{nullptr};
  QLabel* decision_{nullptr};
  QLabel* hand_{nullptr};
  QLabel* view_text_{nullptr};
  FactorBars* bars_{nullptr};
  QLabel* failures_{nullptr};
  QLabel* run_{nullptr};
  QLineEdit* node_{nullptr};
  bool is_pause_for_resume_{false};
};

}  // namespace pick_mission_rviz
