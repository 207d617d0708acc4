// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdlib>
#include <fstream>
#include <string>

namespace devo {

/// The folder of the development recordings: the environment variable DEVO_SHARED_DATA, else ../shared/data beside the
/// source.
inline std::string SharedDataFolder() {
  const char* folder = std::getenv("DEVO_SHARED_DATA");
  return folder != nullptr ? std::string(folder) : std::string(DEVO_SOURCE_DIR) + "/../shared/data";
}

/// Path of one of its files. Empty when it is not there: these files are third parties' and not part of the package.
inline std::string SharedData(const std::string& name) {
  std::string path = SharedDataFolder() + "/" + name;
  return std::ifstream(path).good() ? path : "";
}

/// Why a test is skipped that needs one of its files, or a folder of them.
inline std::string MissingSharedData(const std::string& name) {
  return "'" + SharedDataFolder() + "/" + name +
         "' does not exist (set DEVO_SHARED_DATA to the folder of the development recordings)";
}

}  // namespace devo
