// SPDX-License-Identifier: BSD-3-Clause
//
// Says of a recording whether the odometry can use it, why not, and what to change.
#include <cstdio>
#include <exception>
#include <string>
#include <vector>

#include "command_line.h"
#include "devo/io/rig_config.h"
#include "devo/ros/bag_validation.h"

int main(int argc, char** argv) {
  std::vector<std::string> bags, configs, overrides;
  devo::CommandLine line("BAG... [options]",
                         "Explains the bags of one recording: topics for each role, rates, stamps, encodings, "
                         "calibration, overlap, and what to change.",
                         "\nExit status: 0 usable, 1 problems found, 2 not readable.\n");
  line.AddWords("bag", devo::Several(&bags)->required(), -1);
  line.Add("config", devo::Several(&configs),
           "rig's yaml, later ones override earlier ones; without one, topics are found by their type");
  line.Add("set", devo::Several(&overrides), "key=value that overrides the yaml");
  if (const auto status = line.Read(argc, argv)) return *status;
  try {
    const bool has_config = !configs.empty() || !overrides.empty();
    const devo::BagValidation result = devo::ValidateBags(
        bags, has_config ? std::optional<devo::RigConfig>(devo::LoadRigConfig(configs, overrides)) : std::nullopt);
    std::printf("%s", result.text.c_str());
    return result.problems == 0 ? 0 : 1;
  } catch (const std::exception& e) {
    std::fprintf(stderr, "devo_validate_bag: %s\n", e.what());
    return 2;
  }
}
