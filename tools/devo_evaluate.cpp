// SPDX-License-Identifier: BSD-3-Clause
//
// Error of an estimated trajectory against ground truth, both in TUM files.
#include <cstdio>
#include <exception>
#include <fstream>
#include <stdexcept>
#include <string>

#include "command_line.h"
#include "devo/io/evaluation.h"

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
  std::string truth_path, estimate_path, json_path;
  devo::EvaluationOptions options;
  devo::CommandLine line("GROUND_TRUTH ESTIMATE [options]",
                         "Error of an estimated trajectory against ground truth (TUM files: t tx ty tz qx qy qz qw).");
  line.AddWords("ground_truth", devo::po::value(&truth_path)->required(), 1);
  line.AddWords("estimate", devo::po::value(&estimate_path)->required(), 1);
  line.Add("json", devo::po::value(&json_path),
           "write the figures to this file, too ('-': to standard output, nothing else)");
  line.Add("interval", devo::ShownNumberIn(&options.rpe_interval_s, 1e-3, 1e6),
           "seconds over which the relative error is taken");
  line.Add("max-gap", devo::ShownNumberIn(&options.max_gap_s, 1e-6, 1e6),
           "ground truth is not interpolated over longer gaps, seconds");
  if (const auto status = line.Read(argc, argv)) return *status;
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
