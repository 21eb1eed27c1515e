// SPDX-License-Identifier: BSD-3-Clause
#include "mission_widget.h"

#include <algorithm>
#include <stdexcept>

#include <QFrame>
#include <QGridLayout>
#include <QHBoxLayout>
#include <QScrollArea>
#include <QStringList>
#include <QVBoxLayout>

#include "brick_strip.h"
#include "factor_bars.h"

namespace pick_mission_rviz {
namespace {

constexpr int kRefresh_ms = 200;
constexpr double kMsPerS = 1000.0;
constexpr int kMargin_px = 6;
constexpr int kLeastWidth_px = 300;

const char kDefaultNode[] = "/pick_mission";
// Red and white in every state but pressed: a button that stops a robot does not change its looks.
const char kHoldStyle[] =
    "QPushButton { background: #b3261e; color: white; border: 2px solid #7a1610; border-radius: 6px; padding: 10px; }"
    "QPushButton:hover { background: #c9372e; } QPushButton:pressed { background: #7a1610; }";
const char kBadInk[] = "color: #b3261e;";

QString text(const std::string& utf8) {
  return QString::fromStdString(utf8);
}

QString html(const std::string& utf8) {
  return text(utf8).toHtmlEscaped();
}

QString css(const Rgb& rgb) {
  return QColor(rgb.r, rgb.g, rgb.b).name();
}

QLabel* makeLabel(const char* name) {
  auto* label = new QLabel;
  label->setObjectName(name);
  label->setWordWrap(true);
  label->setTextFormat(Qt::PlainText);  // sentences of nodes are not markup
  label->setTextInteractionFlags(Qt::TextSelectableByMouse);
  // May be squeezed: else a long word without a gap (a path) would set the panel's width.
  label->setSizePolicy(QSizePolicy::Ignored, QSizePolicy::Minimum);
  // Its height is by its width; without this the layout would also ask for that of one word in a line.
  label->setMinimumHeight(1);
  return label;
}

QLabel* makeHeading(const QString& words) {
  auto* heading = new QLabel(words);
  QFont font = heading->font();
  font.setBold(true);
  heading->setFont(font);
  return heading;
}

void enlarge(QWidget* widget, double factor, bool is_bold) {
  QFont font = widget->font();
  font.setPointSizeF(font.pointSizeF() * factor);
  font.setBold(is_bold);
  widget->setFont(font);
}

void setVisibleIfAny(QLabel* label, const std::string& words) {
  label->setText(text(words));
  label->setVisible(!words.empty());
}

}  // namespace

MissionWidget::MissionWidget(QWidget* parent)
    : QWidget(parent),
      connection_(
          [this](const interactive_mapping_msgs::MissionState::ConstPtr& state) {
            state_ = state;
            since_state_.restart();
            refresh();
          },
          [this](Request request, const Answer& answer) {
            if (waits_for_ == request) waits_for_.reset();
            say(answerInWords(request, answer, connection_.node()), !answer.success);
          }) {
  setMinimumWidth(kLeastWidth_px);
  auto* layout = new QVBoxLayout(this);
  layout->setContentsMargins(kMargin_px, kMargin_px, kMargin_px, kMargin_px);
  layout->setSpacing(kMargin_px);
  layout->addWidget(makeHead());
  layout->addWidget(makeButtons());
  layout->addWidget(makeStopQuestion());
  answer_ = makeLabel("answer");
  answer_->hide();
  layout->addWidget(answer_);

  // What is long scrolls; state and buttons do not move away.
  auto* scroll = new QScrollArea;
  scroll->setWidgetResizable(true);
  scroll->setFrameShape(QFrame::NoFrame);
  scroll->setHorizontalScrollBarPolicy(Qt::ScrollBarAlwaysOff);
  scroll->setWidget(makeDetails());
  layout->addWidget(scroll, 1);
  layout->addWidget(makeFoot());

  since_state_.start();
  setNode(kDefaultNode);
  connect(&timer_, &QTimer::timeout, this, &MissionWidget::refresh);
  timer_.start(kRefresh_ms);
}

QWidget* MissionWidget::makeHead() {
  auto* head = new QWidget;
  auto* layout = new QVBoxLayout(head);
  layout->setContentsMargins(0, 0, 0, 0);
  layout->setSpacing(kMargin_px);
  title_ = makeLabel("title");
  enlarge(title_, 1.35, true);
  since_ = makeLabel("since");
  auto* band = new QFrame;
  band->setObjectName("band");
  auto* band_layout = new QVBoxLayout(band);
  band_layout->setContentsMargins(8, 6, 8, 6);
  band_layout->setSpacing(2);
  band_layout->addWidget(title_);
  band_layout->addWidget(since_);
  layout->addWidget(band);
  note_ = makeLabel("note");
  enlarge(note_, 1.0, true);
  layout->addWidget(note_);
  time_ = new QProgressBar;
  time_->setObjectName("time");
  time_->setRange(0, 1000);
  time_->setTextVisible(true);
  layout->addWidget(time_);
  return head;
}

QWidget* MissionWidget::makeButtons() {
  auto* buttons = new QWidget;
  auto* layout = new QGridLayout(buttons);
  layout->setContentsMargins(0, 0, 0, 0);
  layout->setSpacing(kMargin_px);
  const auto make = [](const char* name, const QString& words, const QString& hint) {
    auto* button = new QPushButton(words);
    button->setObjectName(name);
    button->setToolTip(hint);
    button->setAutoDefault(false);
    return button;
  };
  start_ = make("start", tr("Start"), tr("Begins the mission."));
  pause_ = make("pause", tr("Pause"), QString());
  stop_ = make("stop", tr("Stop ..."), tr("Ends the mission for good; asks first."));
  hold_ = make("hold", tr("HOLD"), tr("Stops arm and base at once, in every state; resume releases the hold."));
  hold_->setStyleSheet(kHoldStyle);
  enlarge(hold_, 1.6, true);
  hold_->setMinimumHeight(56);
  layout->addWidget(start_, 0, 0);
  layout->addWidget(pause_, 0, 1);
  layout->addWidget(stop_, 0, 2);
  layout->addWidget(hold_, 1, 0, 1, 3);
  // Pressed, not clicked: it shall not matter where the button is let go.
  connect(hold_, &QPushButton::pressed, this, [this] { request(Request::kHold); });
  connect(start_, &QPushButton::clicked, this, [this] { request(Request::kStart); });
  connect(pause_, &QPushButton::clicked, this,
          [this] { request(is_pause_for_resume_ ? Request::kResume : Request::kPause); });
  connect(stop_, &QPushButton::clicked, this, [this] { stop_question_->show(); });
  return buttons;
}

QWidget* MissionWidget::makeStopQuestion() {
  // In the panel, not in a window of its own: such a one would keep everybody from pressing hold.
  auto* question = new QFrame;
  question->setObjectName("stop_question");
  question->setFrameShape(QFrame::StyledPanel);
  auto* layout = new QGridLayout(question);
  auto* words = makeLabel("stop_words");
  words->setText(tr("End the mission for good? It cannot be resumed."));
  layout->addWidget(words, 0, 0, 1, 2);
  auto* yes = new QPushButton(tr("End it"));
  yes->setObjectName("stop_yes");
  auto* no = new QPushButton(tr("Continue"));
  no->setObjectName("stop_no");
  for (QPushButton* button : {yes, no}) button->setAutoDefault(false);
  layout->addWidget(yes, 1, 0);
  layout->addWidget(no, 1, 1);
  connect(yes, &QPushButton::clicked, this, [this] {
    stop_question_->hide();
    request(Request::kStop);
  });
  connect(no, &QPushButton::clicked, this, [this] { stop_question_->hide(); });
  question->hide();
  stop_question_ = question;
  return question;
}

QWidget* MissionWidget::makeDetails() {
  details_ = new QWidget;
  details_->setObjectName("details");
  auto* layout = new QVBoxLayout(details_);
  layout->setContentsMargins(0, 0, kMargin_px, 0);
  layout->setSpacing(3);
  const auto space = [layout] { layout->addSpacing(kMargin_px); };

  layout->addWidget(makeHeading(tr("Decision")));
  decision_ = makeLabel("decision");
  layout->addWidget(decision_);
  space();

  layout->addWidget(makeHeading(tr("Bricks")));
  bricks_text_ = makeLabel("bricks_text");
  layout->addWidget(bricks_text_);
  bricks_ = new BrickStrip;
  bricks_->setObjectName("bricks");
  layout->addWidget(bricks_);
  counts_ = makeLabel("counts");
  counts_->setTextFormat(Qt::RichText);  // its words are our own
  layout->addWidget(counts_);
  space();

  layout->addWidget(makeHeading(tr("In the hand")));
  hand_ = makeLabel("hand");
  layout->addWidget(hand_);
  space();

  layout->addWidget(makeHeading(tr("View")));
  view_text_ = makeLabel("view_text");
  layout->addWidget(view_text_);
  bars_ = new FactorBars;
  bars_->setObjectName("bars");
  layout->addWidget(bars_);
  space();

  layout->addWidget(makeHeading(tr("Failures")));
  failures_ = makeLabel("failures");
  failures_->setTextFormat(Qt::RichText);  // what comes of the node is escaped
  layout->addWidget(failures_);
  space();

  run_ = makeLabel("run");
  layout->addWidget(run_);
  layout->addStretch(1);
  return details_;
}

QWidget* MissionWidget::makeFoot() {
  auto* foot = new QWidget;
  auto* layout = new QHBoxLayout(foot);
  layout->setContentsMargins(0, 0, 0, 0);
  layout->addWidget(new QLabel(tr("Node")));
  node_ = new QLineEdit;
  node_->setObjectName("node");
  node_->setToolTip(tr("Whose topic ~state and services ~start, ~pause, ~resume, ~hold and ~stop these are."));
  layout->addWidget(node_, 1);
  connect(node_, &QLineEdit::editingFinished, this, [this] {
    if (node_->text() == node()) return;
    setNode(node_->text());
    Q_EMIT nodeChanged();
  });
  return foot;
}

QString MissionWidget::node() const {
  return text(connection_.node());
}

void MissionWidget::setNode(const QString& node) {
  try {
    connection_.connectTo(node.trimmed().toStdString());
  } catch (const std::invalid_argument& error) {
    node_->setText(this->node());
    say(error.what(), true);
    return;
  }
  node_->setText(this->node());
  state_.reset();
  waits_for_.reset();
  stop_question_->hide();
  since_state_.restart();
  say("", false);
  refresh();
}

void MissionWidget::request(Request request) {
  // Pressed again before there was an answer: how long it has been waited for is worth more than that it was pressed.
  if (waits_for_ != request) {
    waits_for_ = request;
    since_request_.restart();
    say(waitingInWords(request, 0.0, connection_.node()), false);
  }
  connection_.call(request);
}

void MissionWidget::say(const std::string& sentence, bool is_bad) {
  answer_->setStyleSheet(is_bad ? kBadInk : "");
  setVisibleIfAny(answer_, sentence);
}

double MissionWidget::ageOfState() const {
  return static_cast<double>(since_state_.elapsed()) / kMsPerS;
}

void MissionWidget::refresh() {
  display(makeView(state_.get(), ageOfState(), connection_.node()));
  if (!waits_for_) return;
  const double waited_s = static_cast<double>(since_request_.elapsed()) / kMsPerS;
  say(waitingInWords(*waits_for_, waited_s, connection_.node()), waited_s >= kAnswerTimeout_s);
}

void MissionWidget::display(const MissionView& view) {
  title_->setText(text(view.title));
  setVisibleIfAny(since_, view.since);
  const QString style = QString("#band { background: %1; border-radius: 6px; } #band QLabel { color: %2; }")
                            .arg(css(view.fill), css(view.ink));
  QWidget* band = title_->parentWidget();
  if (band->styleSheet() != style) band->setStyleSheet(style);
  setVisibleIfAny(note_, view.note);
  time_->setValue(static_cast<int>(view.time_share * time_->maximum()));
  time_->setFormat(text(view.time));
  time_->setVisible(!view.time.empty());
  time_->setEnabled(view.is_live);

  start_->setEnabled(view.can_start);
  pause_->setEnabled(view.can_pause || view.can_resume);
  is_pause_for_resume_ = view.can_resume && !view.can_pause;
  pause_->setText(is_pause_for_resume_ ? tr("Resume") : tr("Pause"));
  pause_->setToolTip(is_pause_for_resume_
                         ? tr("Resumes after a fresh inspection; without a mission it releases a hold.")
                         : tr("Pauses when the running action has ended."));
  stop_->setEnabled(view.can_stop);
  hold_->setEnabled(view.can_hold);
  if (!view.can_stop) stop_question_->hide();

  details_->setEnabled(view.is_live);
  decision_->setText(text(view.decision));
  bricks_text_->setText(text(view.bricks_text));
  bricks_->setBricks(view.bricks);
  QString counts;
  for (const MissionView::Count& count : view.counts) {
    // No line break within one.
    counts += QString("<span style=\"color:%1\">&#9632;</span>&nbsp;%2&nbsp;&nbsp; ")
                  .arg(css(count.color), text(count.text).replace(' ', "&nbsp;"));
  }
  counts_->setText(counts);
  counts_->setVisible(!view.counts.empty());
  hand_->setText(text(view.hand));
  view_text_->setText(text(view.view_text));
  bars_->setBars(view.bars);
  QString failures = html(view.failures_text);
  QStringList hints;
  for (const MissionView::Failure& failure : view.failures) {
    failures += QString("<div style=\"margin-top:3px\"><b>%1</b>: %2").arg(html(failure.when), html(failure.what));
    if (!failure.then.empty()) failures += QString("<br/>&rarr; %1").arg(html(failure.then));
    failures += "</div>";
    if (!failure.hint.empty()) hints += QString("<b>%1</b>: %2").arg(html(failure.when), html(failure.hint));
  }
  failures_->setText(failures);
  failures_->setToolTip(hints.join("<br/>"));
  setVisibleIfAny(run_, view.run);
}

}  // namespace pick_mission_rviz
