// SPDX-License-Identifier: BSD-3-Clause
#include "devo/ros/lz4_frame.h"

#include <lz4frame.h>

#include <algorithm>
#include <random>
#include <string>
#include <vector>

#include <gtest/gtest.h>

namespace devo {
namespace {

using Bytes = std::vector<std::uint8_t>;

/// Half noise, half repetitions of what was up to 60 kB before.
Bytes Content(std::size_t size) {
  std::mt19937 random(static_cast<unsigned>(size));
  Bytes bytes;
  while (bytes.size() < size) {
    const std::size_t run = 1 + random() % 500;
    const bool repeat = !bytes.empty() && random() % 2 == 0;
    const std::size_t back = repeat ? 1 + random() % std::min<std::size_t>(bytes.size(), 60000) : 0;
    for (std::size_t k = 0; k < run; ++k) {
      bytes.push_back(repeat ? bytes[bytes.size() - back] : static_cast<std::uint8_t>(random()));
    }
  }
  bytes.resize(size);
  return bytes;
}

Bytes Framed(const Bytes& content, const LZ4F_preferences_t& preferences) {
  Bytes frame(LZ4F_compressFrameBound(content.size(), &preferences));
  const std::size_t size = LZ4F_compressFrame(frame.data(), frame.size(), content.data(), content.size(), &preferences);
  EXPECT_FALSE(LZ4F_isError(size));
  frame.resize(size);
  return frame;
}

LZ4F_preferences_t WithChecksum() {
  LZ4F_preferences_t preferences{};
  preferences.frameInfo.contentChecksumFlag = LZ4F_contentChecksumEnabled;
  return preferences;
}

TEST(Lz4Frame, IsReadAsTheLibraryWroteItWhateverItsFlags) {
  for (const std::size_t size : {0, 1, 15, 16, 31, 1000, 70000, 300000}) {
    const Bytes content = Content(size);
    for (int flags = 0; flags < 16; ++flags) {
      LZ4F_preferences_t preferences{};
      preferences.frameInfo.blockMode = (flags & 1) != 0 ? LZ4F_blockLinked : LZ4F_blockIndependent;
      preferences.frameInfo.contentChecksumFlag =
          (flags & 2) != 0 ? LZ4F_contentChecksumEnabled : LZ4F_noContentChecksum;
      preferences.frameInfo.blockChecksumFlag = (flags & 4) != 0 ? LZ4F_blockChecksumEnabled : LZ4F_noBlockChecksum;
      preferences.frameInfo.contentSize = (flags & 8) != 0 ? size : 0;
      const Bytes frame = Framed(content, preferences);
      Bytes data(size);
      EXPECT_TRUE(DecompressLz4Frame(frame.data(), frame.size(), data.data(), size)) << size << " bytes, " << flags;
      EXPECT_EQ(data, content) << size << " bytes, flags " << flags;
    }
  }
}

TEST(Lz4Frame, OfAnotherSizeOrCutShortIsRefused) {
  const Bytes content = Content(5000), frame = Framed(content, WithChecksum());
  Bytes data(6000);
  EXPECT_FALSE(DecompressLz4Frame(frame.data(), frame.size(), data.data(), 4999));
  EXPECT_FALSE(DecompressLz4Frame(frame.data(), frame.size(), data.data(), 5001));
  for (std::size_t size = 0; size < frame.size(); ++size) {
    EXPECT_FALSE(DecompressLz4Frame(Bytes(frame.begin(), frame.begin() + size).data(), size, data.data(), 5000))
        << size << " of " << frame.size();
  }
}

TEST(Lz4Frame, WithAnyBitFlippedIsRefusedUnlessItsContentIsTheSame) {
  const Bytes content = Content(2000);
  const Bytes frame = Framed(content, WithChecksum());
  Bytes data(content.size());
  double refused = 0;
  for (std::size_t bit = 0; bit < 8 * frame.size(); ++bit) {
    Bytes damaged = frame;
    damaged[bit / 8] ^= static_cast<std::uint8_t>(1 << bit % 8);
    const bool taken = DecompressLz4Frame(damaged.data(), damaged.size(), data.data(), data.size());
    refused += taken ? 0 : 1;
    // A repetition may be copied from another place that is the same.
    EXPECT_TRUE(!taken || data == content) << "bit " << bit;
  }
  EXPECT_GT(refused, 7.8 * static_cast<double>(frame.size()));
}

TEST(Xxh32, GivesTheSpecificationsValues) {
  const auto of = [](const std::string& text) {
    return Xxh32(reinterpret_cast<const std::uint8_t*>(text.data()), text.size());
  };
  EXPECT_EQ(of(""), 0x02CC5D05U);
  EXPECT_EQ(of("a"), 0x550D7456U);
  EXPECT_EQ(of("abc"), 0x32D153FFU);
  EXPECT_EQ(of("Nobody inspects the spammish repetition"), 0xE2293B2FU);
}

}  // namespace
}  // namespace devo
