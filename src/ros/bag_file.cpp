// SPDX-License-Identifier: BSD-3-Clause
//
// The format: wiki.ros.org/Bags/Format/2.0. All numbers are little-endian.
#include "devo/ros/bag_file.h"

#include <algorithm>
#include <cstring>
#include <filesystem>
#include <limits>
#include <optional>
#include <set>
#include <stdexcept>

#include <rosbag/stream.h>
#include <boost/endian/conversion.hpp>

#include "devo/ros/lz4_frame.h"

namespace devo {
namespace {

constexpr char kMagic[] = "#ROSBAG V2.0\n";
constexpr std::uint32_t kMaxHeaderSize = 1 << 24;  // message definitions stand in headers' data, not here
enum Op : std::uint8_t {
  kMessage = 0x02,
  kBagHeader = 0x03,
  kIndex = 0x04,
  kChunk = 0x05,
  kChunkInfo = 0x06,
  kConnection = 0x07
};

// Messages of topics that lag behind each other lie some chunks apart; without a cache each step from one topic to the
// other would decompress a chunk.
constexpr std::size_t kCacheBytes = std::size_t{48} << 20;
constexpr std::size_t kMinCachedChunks = 2;

template <typename T>
T Number(const std::uint8_t* bytes) {
  T value;
  std::memcpy(&value, bytes, sizeof(T));
  return boost::endian::little_to_native(value);
}

std::int64_t TimeNs(const std::uint8_t* bytes) {
  return std::int64_t{1000000000} * Number<std::uint32_t>(bytes) + Number<std::uint32_t>(bytes + 4);
}

/// `name=value` fields of a record's header.
class Fields {
 public:
  bool Parse(const std::uint8_t* bytes, std::size_t size) {
    fields_.clear();
    while (size >= 4) {
      const auto length = Number<std::uint32_t>(bytes);
      if (length > size - 4) return false;
      const std::string field(reinterpret_cast<const char*>(bytes + 4), length);
      const std::size_t equals = field.find('=');
      if (equals == std::string::npos) return false;
      fields_[field.substr(0, equals)] = field.substr(equals + 1);
      bytes += 4 + length;
      size -= 4 + length;
    }
    return size == 0;
  }
  bool Has(const std::string& name, std::size_t size) const {
    const auto found = fields_.find(name);
    return found != fields_.end() && found->second.size() >= size;
  }
  const std::uint8_t* Bytes(const std::string& name) const {
    return reinterpret_cast<const std::uint8_t*>(fields_.at(name).data());
  }
  std::uint32_t Uint32(const std::string& name) const { return Has(name, 4) ? Number<std::uint32_t>(Bytes(name)) : 0; }
  std::string Text(const std::string& name) const { return Has(name, 0) ? fields_.at(name) : ""; }
  std::uint8_t op() const { return Has("op", 1) ? *Bytes("op") : 0; }

 private:
  std::map<std::string, std::string> fields_;
};

bool DecompressBz2(std::vector<std::uint8_t>* stored, std::vector<std::uint8_t>* data) {
  try {
    rosbag::BZ2Stream(nullptr).decompress(data->data(), static_cast<unsigned>(data->size()), stored->data(),
                                          static_cast<unsigned>(stored->size()));
  } catch (const std::exception&) {
    return false;
  }
  return true;
}

bool Decompress(const std::string& compression, std::vector<std::uint8_t>* stored, std::vector<std::uint8_t>* data) {
  if (compression == "lz4") return DecompressLz4Frame(stored->data(), stored->size(), data->data(), data->size());
  return compression == "bz2" && DecompressBz2(stored, data);
}

}  // namespace

struct BagFile::Record {
  Fields fields;
  std::uint64_t data_position = 0;
  std::uint64_t data_size = 0;
};

BagFile::BagFile(const std::string& path, std::shared_ptr<ChunkCache> cache)
    : path_(path), file_(path, std::ios::binary), cache_(std::move(cache)) {
  if (!file_) throw std::runtime_error("bag '" + path + "': cannot be opened, expected a ROS bag");
  file_.seekg(0, std::ios::end);
  const std::streamoff size = file_.tellg();
  file_size_ = size > 0 ? static_cast<std::uint64_t>(size) : 0;
  char magic[sizeof(kMagic) - 1] = {};
  file_.seekg(0);
  file_.read(magic, sizeof(magic));
  if (!file_ || std::memcmp(magic, kMagic, sizeof(magic)) != 0) {
    throw std::runtime_error("bag '" + path +
                             "': does not begin with '#ROSBAG V2.0', expected a ROS bag of format 2.0");
  }
  Scan();
  IndexChunksWithoutIndex();
  FindMissingConnections();
  MapEntriesToTopics();
}

void BagFile::AddDefect(const std::string& what) {
  if (defect_.empty()) defect_ = "bag '" + path_ + "': " + what;
}

bool BagFile::ReadRecord(std::uint64_t position, Record* record) {
  std::uint8_t length[4];
  file_.clear();
  file_.seekg(static_cast<std::streamoff>(position));
  if (!file_.read(reinterpret_cast<char*>(length), 4)) return false;
  const auto header_size = Number<std::uint32_t>(length);
  if (header_size > kMaxHeaderSize || position + 8 + header_size > file_size_) return false;
  std::vector<std::uint8_t> header(header_size);
  if (!file_.read(reinterpret_cast<char*>(header.data()), header_size)) return false;
  if (!file_.read(reinterpret_cast<char*>(length), 4)) return false;
  record->data_position = position + 8 + header_size;
  record->data_size = Number<std::uint32_t>(length);
  return record->fields.Parse(header.data(), header.size());
}

void BagFile::Scan() {
  Record record;
  std::uint64_t position = sizeof(kMagic) - 1;
  bool has_index = false;
  while (position < file_size_) {
    const bool readable = ReadRecord(position, &record);
    if (!readable) {
      if (const auto next = FindChunkAfter(position)) {
        AddDefect("is damaged at byte " + std::to_string(position) + " (what is readable is used)");
        position = *next;
        continue;
      }
    }
    const std::uint64_t end = readable ? record.data_position + record.data_size : file_size_ + 1;
    const std::uint8_t op = readable ? record.fields.op() : 0;
    if (op == kBagHeader)
      has_index = record.fields.Has("index_pos", 8) && Number<std::uint64_t>(record.fields.Bytes("index_pos")) > 0;
    if (op == kChunk) AddChunk(record);
    if (end > file_size_) {
      AddDefect("ends early, after " + std::to_string(file_size_) +
                " bytes; expected a whole bag (what is readable is used)");
      return;
    }
    if (op == kIndex) AddIndex(record);
    if (op == kConnection) AddConnection(record);
    position = end;
  }
  if (!has_index) AddDefect("was not closed by its recorder; expected a whole bag (what is readable is used)");
}

std::optional<std::uint64_t> BagFile::FindChunkAfter(std::uint64_t position) {
  // A chunk's header holds this field; the record begins somewhere in the bytes before it.
  const std::string field("\x04\0\0\0op=\x05", 8);
  constexpr std::size_t kStep = std::size_t{1} << 20, kLongestHeader = 128;
  std::vector<char> bytes(kStep + kLongestHeader);
  for (std::uint64_t from = position + 1; from < file_size_; from += kStep) {
    file_.clear();
    file_.seekg(static_cast<std::streamoff>(from));
    file_.read(bytes.data(), static_cast<std::streamsize>(bytes.size()));
    const auto end = bytes.begin() + file_.gcount();
    for (auto at = bytes.begin();; ++at) {
      at = std::search(at, end, field.begin(), field.end());
      if (at == end) break;
      const std::uint64_t found = from + static_cast<std::uint64_t>(at - bytes.begin());
      for (std::uint64_t begin = found - std::min<std::uint64_t>(found, kLongestHeader); begin <= found; ++begin) {
        Record record;
        if (begin > position && ReadRecord(begin, &record) && record.fields.op() == kChunk &&
            record.fields.Has("compression", 1)) {
          return begin;
        }
      }
    }
  }
  return std::nullopt;
}

void BagFile::AddChunk(const Record& record) {
  Chunk chunk;
  chunk.position = record.data_position;
  chunk.size = record.fields.Uint32("size");
  chunk.compression = record.fields.Text("compression");
  const std::uint64_t available = std::min(record.data_size, file_size_ - std::min(file_size_, record.data_position));
  if (available < record.data_size) {
    if (chunk.compression != "none") return;  // a broken block decompresses to nothing
    chunk.size = static_cast<std::uint32_t>(available);
  }
  chunk.stored_size = static_cast<std::uint32_t>(available);
  chunks_.push_back(chunk);
}

void BagFile::AddIndex(const Record& record) {
  if (chunks_.empty()) return;
  std::vector<std::uint8_t> data(record.data_size);
  file_.clear();
  file_.seekg(static_cast<std::streamoff>(record.data_position));
  if (!file_.read(reinterpret_cast<char*>(data.data()), static_cast<std::streamsize>(data.size()))) return;
  chunks_.back().indexed = true;
  BagEntry entry;
  entry.topic = record.fields.Uint32("conn");
  entry.chunk = static_cast<std::uint32_t>(chunks_.size() - 1);
  for (std::size_t i = 0; i + 12 <= data.size(); i += 12) {
    entry.t_ns = TimeNs(data.data() + i);
    entry.offset = Number<std::uint32_t>(data.data() + i + 8);
    entries_.push_back(entry);
  }
}

void BagFile::AddConnection(const Record& record) {
  std::vector<std::uint8_t> data(record.data_size);
  file_.clear();
  file_.seekg(static_cast<std::streamoff>(record.data_position));
  if (!file_.read(reinterpret_cast<char*>(data.data()), static_cast<std::streamsize>(data.size()))) return;
  Fields description;
  if (!description.Parse(data.data(), data.size())) return;
  connections_[record.fields.Uint32("conn")] = {record.fields.Text("topic"), description.Text("type"),
                                                description.Text("md5sum")};
}

const std::vector<std::uint8_t>* ChunkCache::Find(const void* bag, std::uint32_t chunk) {
  for (Entry& entry : entries_) {
    if (entry.bag != bag || entry.chunk != chunk) continue;
    entry.last_use = ++uses_;
    return &entry.data;
  }
  return nullptr;
}

std::vector<std::uint8_t> ChunkCache::MakeRoom(std::size_t bytes) {
  std::vector<std::uint8_t> left;
  for (const Entry& entry : entries_) bytes += entry.data.size();
  while (entries_.size() >= kMinCachedChunks && bytes > kCacheBytes) {
    const auto oldest = std::min_element(entries_.begin(), entries_.end(),
                                         [](const Entry& a, const Entry& b) { return a.last_use < b.last_use; });
    bytes -= oldest->data.size();
    left = std::move(oldest->data);
    entries_.erase(oldest);
  }
  return left;
}

const std::vector<std::uint8_t>& ChunkCache::Add(const void* bag, std::uint32_t chunk, std::vector<std::uint8_t> data) {
  entries_.push_back({bag, chunk, ++uses_, std::move(data)});
  return entries_.back().data;
}

const std::vector<std::uint8_t>& BagFile::LoadChunk(std::uint32_t index) {
  if (const auto* cached = cache_->Find(this, index)) return *cached;
  const Chunk& chunk = chunks_.at(index);
  std::vector<std::uint8_t> data = cache_->MakeRoom(chunk.size);
  const bool compressed = chunk.compression != "none";
  std::vector<std::uint8_t>& stored = compressed ? cache_->stored() : data;
  stored.resize(chunk.stored_size);
  file_.clear();
  file_.seekg(static_cast<std::streamoff>(chunk.position));
  bool good = static_cast<bool>(
      file_.read(reinterpret_cast<char*>(stored.data()), static_cast<std::streamsize>(stored.size())));
  if (compressed) {
    data.resize(chunk.size);
    good = good && Decompress(chunk.compression, &stored, &data);
  }
  if (!good) {
    AddDefect("a chunk of compression '" + chunk.compression + "' at byte " + std::to_string(chunk.position) +
              " is damaged, expected none, lz4 or bz2 (what is readable is used)");
    data.clear();
  }
  return cache_->Add(this, index, std::move(data));
}

/// Calls `visit(fields, data, size, offset)` for every whole record of a chunk.
template <typename Visit>
void BagFile::VisitChunk(std::uint32_t index, Visit&& visit) {
  const std::vector<std::uint8_t>& data = LoadChunk(index);
  Fields fields;
  for (std::size_t offset = 0; offset + 8 <= data.size();) {
    const std::size_t header_size = Number<std::uint32_t>(data.data() + offset);
    if (header_size + 8 > data.size() - offset || !fields.Parse(data.data() + offset + 4, header_size)) return;
    const std::size_t size = Number<std::uint32_t>(data.data() + offset + 4 + header_size);
    const std::size_t begin = offset + 8 + header_size;
    if (size > data.size() - begin) return;
    visit(fields, data.data() + begin, size, static_cast<std::uint32_t>(offset));
    offset = begin + size;
  }
}

void BagFile::IndexChunksWithoutIndex() {
  for (std::uint32_t c = 0; c < chunks_.size(); ++c) {
    if (chunks_[c].indexed) continue;
    VisitChunk(c, [&](const Fields& fields, const std::uint8_t*, std::size_t, std::uint32_t offset) {
      if (fields.op() != kMessage || !fields.Has("time", 8)) return;
      BagEntry entry;
      entry.t_ns = TimeNs(fields.Bytes("time"));
      entry.topic = fields.Uint32("conn");
      entry.chunk = c;
      entry.offset = offset;
      entries_.push_back(entry);
    });
  }
}

void BagFile::FindMissingConnections() {
  // A whole bag lists its connections at the end; in a broken one they stand in the chunks, before their first message.
  std::set<std::uint32_t> visited;
  for (const BagEntry& entry : entries_) {
    if (connections_.count(entry.topic) > 0 || !visited.insert(entry.chunk).second) continue;
    VisitChunk(entry.chunk, [&](const Fields& fields, const std::uint8_t* data, std::size_t size, std::uint32_t) {
      Fields description;
      if (fields.op() != kConnection || !description.Parse(data, size)) return;
      connections_[fields.Uint32("conn")] = {fields.Text("topic"), description.Text("type"),
                                             description.Text("md5sum")};
    });
  }
}

void BagFile::MapEntriesToTopics() {
  std::map<std::uint32_t, std::uint32_t> topic_of;
  for (const auto& connection : connections_) {
    const BagTopic& topic = connection.second;
    std::size_t i = 0;
    while (i < topics_.size() && (topics_[i].name != topic.name || topics_[i].md5 != topic.md5)) ++i;
    if (i == topics_.size()) topics_.push_back(topic);
    topic_of[connection.first] = static_cast<std::uint32_t>(i);
  }
  const auto unknown = [&](const BagEntry& entry) { return topic_of.count(entry.topic) == 0; };
  entries_.erase(std::remove_if(entries_.begin(), entries_.end(), unknown), entries_.end());
  for (BagEntry& entry : entries_) entry.topic = topic_of[entry.topic];
  std::stable_sort(entries_.begin(), entries_.end(),
                   [](const BagEntry& a, const BagEntry& b) { return a.t_ns < b.t_ns; });
}

ByteSpan BagFile::Read(const BagEntry& entry) {
  const std::vector<std::uint8_t>& data = LoadChunk(entry.chunk);
  const std::size_t offset = entry.offset;
  if (offset + 8 > data.size()) return {};
  const std::size_t header_size = Number<std::uint32_t>(data.data() + offset);
  if (header_size + 8 > data.size() - offset) return {};
  const std::size_t begin = offset + 8 + header_size;
  const std::size_t size = Number<std::uint32_t>(data.data() + begin - 4);
  if (size > data.size() - begin) return {};
  return {data.data() + begin, size};
}

std::vector<std::unique_ptr<BagFile>> OpenBags(const std::vector<std::string>& paths) {
  std::vector<std::unique_ptr<BagFile>> bags;
  const auto cache = std::make_shared<ChunkCache>();
  for (auto path = paths.begin(); path != paths.end(); ++path) {
    bags.push_back(std::make_unique<BagFile>(*path, cache));
    const auto same = std::find_if(
        paths.begin(), path, [&](const std::string& earlier) { return std::filesystem::equivalent(earlier, *path); });
    if (same != path) throw std::runtime_error("bag '" + *path + "': given twice, expected each bag once");
  }
  return bags;
}

}  // namespace devo
