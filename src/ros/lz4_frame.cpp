// SPDX-License-Identifier: BSD-3-Clause
//
// Why not LZ4F_decompress or roslz4: as they are packaged, two thirds of their time go into a checksum that can be had
// in a fifth of that. The blocks are left to liblz4.
#include "devo/ros/lz4_frame.h"

#include <lz4.h>

#include <algorithm>
#include <cstring>

#include <boost/endian/conversion.hpp>

namespace devo {
namespace {

constexpr std::uint32_t kPrime1 = 0x9E3779B1, kPrime2 = 0x85EBCA77, kPrime3 = 0xC2B2AE3D, kPrime4 = 0x27D4EB2F,
                        kPrime5 = 0x165667B1;
constexpr std::uint32_t kMagic = 0x184D2204, kUncompressed = 0x80000000;
constexpr std::size_t kDictionary = 65536;  // what blocks that are not independent look back to

std::uint32_t Word(const std::uint8_t* bytes) {
  std::uint32_t value;
  std::memcpy(&value, bytes, sizeof(value));
  return boost::endian::little_to_native(value);
}

std::uint32_t Rotated(std::uint32_t value, int bits) { return value << bits | value >> (32 - bits); }

/// A lane's sum after one more word. Four lanes in one vector register would be slower: processors multiply 32-bit
/// words singly in three cycles, together in ten.
inline std::uint32_t Round(std::uint32_t lane, const std::uint8_t* bytes) {
  lane = Rotated(lane + Word(bytes) * kPrime2, 13) * kPrime1;
#ifdef __GNUC__
  __asm__("" : "+r"(lane));  // keeps the compiler from joining them
#endif
  return lane;
}

/// Reads a frame from its begin to its end; every Take fails once the bytes are too few.
class Cursor {
 public:
  Cursor(const std::uint8_t* bytes, std::size_t size) : bytes_(bytes), left_(size) {}
  const std::uint8_t* Take(std::size_t size) {
    if (size > left_) return nullptr;
    const std::uint8_t* taken = bytes_;
    bytes_ += size;
    left_ -= size;
    return taken;
  }
  bool TakeWord(std::uint32_t* word) {
    const std::uint8_t* bytes = Take(4);
    if (bytes != nullptr) *word = Word(bytes);
    return bytes != nullptr;
  }

 private:
  const std::uint8_t* bytes_;
  std::size_t left_;
};

struct Descriptor {
  bool block_checksum, content_checksum;
};

bool ReadDescriptor(Cursor* cursor, Descriptor* descriptor) {
  std::uint32_t magic = 0;
  if (!cursor->TakeWord(&magic) || magic != kMagic) return false;
  const std::uint8_t* begin = cursor->Take(2);
  if (begin == nullptr) return false;
  const int flags = begin[0];
  const bool content_size = (flags & 0x08) != 0, dictionary = (flags & 0x01) != 0;
  if (flags >> 6 != 1 || dictionary) return false;
  const std::size_t optional = content_size ? 8 : 0;
  if (cursor->Take(optional) == nullptr) return false;
  const std::uint8_t* checksum = cursor->Take(1);
  descriptor->block_checksum = (flags & 0x10) != 0;
  descriptor->content_checksum = (flags & 0x04) != 0;
  return checksum != nullptr && *checksum == (Xxh32(begin, 2 + optional) >> 8 & 0xFF);
}

}  // namespace

std::uint32_t Xxh32(const std::uint8_t* bytes, std::size_t size) {
  const std::uint8_t *next = bytes, *end = bytes + size;
  std::uint32_t sum = kPrime5;
  if (size >= 16) {
    std::uint32_t a = kPrime1 + kPrime2, b = kPrime2, c = 0, d = 0 - kPrime1;
    for (; end - next >= 16; next += 16) {
      a = Round(a, next);
      b = Round(b, next + 4);
      c = Round(c, next + 8);
      d = Round(d, next + 12);
    }
    sum = Rotated(a, 1) + Rotated(b, 7) + Rotated(c, 12) + Rotated(d, 18);
  }
  sum += static_cast<std::uint32_t>(size);
  for (; end - next >= 4; next += 4) sum = Rotated(sum + Word(next) * kPrime3, 17) * kPrime4;
  for (; next != end; ++next) sum = Rotated(sum + *next * kPrime5, 11) * kPrime1;
  sum = (sum ^ sum >> 15) * kPrime2;
  sum = (sum ^ sum >> 13) * kPrime3;
  return sum ^ sum >> 16;
}

bool DecompressLz4Frame(const std::uint8_t* frame, std::size_t frame_size, std::uint8_t* data, std::size_t data_size) {
  Cursor cursor(frame, frame_size);
  Descriptor descriptor{};
  if (!ReadDescriptor(&cursor, &descriptor)) return false;
  std::size_t written = 0;
  for (;;) {
    std::uint32_t word = 0, checksum = 0;
    if (!cursor.TakeWord(&word)) return false;
    if (word == 0) break;
    const std::size_t size = word & ~kUncompressed;
    const std::uint8_t* block = cursor.Take(size);
    if (block == nullptr) return false;
    if (descriptor.block_checksum && !(cursor.TakeWord(&checksum) && checksum == Xxh32(block, size))) return false;
    const std::size_t room = std::min<std::size_t>(data_size - written, LZ4_MAX_INPUT_SIZE);
    if ((word & kUncompressed) != 0) {
      if (size > room) return false;
      std::memcpy(data + written, block, size);
      written += size;
      continue;
    }
    const std::size_t before = std::min(written, kDictionary);
    const int made = LZ4_decompress_safe_usingDict(
        reinterpret_cast<const char*>(block), reinterpret_cast<char*>(data + written), static_cast<int>(size),
        static_cast<int>(room), reinterpret_cast<const char*>(data + written - before), static_cast<int>(before));
    if (made < 0) return false;
    written += static_cast<std::size_t>(made);
  }
  std::uint32_t checksum = 0;
  if (descriptor.content_checksum && !(cursor.TakeWord(&checksum) && checksum == Xxh32(data, written))) return false;
  return written == data_size;
}

}  // namespace devo
