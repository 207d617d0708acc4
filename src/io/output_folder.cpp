// SPDX-License-Identifier: BSD-3-Clause
#include "devo/io/output_folder.h"

#include <filesystem>
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
}

}  // namespace devo
