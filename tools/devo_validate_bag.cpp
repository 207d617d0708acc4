// SPDX-License-Identifier: BSD-3-Clause
//
// Says of a recording whether the odometry can use it, why not, and what to change.
#include <cstdio>
#include <exception>
#include <string>
#include <vector>

#include <CLI/CLI.hpp>

#include "devo/io/rig_config.h"
#include "devo/ros/bag_validation.h"

int main(int argc, char** argv) {
  CLI::App app{
      "Explains bags: topics for each role, rates, stamps, encodings, calibration, overlap, and what to change."};
  std::vector<std::string> bags, configs, overrides;
  app.footer("Exit status: 0 usable, 1 problems found, 2 not readable.");
  app.add_option("bags", bags, "bags of one recording")->required();
  app.add_option("--config", configs, "rig's yaml; without one, topics are found by their type");
  app.add_option("--set", overrides, "key=value that overrides the yaml");
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& e) {
    return app.exit(e) == 0 ? 0 : 2;
  }
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
