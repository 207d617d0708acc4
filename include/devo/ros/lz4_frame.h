// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <cstdint>

namespace devo {

/// Decompresses a whole LZ4 frame, which is what a bag's chunk is (lz4_Frame_format.md of the LZ4 project), to `data`.
/// Returns whether it is undamaged, its checksums right, and makes `data_size` bytes.
bool DecompressLz4Frame(const std::uint8_t* frame, std::size_t frame_size, std::uint8_t* data, std::size_t data_size);

/// The checksum of LZ4 frames, with seed 0 (doc/xxhash_spec.md of the xxHash project). liblz4 keeps its own to itself.
std::uint32_t Xxh32(const std::uint8_t* bytes, std::size_t size);

}  // namespace devo
