// SPDX-License-Identifier: BSD-3-Clause
//
// What all programs say of their options, right and wrong ones.
#include <sys/wait.h>
#include <unistd.h>

#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <sstream>
#include <string>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tools/tiny_bag.h"

namespace devo {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::StartsWith;

void ExpectRefused(const std::string& program, const std::string& arguments, const std::string& complaint) {
  const ProgramResult result = RunProgram(program, arguments);
  EXPECT_EQ(result.status, 2) << program << " " << arguments;
  EXPECT_THAT(result.err, AllOf(StartsWith(program + ": "), HasSubstr(complaint))) << arguments;
}

TEST(CommandLine, OfEachProgramExplainsItsOptions) {
  for (const char* program :
       {"devo_check_alignment", "devo_evaluate", "devo_offline", "devo_simulate", "devo_validate_bag"}) {
    const ProgramResult result = RunProgram(program, "--help");
    EXPECT_EQ(result.status, 0) << program;
    EXPECT_THAT(result.err, IsEmpty()) << program;
    EXPECT_THAT(result.out, AllOf(HasSubstr("Usage: " + std::string(program) + " "), HasSubstr("Options:"),
                                  HasSubstr("--help"), HasSubstr("print this and exit")));
  }
  EXPECT_THAT(RunProgram("devo_simulate", "-h").out,
              AllOf(HasSubstr("Motion:"), HasSubstr("--rest arg (=0.3)"), HasSubstr("docs/simulation.md")));
}

TEST(CommandLine, NamesTheOptionThatIsMissing) {
  ExpectRefused("devo_offline", "--config a.yaml --out b", "'--bag' is required but missing");
  ExpectRefused("devo_check_alignment", "--bag a.bag", "'--config' is required but missing");
  ExpectRefused("devo_evaluate", "truth.txt", "'--estimate' is required but missing");
  ExpectRefused("devo_validate_bag", "", "'--bag' is required but missing");
}

TEST(CommandLine, NamesTheWordThatIsNoOption) {
  ExpectRefused("devo_simulate", "--sceen table", "unrecognised option '--sceen'");
  ExpectRefused("devo_simulate", "--dura 3", "unrecognised option '--dura'");
  ExpectRefused("devo_simulate", "table", "'table' is no option");
  ExpectRefused("devo_evaluate", "truth.txt estimate.txt more.txt", "'more.txt' is no option");
}

TEST(CommandLine, NamesTheOptionWithoutAValueOrWithTwo) {
  ExpectRefused("devo_simulate", "--duration --seed 3", "'--duration' has no value before '--seed'");
  ExpectRefused("devo_simulate", "--seed", "'--seed' is missing");
  ExpectRefused("devo_simulate", "--seed 1 --seed 2", "'--seed' cannot be specified more than once");
  ExpectRefused("devo_simulate", "--stop 1 2 --stop 3", "--stop has 3 numbers, expected two each time");
}

TEST(CommandLine, TellsWhichNumbersAnOptionTakes) {
  for (const char* number : {"nan", "-1", "1.5", "1e30", "one", "2x", "''"}) {
    ExpectRefused("devo_simulate", "--seed " + std::string(number), "expected a whole number from 0 to 9e+15");
  }
  ExpectRefused("devo_simulate", "--lidar-rate 31", "'--lidar-rate' is '31', expected a number from 1 to 30");
  ExpectRefused("devo_evaluate", "a b --interval 0", "'--interval' is '0', expected a number from 0.001 to 1e+06");
}

TEST(CommandLine, TakesNegativeNumbersAndValuesBehindAnEqualsSign) {
  // The scene is looked for after all options are read.
  ExpectRefused("devo_simulate", "--depth-offset -0.006 --depth-rate=15 --scene=none.yaml", "none.yaml");
}

TEST(CommandLine, OfASimulationForWhichTheDiskHasNoRoomNamesTheBag) {
  const std::string stem = ::testing::TempDir() + "command_line_test_" + std::to_string(getpid());
  // As a full disk: the bag may grow to 64 KiB, and a write beyond that fails.
  const int status = std::system(("bash -c \"trap '' XFSZ; ulimit -c 0 -f 64; exec " DEVO_BIN_DIR
                                  "/devo_simulate --sensor davis240 --duration 0.2 --rest 0 --quiet --out " +
                                  stem + "\" > /dev/null 2> " + stem + ".err")
                                     .c_str());
  ASSERT_TRUE(WIFEXITED(status));
  EXPECT_EQ(WEXITSTATUS(status), 2);
  std::stringstream err;
  err << std::ifstream(stem + ".err").rdbuf();
  EXPECT_THAT(err.str(), StartsWith("devo_simulate: bag '" + stem + ".bag.active' cannot be written: "));
  EXPECT_FALSE(std::ifstream(stem + ".bag").good());
  for (const char* end : {".bag.active", ".yaml", ".err"}) std::remove((stem + end).c_str());
}

}  // namespace
}  // namespace devo
