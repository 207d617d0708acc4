// SPDX-License-Identifier: BSD-3-Clause
//
// Random access to the messages of a ROS bag (format 2.0), whole or broken. rosbag::Bag opens neither a bag whose
// recorder was killed (no index) nor one whose end is missing; here the index is made from the chunks themselves, and
// whatever is readable is there.
#pragma once

#include <cstddef>
#include <cstdint>
#include <fstream>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace devo {

/// A topic as one bag knows it; a topic recorded from several publishers is one of these.
struct BagTopic {
  std::string name, type, md5;
};

/// Where a message lies.
struct BagEntry {
  std::int64_t t_ns = 0;    ///< time of recording
  std::uint32_t topic = 0;  ///< index into topics()
  std::uint32_t chunk = 0;
  std::uint32_t offset = 0;  ///< of the message's record in its chunk
};

struct ByteSpan {
  const std::uint8_t* data = nullptr;
  std::size_t size = 0;
};

/// The decompressed chunks that were read last, of all bags that are read together: each with a cache of its own, a
/// recording in many bags would fill the memory. Not thread-safe.
class ChunkCache {
 public:
  /// Null where it is not there.
  const std::vector<std::uint8_t>* Find(const void* bag, std::uint32_t chunk);
  /// Memory for a chunk of so many bytes, of one that had to go for it.
  std::vector<std::uint8_t> MakeRoom(std::size_t bytes);
  /// Valid until the next call.
  const std::vector<std::uint8_t>& Add(const void* bag, std::uint32_t chunk, std::vector<std::uint8_t> data);
  /// Room for a chunk as it is in the file.
  std::vector<std::uint8_t>& stored() { return stored_; }

 private:
  struct Entry {
    const void* bag = nullptr;
    std::uint32_t chunk = 0;
    std::uint64_t last_use = 0;
    std::vector<std::uint8_t> data;
  };

  std::vector<Entry> entries_;
  std::vector<std::uint8_t> stored_;
  std::uint64_t uses_ = 0;
};

class BagFile {
 public:
  /// Reads the index. Throws std::runtime_error naming the file when it is missing or no bag of format 2.0.
  explicit BagFile(const std::string& path, std::shared_ptr<ChunkCache> cache = std::make_shared<ChunkCache>());

  const std::string& path() const { return path_; }
  const std::vector<BagTopic>& topics() const { return topics_; }
  /// In the order of their recording.
  const std::vector<BagEntry>& entries() const { return entries_; }
  /// What is wrong with the file ("ends early at byte 1234 of ..."), empty when it is whole. Reading a chunk that turns
  /// out to be damaged adds to it.
  const std::string& defect() const { return defect_; }

  /// The serialised message; valid until the next call for any bag of the same cache. Empty (data == nullptr) when its
  /// chunk is damaged.
  ByteSpan Read(const BagEntry& entry);

 private:
  struct Chunk {
    std::uint64_t position = 0;  // of the compressed data in the file
    std::uint32_t stored_size = 0, size = 0;
    std::string compression;
    bool indexed = false;
  };
  struct Record;

  void Scan();
  /// Where the next record of a chunk begins after one that cannot be read.
  std::optional<std::uint64_t> FindChunkAfter(std::uint64_t position);
  void AddChunk(const Record& record);
  void AddIndex(const Record& record);
  void AddConnection(const Record& record);
  void IndexChunksWithoutIndex();
  void FindMissingConnections();
  void MapEntriesToTopics();
  bool ReadRecord(std::uint64_t position, Record* record);
  /// Empty where it is damaged.
  const std::vector<std::uint8_t>& LoadChunk(std::uint32_t chunk);
  template <typename Visit>
  void VisitChunk(std::uint32_t chunk, Visit&& visit);
  void AddDefect(const std::string& what);

  std::string path_;
  std::ifstream file_;
  std::uint64_t file_size_ = 0;
  std::string defect_;
  std::vector<Chunk> chunks_;
  std::map<std::uint32_t, BagTopic> connections_;  // by the id in the file
  std::vector<BagTopic> topics_;
  std::vector<BagEntry> entries_;  // topic: connection id until MapEntriesToTopics
  std::shared_ptr<ChunkCache> cache_;
};

/// The bags of one recording. Throws std::runtime_error naming the one that cannot be opened, or is given twice: all in
/// it would count twice.
std::vector<std::unique_ptr<BagFile>> OpenBags(const std::vector<std::string>& paths);

}  // namespace devo
