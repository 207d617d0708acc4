// SPDX-License-Identifier: BSD-3-Clause
//
// Error of an estimated trajectory against ground truth, both in TUM files.
#include <cstdio>
#include <exception>
#include <fstream>
#include <stdexcept>
#include <string>

#include <CLI/CLI.hpp>

#include "devo/io/evaluation.h"
#include "number_in.h"

namespace {

void Print(const devo::Evaluation& e) {
  std::printf("pairs                %zu\n", e.pairs);
  std::printf("ATE RMSE             %.6f m (max %.6f m), SE(3)-aligned, no scale\n", e.ate_rmse_m, e.ate_max_m);
  std::printf("drift                %s\n", DriftText(e, 3).c_str());
  if (e.rpe_pairs > 0) {
    std::printf("RPE rotation RMSE    %.4f deg (%zu pairs)\n", e.rpe_rotation_rmse_deg, e.rpe_pairs);
    std::printf("RPE translation RMSE %.4f cm\n", e.rpe_translation_rmse_cm);
  } else {
    std::printf("RPE                  none: the poses with ground truth span less than the interval\n");
  }
  std::printf("first to last pose   %.4f deg, %.4f cm\n", e.final_rotation_deg, 100 * e.final_translation_m);
  std::printf("coverage             %.2f %%\n", 100 * e.coverage);
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App app{"Error of an estimated trajectory against ground truth (TUM files: t tx ty tz qx qy qz qw)."};
  std::string truth_path, estimate_path, json_path;
  devo::EvaluationOptions options;
  app.add_option("ground_truth", truth_path, "TUM file")->required();
  app.add_option("estimate", estimate_path, "TUM file")->required();
  app.add_option("--json", json_path, "write the figures to this file, too ('-': to standard output, nothing else)");
  app.add_option("--interval", options.rpe_interval_s, "seconds over which the relative error is taken")
      ->check(devo::NumberIn(1e-3, 1e6))
      ->capture_default_str();
  app.add_option("--max-gap", options.max_gap_s, "ground truth is not interpolated over longer gaps, seconds")
      ->check(devo::NumberIn(1e-6, 1e6))
      ->capture_default_str();
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& e) {
    return app.exit(e) == 0 ? 0 : 2;
  }
  try {
    const devo::Evaluation result = devo::Evaluate(devo::ReadTum(truth_path), devo::ReadTum(estimate_path), options);
    if (json_path == "-") {
      std::printf("%s\n", devo::ToJson(result).c_str());
      return 0;
    }
    Print(result);
    if (!json_path.empty()) {
      std::ofstream file(json_path);
      file << devo::ToJson(result) << '\n';
      if (!file.flush()) throw std::runtime_error("'" + json_path + "': cannot be written");
    }
  } catch (const std::exception& e) {
    std::fprintf(stderr, "devo_evaluate: %s\n", e.what());
    return 2;
  }
  return 0;
}
