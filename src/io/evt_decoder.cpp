// SPDX-License-Identifier: BSD-3-Clause
#include "devo/io/evt_decoder.h"

#include <stdexcept>

namespace devo {
namespace {

/// Kinds of EVT 3.0 words, bits 15..12.
enum Evt3 : std::uint16_t {
  kAddressY = 0x0,
  kAddressX = 0x2,
  kVectorBaseX = 0x3,
  kVector12 = 0x4,
  kVector8 = 0x5,
  kTimeLow = 0x6,
  kTimeHigh = 0x8,
  kTrigger = 0xA,
};

/// Kinds of EVT 2.0 words, bits 31..28.
enum Evt2 : std::uint32_t { kOff2 = 0x0, kOn2 = 0x1, kTimeHigh2 = 0x8, kTrigger2 = 0xA };

constexpr int kEvt3TimeBits = 12, kEvt3TimeShift = 12;
constexpr int kEvt2TimeBits = 28, kEvt2TimeShift = 6;

Event MakeEvent(std::uint64_t time_us, std::uint16_t x, std::uint16_t y, std::uint8_t polarity) {
  Event event;
  event.t_ns = static_cast<std::int64_t>(time_us) * 1000;
  event.x = x;
  event.y = y;
  event.polarity = polarity;
  return event;
}

}  // namespace

EvtDecoder::EvtDecoder(const std::string& encoding) : encoding_(encoding), evt3_(encoding == "evt3") {
  if (encoding != "evt3" && encoding != "evt2") {
    throw std::invalid_argument("event encoding '" + encoding + "' is not known, expected evt3 or evt2");
  }
}

void EvtDecoder::Decode(const std::uint8_t* bytes, std::size_t size, std::vector<Event>* events) {
  if (evt3_) {
    for (std::size_t i = 0; i + 2 <= size; i += 2) {
      DecodeEvt3(static_cast<std::uint16_t>(bytes[i] | bytes[i + 1] << 8), events);
    }
  } else {
    for (std::size_t i = 0; i + 4 <= size; i += 4) {
      DecodeEvt2(static_cast<std::uint32_t>(bytes[i]) | static_cast<std::uint32_t>(bytes[i + 1]) << 8 |
                     static_cast<std::uint32_t>(bytes[i + 2]) << 16 | static_cast<std::uint32_t>(bytes[i + 3]) << 24,
                 events);
    }
  }
}

std::int64_t EvtDecoder::wrap_ns() const {
  return 1000 * (std::int64_t{1} << (evt3_ ? kEvt3TimeBits + kEvt3TimeShift : kEvt2TimeBits + kEvt2TimeShift));
}

void EvtDecoder::SetTimeHigh(std::uint64_t high, int bits, int shift) {
  // A counter that falls by more than half its range has wrapped; a smaller fall is a repeated or late word.
  if (has_time_high_ && high < time_high_ && time_high_ - high > (1ULL << (bits - 1))) {
    wraps_us_ += 1ULL << (bits + shift);
  }
  has_time_high_ = true;
  time_high_ = high;
  time_base_us_ = wraps_us_ + (high << shift);
}

void EvtDecoder::Vector(std::uint32_t valid, int width, std::vector<Event>* events) {
  if (has_time_ && has_row_) {
    for (int i = 0; i < width; ++i) {
      if (valid >> i & 1U) {
        events->push_back(MakeEvent(time_us_, static_cast<std::uint16_t>(vector_x_ + i), row_, vector_polarity_));
      }
    }
  } else {
    ++skipped_words_;
  }
  vector_x_ = static_cast<std::uint16_t>(vector_x_ + width);
}

void EvtDecoder::DecodeEvt3(std::uint16_t word, std::vector<Event>* events) {
  const std::uint16_t address = word & 0x7FF;
  const auto polarity = static_cast<std::uint8_t>(word >> 11 & 1U);
  switch (word >> 12) {
    case kAddressX:
      if (has_time_ && has_row_) {
        events->push_back(MakeEvent(time_us_, address, row_, polarity));
      } else {
        ++skipped_words_;
      }
      break;
    case kAddressY:
      row_ = address;
      has_row_ = true;
      break;
    case kVectorBaseX:
      vector_x_ = address;
      vector_polarity_ = polarity;
      break;
    case kVector12: Vector(word & 0xFFF, 12, events); break;
    case kVector8: Vector(word & 0xFF, 8, events); break;
    case kTimeLow:
      if (has_time_high_) {
        time_us_ = time_base_us_ + (word & 0xFFF);
        has_time_ = true;
      }
      break;
    case kTimeHigh: {
      const std::uint64_t previous_base_us = time_base_us_;
      SetTimeHigh(word & 0xFFF, kEvt3TimeBits, kEvt3TimeShift);
      // The low part starts anew with the high one, and the next low word may come only after some events.
      if (time_base_us_ != previous_base_us) time_us_ = time_base_us_;
      break;
    }
    case kTrigger: ++triggers_; break;
    default: break;  // others, continued and monitoring words carry no event
  }
}

void EvtDecoder::DecodeEvt2(std::uint32_t word, std::vector<Event>* events) {
  const std::uint32_t kind = word >> 28;
  if (kind == kTimeHigh2) {
    SetTimeHigh(word & 0xFFFFFFF, kEvt2TimeBits, kEvt2TimeShift);
    has_time_ = true;
  } else if (kind == kOff2 || kind == kOn2) {
    if (!has_time_) {
      ++skipped_words_;
      return;
    }
    events->push_back(MakeEvent(time_base_us_ + (word >> 22 & 0x3F), static_cast<std::uint16_t>(word >> 11 & 0x7FF),
                                static_cast<std::uint16_t>(word & 0x7FF), static_cast<std::uint8_t>(kind)));
  } else if (kind == kTrigger2) {
    ++triggers_;
  }
}

}  // namespace devo
