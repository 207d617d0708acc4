// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "devo/core/event.h"

namespace devo {

/// Decodes the raw words of Prophesee sensors, EVT 3.0 and EVT 2.0, as event_camera_msgs/EventPacket carries them
/// (docs.prophesee.ai, "Data encoding formats"). Keeps its state from packet to packet: a row, a time or a vector may
/// begin in one and go on in the next.
class EvtDecoder {
 public:
  /// `encoding`: "evt3" or "evt2". Throws std::invalid_argument naming any other.
  explicit EvtDecoder(const std::string& encoding);

  /// Appends the events of `size` bytes (little-endian words) to `events`. Event::t_ns is the sensor's time; it goes on
  /// over the wraps of the sensor's counter (16.8 s with EVT3, 4.8 h with EVT2). Words before the first complete time
  /// are skipped, as are kinds of words that carry no event; bytes of an incomplete last word are dropped.
  void Decode(const std::uint8_t* bytes, std::size_t size, std::vector<Event>* events);

  /// Words are missing before the next ones: events are skipped again up to the next complete time and row. How often
  /// the counter has wrapped meanwhile is not known.
  void NoteLoss() { has_time_high_ = has_time_ = has_row_ = false; }

  const std::string& encoding() const { return encoding_; }
  /// The sensor's counter begins anew after so long: what wraps in longer gaps between words, they do not tell.
  std::int64_t wrap_ns() const;
  std::uint64_t triggers() const { return triggers_; }            ///< external trigger words so far
  std::uint64_t skipped_words() const { return skipped_words_; }  ///< words with events before a time or row is known

 private:
  void DecodeEvt3(std::uint16_t word, std::vector<Event>* events);
  void DecodeEvt2(std::uint32_t word, std::vector<Event>* events);
  /// Sets the time's upper part, `bits` wide, which counts units of 2^shift microseconds, and follows its wraps.
  void SetTimeHigh(std::uint64_t high, int bits, int shift);
  void Vector(std::uint32_t valid, int width, std::vector<Event>* events);

  std::string encoding_;
  bool evt3_;
  bool has_time_high_ = false, has_time_ = false, has_row_ = false;
  std::uint64_t time_high_ = 0;     ///< as last read
  std::uint64_t time_base_us_ = 0;  ///< wraps and time_high_, microseconds
  std::uint64_t wraps_us_ = 0;
  std::uint64_t time_us_ = 0;
  std::uint16_t row_ = 0, vector_x_ = 0;
  std::uint8_t vector_polarity_ = 0;
  std::uint64_t triggers_ = 0, skipped_words_ = 0;
};

}  // namespace devo
