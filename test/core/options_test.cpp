// SPDX-License-Identifier: BSD-3-Clause
#include "devo/core/options.h"

#include <limits>
#include <set>
#include <stdexcept>
#include <string>
#include <type_traits>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace devo {
namespace {

std::string MessageOfValidate(const OdometryOptions& options) {
  try {
    Validate(options);
  } catch (const std::invalid_argument& error) {
    return error.what();
  }
  return "accepted";
}

/// Sets the option of one key to a value outside its range: below the minimum or above the maximum.
struct Spoil {
  std::string key;
  bool above;
  bool found = false;

  template <typename Number>
  void operator()(const char* k, Number& value, Number min, Number max, const char*) {
    if (k != key) return;
    found = true;
    if constexpr (std::is_same<Number, double>::value) {
      value = above ? max * 1.01 + 1 : min - 1;
    } else {
      value = above ? max + 1 : min - 1;
    }
  }
  void operator()(const char*, bool&, const char*) {}  // has no value out of range
  void operator()(const char* k, std::string& value, const char*, const char*) {
    if (k != key) return;
    found = true;
    value = above ? "no_such_choice" : "";
  }
};

struct CollectKeys {
  std::vector<std::string> keys;
  std::vector<std::string> meanings;
  template <typename... Rest>
  void operator()(const char* key, const Rest&... rest) {
    keys.emplace_back(key);
    const char* last = nullptr;
    ((last = LastText(rest)), ...);
    meanings.emplace_back(last ? last : "");
  }
  static const char* LastText(const char* text) { return text; }
  template <typename Other>
  static const char* LastText(const Other&) {
    return nullptr;
  }
};

CollectKeys AllKeys() {
  CollectKeys collect;
  const OdometryOptions options;
  VisitOptions(options, collect);
  return collect;
}

TEST(OptionsTest, TheDefaultsAreValid) { EXPECT_EQ(MessageOfValidate(OdometryOptions()), "accepted"); }

TEST(OptionsTest, EveryOptionHasAKeyOfItsOwnAndAMeaning) {
  const CollectKeys all = AllKeys();
  EXPECT_GE(all.keys.size(), 20U);
  EXPECT_EQ(std::set<std::string>(all.keys.begin(), all.keys.end()).size(), all.keys.size());
  EXPECT_THAT(all.keys, testing::Each(testing::HasSubstr(".")));
  EXPECT_THAT(all.meanings, testing::Each(testing::Not(testing::IsEmpty())));
}

TEST(OptionsTest, AValueOutsideItsRangeIsRejectedWithItsKeyNamedForEveryOption) {
  int spoilt = 0;
  for (const std::string& key : AllKeys().keys) {
    for (const bool above : {false, true}) {
      OdometryOptions options;
      Spoil spoil{key, above};
      VisitOptions(options, spoil);
      if (!spoil.found) continue;
      ++spoilt;
      EXPECT_THAT(MessageOfValidate(options), testing::HasSubstr(key)) << (above ? "above" : "below");
    }
  }
  EXPECT_GE(spoilt, 40);
}

TEST(OptionsTest, TheMessageNamesValueAndRange) {
  OdometryOptions options;
  options.surface.rate_hz = 0.5;
  EXPECT_EQ(MessageOfValidate(options), "surface.rate_hz is 0.5, expected a number from 1 to 1000");
}

TEST(OptionsTest, TheMessageNamesTheChoices) {
  OdometryOptions options;
  options.surface.method = "linear";
  EXPECT_THAT(MessageOfValidate(options), testing::AllOf(testing::HasSubstr("surface.method is \"linear\""),
                                                         testing::HasSubstr("motion_compensated or exponential")));
}

TEST(OptionsTest, AChoiceThatIsPartOfAValidOneIsRejected) {
  OdometryOptions options;
  options.surface.method = "motion_compensated|exponential";
  EXPECT_NE(MessageOfValidate(options), "accepted");
  options.surface.method = "exponential";
  EXPECT_EQ(MessageOfValidate(options), "accepted");
}

TEST(OptionsTest, NotANumberIsRejected) {
  OdometryOptions options;
  options.tracking.huber_share = std::numeric_limits<double>::quiet_NaN();
  EXPECT_THAT(MessageOfValidate(options), testing::HasSubstr("tracking.huber_share is nan"));
}

TEST(OptionsTest, ADepthRangeThatIsEmptyIsRejected) {
  OdometryOptions options;
  options.mapping.min_depth_m = 5;
  options.mapping.max_depth_m = 4;
  EXPECT_THAT(MessageOfValidate(options), testing::AllOf(testing::HasSubstr("mapping.min_depth_m is 5"),
                                                         testing::HasSubstr("mapping.max_depth_m which is 4")));
}

}  // namespace
}  // namespace devo
