// SPDX-License-Identifier: BSD-3-Clause
//
// What one nodelet says about itself: inputs with their rates, what is missing in plain sentences, and /diagnostics.
#pragma once

#include <functional>
#include <memory>
#include <mutex>
#include <string>
#include <utility>
#include <vector>

#include <diagnostic_updater/diagnostic_updater.h>
#include <ros/node_handle.h>

#include "devo/ros/known_topics.h"
#include "devo/ros/statistics.h"

namespace devo {

/// One subscribed topic. Arrivals may be reported from any thread.
class Input {
 public:
  /// Of a `kSteady` input silence is reported also when it has arrived before; a `kOccasional` one may fall silent.
  /// Without a `kOptional` one, else like a steady one, everything goes on: that is a warning, no error.
  enum class Kind { kSteady, kOccasional, kOptional };

  Input(std::string role, std::string topic, std::string type, Kind kind);

  /// `t_ns`: data time of the message.
  void Arrived(std::int64_t t_ns);
  /// A message that is not looked into.
  void ArrivedUnread();
  /// A message that holds nothing: counted, but no end of a silence.
  void ArrivedEmpty();
  bool HasArrived() const;

  /// Nothing has come for 3 s of wall time (or ever).
  bool IsSilent() const;

  /// "No events ..." while nothing has come, "No more events ..." when a steady input has fallen silent, else empty.
  std::string MissingSentence(const KnownTopics& known) const;
  /// WARN or ERROR: what that sentence is in /diagnostics.
  unsigned char LevelOfMissing() const;
  void Fill(diagnostic_updater::DiagnosticStatusWrapper& status) const;

 private:
  std::string role_, topic_, type_;
  Kind kind_;
  ros::WallTime last_arrival_, last_empty_;
  std::uint64_t messages_ = 0;
  mutable std::mutex mutex_;
  RateMeter rate_;
};

/// What went wrong while running, for a status: named for some seconds of wall time, counted for good. Not thread-safe.
class Failures {
 public:
  explicit Failures(double shown_s = 10) : shown_s_(shown_s) {}

  void Add(const std::string& text);

  /// The last one as the status' summary, if it is recent, and their number. Returns whether it was recent.
  bool Fill(diagnostic_updater::DiagnosticStatusWrapper& status) const;

 private:
  double shown_s_;
  std::string last_;
  ros::WallTime last_time_;
  std::uint64_t count_ = 0;
};

class Health {
 public:
  using Fill = std::function<void(diagnostic_updater::DiagnosticStatusWrapper&)>;
  using Missing = std::function<std::vector<std::string>(const KnownTopics&)>;

  /// Reports once per second of wall time, also while no data and no clock comes.
  Health(const ros::NodeHandle& nh, const ros::NodeHandle& private_nh);

  /// An input whose absence, or later silence, is reported: at once in /diagnostics, after 3 s in the log.
  std::shared_ptr<Input> AddInput(const std::string& role, const std::string& topic, const std::string& type,
                                  Input::Kind kind = Input::Kind::kSteady);

  /// Sentences about other things that are missing (calibration, transformations).
  void AddMissing(Missing missing);

  /// A status of its own in /diagnostics. Added while the node is set up, before Start.
  void AddTask(const std::string& name, Fill fill);

  void Start();

 private:
  struct Complaint {
    std::string sentence;
    unsigned char level;
  };

  void Report(diagnostic_updater::DiagnosticStatusWrapper& status);
  /// Indices of silent inputs, then their number as often as other things are missing.
  std::vector<std::size_t> WhatIsMissing() const;
  std::vector<Complaint> Complaints();
  void Tick();

  ros::NodeHandle nh_, private_nh_;
  std::string name_;
  std::vector<std::pair<std::string, Fill>> tasks_;
  std::unique_ptr<diagnostic_updater::Updater>
      updater_;  // from Start: a refused parameter leaves no trace in the graph
  std::vector<std::shared_ptr<Input>> inputs_;
  std::vector<Missing> missing_;
  std::vector<Complaint> complaints_;
  std::vector<std::size_t> what_is_missing_;  // when it was last complained of
  int ticks_missing_ = 0;
  ros::WallTimer timer_;
};

}  // namespace devo
