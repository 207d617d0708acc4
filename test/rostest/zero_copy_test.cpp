// SPDX-License-Identifier: BSD-3-Clause
//
// Within one process a message that is received is the object that was published.
#include <gtest/gtest.h>
#include <nodelet/loader.h>
#include <ros/ros.h>
#include <std_msgs/String.h>

#include <algorithm>
#include <set>
#include <string>
#include <vector>

#include "devo/ros/core_messages.h"
#include "devo/ros/event_message_types.h"
#include "devo/ros/event_source.h"
#include "devo/ros/topics.h"

namespace devo {
namespace {

template <typename Message>
using ConstPtr = boost::shared_ptr<const Message>;

template <typename Message>
boost::function<void(const ConstPtr<Message>&)> StoreIn(ConstPtr<Message>* received) {
  return [received](const ConstPtr<Message>& message) { *received = message; };
}

template <typename Condition>
bool SpinUntil(const Condition& done, double timeout_s = 5) {
  const ros::WallTime end = ros::WallTime::now() + ros::WallDuration(timeout_s);
  while (!done() && ros::WallTime::now() < end && ros::ok()) {
    ros::spinOnce();
    ros::WallDuration(0.002).sleep();
  }
  return done();
}

template <typename Message>
void ExpectSameObject(const ConstPtr<Message>& message) {
  ros::NodeHandle nh;
  ConstPtr<Message> received;
  ros::Publisher publisher = nh.advertise<Message>("zero_copy", 1);
  const ros::Subscriber subscriber = nh.subscribe<Message>("zero_copy", 1, StoreIn<Message>(&received));
  ASSERT_TRUE(SpinUntil([&] { return publisher.getNumSubscribers() > 0; }));
  publisher.publish(message);
  ASSERT_TRUE(SpinUntil([&] { return received != nullptr; }));
  EXPECT_EQ(received.get(), message.get());
}

TEST(ZeroCopy, ASurfaceIsReceivedAsTheObjectThatTheCoreMade) {
  const SurfacePtr from_core = std::make_shared<const Surface>();
  const ConstPtr<Surface> message = ToBoost(from_core);
  EXPECT_EQ(message.get(), from_core.get());
  ExpectSameObject(message);
}

TEST(ZeroCopy, APoseALocalMapASceneDepthAndEventsAreReceivedAsTheObjectsThatWerePublished) {
  ExpectSameObject<PoseEstimate>(boost::make_shared<const PoseEstimate>());
  ExpectSameObject<LocalMap>(ToBoost(LocalMapPtr(std::make_shared<const LocalMap>())));
  ExpectSameObject<SceneDepth>(boost::make_shared<const SceneDepth>());
  ExpectSameObject<EventArray>(boost::make_shared<const EventArray>());
}

TEST(ZeroCopy, AnotherTypeOfTheSameLayoutGetsACopyOfTheContent) {
  ros::NodeHandle nh;
  TimeSurfaceConstPtr received;
  ros::Publisher publisher = nh.advertise<Surface>("copied", 1);
  const ros::Subscriber subscriber = nh.subscribe<TimeSurface>("copied", 1, StoreIn<TimeSurface>(&received));
  auto surface = boost::make_shared<Surface>();
  surface->t_ns = 1'234'567'890;
  surface->image = cv::Mat1b(2, 3, std::uint8_t{9});
  ASSERT_TRUE(SpinUntil([&] { return publisher.getNumSubscribers() > 0; }));
  publisher.publish(ConstPtr<Surface>(surface));
  ASSERT_TRUE(SpinUntil([&] { return received != nullptr; }));
  EXPECT_EQ(received->stamp.toNSec(), 1'234'567'890U);
  EXPECT_EQ(received->image, std::vector<std::uint8_t>(6, 9));
}

template <typename... Messages>
testing::Types<Messages...> ForTests(MessageTypes<Messages...>);
using DriverTypes = decltype(ForTests(EventMessageTypes()));

template <typename Message>
struct DriverMessages : testing::Test {};
TYPED_TEST_SUITE(DriverMessages, DriverTypes);

TYPED_TEST(DriverMessages, ReachTheEventSourceAsTheObjectThatTheDriverPublished) {
  ros::NodeHandle nh;
  const std::string type = ros::message_traits::DataType<TypeParam>::value();
  std::string topic = "/driver/" + type;
  std::replace(topic.begin() + 1, topic.end(), '/', '_');
  std::vector<EventMessage> received;
  // The driver comes later: until then the source cannot know its type.
  const EventSource source(nh, topic, 10, [&](EventMessage message) { received.push_back(std::move(message)); });
  ros::Publisher driver = nh.advertise<TypeParam>(topic, 10);
  const auto message = boost::make_shared<TypeParam>();
  message->width = 7;
  ASSERT_TRUE(SpinUntil([&] {
    driver.publish(boost::shared_ptr<const TypeParam>(message));
    ros::WallDuration(0.02).sleep();
    ros::spinOnce();
    // Those that came before the source knew are copies.
    return !received.empty() && received.back().message.get() == message.get();
  })) << type
      << ", after " << received.size() << " messages";
}

template <typename Message>
ros::Publisher DriverWithSubscriber(const std::string& topic) {
  ros::NodeHandle nh;
  ros::Publisher driver = nh.advertise<Message>(topic, 10);
  EXPECT_TRUE(SpinUntil([&] { return driver.getNumSubscribers() > 0; }));
  return driver;
}

TEST(EventSource, LosesNothingOfADriverThatComesLaterAndCopiesItsFirstMessageOnly) {
  std::vector<EventMessage> received;
  const EventSource source(ros::NodeHandle(), "/later_driver", 10,
                           [&](EventMessage message) { received.push_back(std::move(message)); });
  const ros::Publisher driver = DriverWithSubscriber<EventArray>("/later_driver");
  std::vector<boost::shared_ptr<EventArray>> sent;
  for (std::size_t i = 0; i < 3; ++i) {
    sent.push_back(boost::make_shared<EventArray>());
    sent.back()->events.resize(5 + i);
    driver.publish(ConstPtr<EventArray>(sent.back()));
    ASSERT_TRUE(SpinUntil([&] { return received.size() == i + 1; }, 1)) << i;
    EXPECT_EQ(received[i].num_events, 5 + i);
  }
  EXPECT_EQ(received[1].message.get(), sent[1].get());
  EXPECT_EQ(received[2].message.get(), sent[2].get());
}

TEST(EventSource, LeavesOutWhatIsNoEventsAndTakesEventsThatFollow) {
  std::vector<EventMessage> received;
  const EventSource source(ros::NodeHandle(), "/mixed", 10,
                           [&](EventMessage message) { received.push_back(std::move(message)); });
  ros::Publisher text = DriverWithSubscriber<std_msgs::String>("/mixed");
  text.publish(std_msgs::String());
  EXPECT_FALSE(SpinUntil([&] { return !received.empty(); }, 0.1));
  text.shutdown();
  const ros::Publisher driver = DriverWithSubscriber<EventArray>("/mixed");
  driver.publish(EventArray());
  EXPECT_TRUE(SpinUntil([&] { return received.size() == 1; }, 1));
}

/// Events of a bright dot that wanders over a 32x24 image, 10 ms each.
EventArrayPtr WanderingDot(int step) {
  auto message = boost::make_shared<EventArray>();
  message->width = 32;
  message->height = 24;
  for (int i = 0; i < 100; ++i) {
    RawEvent event;
    event.x = static_cast<std::uint16_t>((step + i / 10) % 32);
    event.y = static_cast<std::uint16_t>(i % 24);
    event.ts.fromNSec(static_cast<std::uint64_t>(1'000'000'000 + 10'000'000LL * step + 100'000LL * i));
    event.polarity = 1;
    message->events.push_back(event);
  }
  message->header.stamp = message->events.back().ts;
  return message;
}

TEST(ZeroCopy, TheNodeletsSurfaceReachesTwoReceiversAsOneObject) {
  ros::NodeHandle nh;
  ros::param::set("/zero_copy_surface/config", ros::param::param<std::string>("~config", ""));
  nodelet::Loader loader(false);
  ASSERT_TRUE(loader.load("/zero_copy_surface", "devo/TimeSurface", {}, {}));
  ConstPtr<Surface> first, second;
  const ros::Subscriber a = nh.subscribe<Surface>(topics::kSurface, 10, StoreIn<Surface>(&first));
  ros::NodeHandle other("/");
  const ros::Subscriber b =
      other.subscribe<Surface>("/" + std::string(topics::kSurface), 10, StoreIn<Surface>(&second));
  ros::Publisher events = nh.advertise<EventArray>("/events", 10);
  ASSERT_TRUE(SpinUntil([&] { return events.getNumSubscribers() > 0 && a.getNumPublishers() > 0; }));
  std::set<const Surface*> seen;
  std::vector<ConstPtr<Surface>> kept;  // so that no address comes twice
  for (int step = 0; step < 50 && seen.size() < 5; ++step) {
    events.publish(WanderingDot(step));
    const ConstPtr<Surface> before = first;
    if (!SpinUntil([&] { return first != before; }, 0.3)) continue;
    ASSERT_TRUE(SpinUntil([&] { return second == first; }));
    kept.push_back(first);
    seen.insert(first.get());
  }
  EXPECT_GE(seen.size(), 5U);
  loader.clear();
}

}  // namespace
}  // namespace devo

int main(int argc, char** argv) {
  testing::InitGoogleTest(&argc, argv);
  ros::init(argc, argv, "zero_copy_test");
  const ros::NodeHandle keep_running;
  return RUN_ALL_TESTS();
}
