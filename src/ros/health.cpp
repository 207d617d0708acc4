// SPDX-License-Identifier: BSD-3-Clause
#include "devo/ros/health.h"

#include <algorithm>
#include <utility>

namespace devo {
namespace {

constexpr double kSilence_s = 3;
constexpr int kTicksUntilWarning = 3;
constexpr int kTicksBetweenWarnings = 30;
constexpr int kTicksBetweenQuestions = 5;  // to the master, once it has been waited for longer

bool Recent(const ros::WallTime& time) { return !time.isZero() && (ros::WallTime::now() - time).toSec() <= kSilence_s; }

}  // namespace

Input::Input(std::string role, std::string topic, std::string type, Kind kind)
    : role_(std::move(role)), topic_(std::move(topic)), type_(std::move(type)), kind_(kind) {}

void Input::Arrived(std::int64_t t_ns) {
  const std::lock_guard<std::mutex> lock(mutex_);
  rate_.Add(t_ns);
  ++messages_;
  last_arrival_ = ros::WallTime::now();
}

void Input::ArrivedUnread() {
  const std::lock_guard<std::mutex> lock(mutex_);
  ++messages_;
  last_arrival_ = ros::WallTime::now();
}

void Input::ArrivedEmpty() {
  const std::lock_guard<std::mutex> lock(mutex_);
  ++messages_;
  last_empty_ = ros::WallTime::now();
}

bool Input::IsSilent() const {
  const std::lock_guard<std::mutex> lock(mutex_);
  if (last_arrival_.isZero()) return true;
  return kind_ != Kind::kOccasional && !Recent(last_arrival_);
}

unsigned char Input::LevelOfMissing() const {
  using diagnostic_msgs::DiagnosticStatus;
  return kind_ == Kind::kOptional ? DiagnosticStatus::WARN : DiagnosticStatus::ERROR;
}

bool Input::HasArrived() const {
  const std::lock_guard<std::mutex> lock(mutex_);
  return !last_arrival_.isZero();
}

std::string Input::MissingSentence(const KnownTopics& known) const {
  if (!IsSilent()) return "";
  if (topic_.empty()) return "No " + role_ + ": the configuration names no topic for it.";
  const std::string begin = (HasArrived() ? "No more " : "No ") + role_ + " on " + topic_ + " (" + type_ + "): ";
  const std::lock_guard<std::mutex> lock(mutex_);
  if (Recent(last_empty_)) return begin + "its messages come but hold none.";
  return begin + DescribeTopic(known, topic_, type_) + ".";
}

void Input::Fill(diagnostic_updater::DiagnosticStatusWrapper& status) const {
  const std::lock_guard<std::mutex> lock(mutex_);
  status.add(role_ + " topic", topic_);
  status.add(role_ + " messages", messages_);
  status.addf(role_ + " rate (Hz of data time)", "%.1f", rate_.Hz());
}

void Failures::Add(const std::string& text) {
  last_ = text;
  last_time_ = ros::WallTime::now();
  ++count_;
}

bool Failures::Fill(diagnostic_updater::DiagnosticStatusWrapper& status) const {
  status.add("failures", count_);
  const bool recent = count_ > 0 && (ros::WallTime::now() - last_time_).toSec() < shown_s_;
  if (recent) status.summary(diagnostic_msgs::DiagnosticStatus::ERROR, last_);
  return recent;
}

Health::Health(const ros::NodeHandle& nh, const ros::NodeHandle& private_nh)
    : nh_(nh), private_nh_(private_nh), name_(private_nh.getNamespace()) {}

std::shared_ptr<Input> Health::AddInput(const std::string& role, const std::string& topic, const std::string& type,
                                        Input::Kind kind) {
  inputs_.push_back(std::make_shared<Input>(role, topic, type, kind));
  return inputs_.back();
}

void Health::AddMissing(Missing missing) { missing_.push_back(std::move(missing)); }

void Health::AddTask(const std::string& name, Fill fill) { tasks_.emplace_back(name, std::move(fill)); }

void Health::Start() {
  updater_ = std::make_unique<diagnostic_updater::Updater>(nh_, private_nh_, name_);
  updater_->setHardwareID("none");
  for (const auto& [name, fill] : tasks_) updater_->add(name, fill);
  updater_->add("inputs", this, &Health::Report);
  timer_ = nh_.createWallTimer(ros::WallDuration(1.0), [this](const ros::WallTimerEvent&) { Tick(); });
}

void Health::Report(diagnostic_updater::DiagnosticStatusWrapper& status) {
  status.summary(diagnostic_msgs::DiagnosticStatus::OK, "all inputs arrive");
  // mergeSummary joins the sentences and keeps the worst level.
  for (const Complaint& complaint : complaints_) status.mergeSummary(complaint.level, complaint.sentence);
  for (const auto& input : inputs_) input->Fill(status);
}

std::vector<std::size_t> Health::WhatIsMissing() const {
  std::vector<std::size_t> what;
  for (std::size_t i = 0; i < inputs_.size(); ++i) {
    if (inputs_[i]->IsSilent()) what.push_back(i);
  }
  const KnownTopics nothing_known;
  for (const Missing& missing : missing_) what.insert(what.end(), missing(nothing_known).size(), inputs_.size());
  return what;
}

std::vector<Health::Complaint> Health::Complaints() {
  std::vector<std::size_t> what = WhatIsMissing();
  if (what.empty()) return {};
  // What is missing since a moment ago is named as soon as if nothing had been missing before.
  if (what != what_is_missing_) ticks_missing_ = 0;
  what_is_missing_ = std::move(what);
  if (ticks_missing_ > 2 * kTicksUntilWarning && ticks_missing_ % kTicksBetweenQuestions != 0) return complaints_;

  const auto topics = AskForTopics();
  const KnownTopics& known = *topics;
  std::vector<Complaint> complaints;
  for (const auto& input : inputs_) {
    const std::string sentence = input->MissingSentence(known);
    if (!sentence.empty()) complaints.push_back({sentence, input->LevelOfMissing()});
  }
  for (const Missing& missing : missing_) {
    for (std::string& sentence : missing(known)) {
      complaints.push_back({std::move(sentence), diagnostic_msgs::DiagnosticStatus::ERROR});
    }
  }
  return complaints;
}

void Health::Tick() {
  complaints_ = Complaints();
  ticks_missing_ = complaints_.empty() ? 0 : ticks_missing_ + 1;
  if (ticks_missing_ >= kTicksUntilWarning && (ticks_missing_ - kTicksUntilWarning) % kTicksBetweenWarnings == 0) {
    for (const Complaint& complaint : complaints_) ROS_WARN_STREAM(name_ << ": " << complaint.sentence);
  }
  updater_->force_update();
}

}  // namespace devo
