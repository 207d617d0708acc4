// SPDX-License-Identifier: BSD-3-Clause
#include "devo/io/output_folder.h"

#include <filesystem>
#include <fstream>
#include <stdexcept>
#include <system_error>

namespace devo {

void MakeOutputFolder(const std::string& path) {
  std::error_code failed;
  std::filesystem::create_directories(path, failed);
  if (failed) {
    throw std::runtime_error("'" + path +
                             "': cannot be made, expected a folder that can be written: " + failed.message());
  }
  // One that is there may be another's: better known before hours of work.
  const std::filesystem::path probe = std::filesystem::path(path) / ".devo_can_write";
  if (!std::ofstream(probe)) throw std::runtime_error("'" + path + "': cannot be written, expected a folder that can");
  std::filesystem::remove(probe, failed);
}

}  // namespace devo
