// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <string>

namespace devo {

/// Path of a file of the development recordings: under the environment variable DEVO_SHARED_DATA, else ../shared/data
/// beside the source. Empty, with the reason printed, when it is not there: these files are third parties' and not part
/// of the package.
inline std::string SharedData(const std::string& name) {
  const char* folder = std::getenv("DEVO_SHARED_DATA");
  std::string path =
      (folder != nullptr ? std::string(folder) : std::string(DEVO_SOURCE_DIR) + "/../shared/data") + "/" + name;
  if (std::ifstream(path).good()) return path;
  std::printf("skipped: '%s' does not exist (set DEVO_SHARED_DATA to the folder of the development recordings)\n",
              path.c_str());
  return "";
}

}  // namespace devo
