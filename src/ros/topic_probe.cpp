// SPDX-License-Identifier: BSD-3-Clause
#include "devo/ros/topic_probe.h"

#include <mutex>
#include <utility>

namespace devo {
namespace {

constexpr std::uint32_t kQueueSize = 1;  // newer ones come to who subscribes in the type
constexpr double kAgain_s = 1;

}  // namespace

/// Shared with the subscription's callback, which may outlive the probe by the moment in which it returns.
struct TopicProbe::State : std::enable_shared_from_this<State> {
  State(const ros::NodeHandle& nh, std::string topic, OnMessage on_message)
      : nh_(nh), topic_(std::move(topic)), on_message_(std::move(on_message)) {}

  void Listen() {
    const std::lock_guard<std::mutex> lock(mutex_);
    if (ended_) return;
    subscriber_ = nh_.subscribe<topic_tools::ShapeShifter>(
        topic_, kQueueSize,
        boost::function<void(const topic_tools::ShapeShifter::ConstPtr&)>(
            [state = shared_from_this()](const topic_tools::ShapeShifter::ConstPtr& message) {
              state->Hear(*message);
            }));
  }

  /// A subscription keeps the type of the first message for good, hence another one where that was of no use.
  void Hear(const topic_tools::ShapeShifter& message) {
    const bool served = on_message_(message);
    ros::Subscriber subscriber;
    {
      const std::lock_guard<std::mutex> lock(mutex_);
      subscriber = subscriber_;
      if (!served && !ended_) {
        again_ = nh_.createWallTimer(
            ros::WallDuration(kAgain_s), [this](const ros::WallTimerEvent&) { Listen(); }, true);
      }
    }
    subscriber.shutdown();
  }

  /// Waits for callbacks that run on other threads.
  void End() {
    ros::Subscriber subscriber;
    ros::WallTimer again;
    {
      const std::lock_guard<std::mutex> lock(mutex_);
      ended_ = true;
      subscriber = subscriber_;
      again = again_;
    }
    again.stop();
    subscriber.shutdown();
  }

 private:
  ros::NodeHandle nh_;
  std::string topic_;
  OnMessage on_message_;
  std::mutex mutex_;  // a message may come before subscribe() has returned
  ros::Subscriber subscriber_;
  ros::WallTimer again_;
  bool ended_ = false;
};

TopicProbe::TopicProbe(const ros::NodeHandle& nh, const std::string& topic, OnMessage on_message)
    : state_(std::make_shared<State>(nh, topic, std::move(on_message))) {
  state_->Listen();
}

TopicProbe::~TopicProbe() { state_->End(); }

}  // namespace devo
