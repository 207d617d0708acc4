// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <exception>
#include <ostream>
#include <string>
#include <utility>

#include <gmock/gmock.h>

namespace devo {

/// ::testing::ThrowsMessage of newer GoogleMocks than Ubuntu 20.04's.
template <typename Exception>
class ThrowsMessageMatcher {
 public:
  explicit ThrowsMessageMatcher(::testing::Matcher<const std::string&> message) : message_(std::move(message)) {}

  template <typename Function>
  bool MatchAndExplain(const Function& function, ::testing::MatchResultListener* listener) const {
    try {
      function();
    } catch (const Exception& e) {
      *listener << "which throws \"" << e.what() << "\"";
      return message_.Matches(e.what());
    } catch (const std::exception& e) {
      *listener << "which throws an exception of another type: " << e.what();
      return false;
    }
    *listener << "which does not throw";
    return false;
  }
  void DescribeTo(std::ostream* out) const {
    *out << "throws the exception with a message that ";
    message_.DescribeTo(out);
  }
  void DescribeNegationTo(std::ostream* out) const {
    *out << "does not throw the exception with a message that ";
    message_.DescribeTo(out);
  }

 private:
  ::testing::Matcher<const std::string&> message_;
};

template <typename Exception, typename MessageMatcher>
::testing::PolymorphicMatcher<ThrowsMessageMatcher<Exception>> ThrowsMessage(const MessageMatcher& message) {
  return ::testing::MakePolymorphicMatcher(
      ThrowsMessageMatcher<Exception>(::testing::SafeMatcherCast<const std::string&>(message)));
}

}  // namespace devo
