// SPDX-License-Identifier: BSD-3-Clause
#include "devo/io/output_folder.h"

#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <stdexcept>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "throws_message.h"

namespace devo {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;

class OutputFolder : public ::testing::Test {
 protected:
  void TearDown() override { std::filesystem::remove_all(folder_); }

  const std::string folder_ = ::testing::TempDir() + "output_folder_test_" + std::to_string(getpid());
};

TEST_F(OutputFolder, IsMadeWithThoseAboveIt) {
  MakeOutputFolder(folder_ + "/of/results/");
  EXPECT_TRUE(std::filesystem::is_directory(folder_ + "/of/results"));
}

TEST_F(OutputFolder, KeepsWhatIsInOneThatIsThere) {
  MakeOutputFolder(folder_);
  std::ofstream(folder_ + "/report.json") << "{}";
  MakeOutputFolder(folder_);
  EXPECT_TRUE(std::filesystem::is_regular_file(folder_ + "/report.json"));
}

TEST_F(OutputFolder, IsNamedWhereAFileStandsInItsPlace) {
  MakeOutputFolder(folder_);
  std::ofstream(folder_ + "/out") << "a file, where a folder is asked for";
  EXPECT_THAT([this] { MakeOutputFolder(folder_ + "/out"); },
              ThrowsMessage<std::runtime_error>(
                  AllOf(HasSubstr("'" + folder_ + "/out'"), HasSubstr("expected a folder that can be written"))));
}

}  // namespace
}  // namespace devo
