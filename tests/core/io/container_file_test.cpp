// SPDX-License-Identifier: GPL-3.0-or-later
// Temporary files: what is in them, who can read them and what is left of them.
#include "core/io/formats/containers/container_file.h"

#include <gtest/gtest.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <csignal>
#include <filesystem>
#include <fstream>
#include <string>

#include "tests/core/io/cgns_writer.h"
#include "tests/core/io/open_descriptors.h"
#include "tests/core/io/own_temporary_folder.h"
#include "tests/support/expect_error.h"

namespace {

std::size_t most_at_once = 1 << 30;  // bytes that the system gives
int interruptions = 0;               // before that

}  // namespace

/// As the system may do it: in pieces, and interrupted.
extern "C" ssize_t pread(int descriptor, void* to, std::size_t size, off_t at) {
  if (interruptions > 0) {
    --interruptions;
    errno = EINTR;
    return -1;
  }
  return ::syscall(SYS_pread64, descriptor, to, std::min(size, most_at_once), at);
}

namespace deform::io::container_file_test {
namespace {

using test::expect_error;
using test::open_descriptors;

TEST(ContainerFile, HoldsTheBytesForItsOwnerOnly) {
  const std::string bytes("one\0two\n", 8);
  const ContainerFile file(bytes);
  EXPECT_EQ(file.bytes(8), bytes);
  struct stat status {};
  ASSERT_EQ(::stat(file.path().c_str(), &status), 0);
  EXPECT_EQ(status.st_mode & 0777u, 0600u);
  EXPECT_EQ(status.st_size, 8);
}

TEST(ContainerFile, IsReadInPiecesAndInSpiteOfInterruptions) {
  const std::string bytes = "123456789";
  const ContainerFile file(bytes);
  most_at_once = 4;
  interruptions = 2;
  EXPECT_EQ(file.bytes(9), bytes);
  EXPECT_EQ(interruptions, 0);
  most_at_once = 0;
  expect_error(ErrorCode::failed_precondition, {"temporary file"}, [&] { (void)file.bytes(9); });
  most_at_once = 1 << 30;
}

TEST(ContainerFile, RefusesToGiveMoreThanWasExpected) {
  const ContainerFile file("12345678");
  expect_error(ErrorCode::invalid_argument, {"the mesh file grew to 8 bytes", "damaged"}, [&] { (void)file.bytes(7); });
}

TEST(ContainerFile, IsReadAfterItsNameIsGone) {
  ContainerFile file("some");
  file.unlink();
  EXPECT_FALSE(std::filesystem::exists(file.path()));
  EXPECT_EQ(file.bytes(4), "some");
  // Nor does it remove what others give that name to.
  std::ofstream(file.path()) << "of others";
  file.unlink();
  EXPECT_TRUE(std::filesystem::remove(file.path()));
}

TEST(ContainerFile, LeavesNothingBehind) {
  const std::size_t before = open_descriptors();
  std::string path;
  {
    const ContainerFile file("some");
    path = file.path();
    EXPECT_TRUE(std::filesystem::exists(path));
    EXPECT_EQ(open_descriptors(), before + 1);
  }
  EXPECT_FALSE(std::filesystem::exists(path));
  EXPECT_EQ(open_descriptors(), before);
}

TEST(ContainerFile, OfAnotherProcessIsRemovedAsWell) {
  const std::string path = test::temporary_path("of_another_process");
  std::ofstream(path) << "some";
  const std::size_t before = open_descriptors();
  {
    const ContainerFile file = ContainerFile::of_other_process(path);
    EXPECT_EQ(file.path(), path);
    EXPECT_TRUE(std::filesystem::exists(path));
  }
  EXPECT_FALSE(std::filesystem::exists(path));
  EXPECT_EQ(open_descriptors(), before);
}

TEST(ContainerFile, ThatCannotBeWrittenIsAnErrorAndLeavesNothing) {
  const test::OwnTemporaryFolder folder;
  const std::size_t before = open_descriptors();
  // As on a full disk: a file may have a thousand bytes.
  rlimit limit{};
  ASSERT_EQ(::getrlimit(RLIMIT_FSIZE, &limit), 0);
  const rlimit low{1000, limit.rlim_max};
  const auto handler = std::signal(SIGXFSZ, SIG_IGN);
  ASSERT_EQ(::setrlimit(RLIMIT_FSIZE, &low), 0);
  expect_error(ErrorCode::failed_precondition, {"temporary file ", folder.path().c_str(), "File too large"},
               [] { const ContainerFile file(std::string(5000, 'a')); });
  EXPECT_EQ(::setrlimit(RLIMIT_FSIZE, &limit), 0);
  std::signal(SIGXFSZ, handler);
  EXPECT_TRUE(folder.empty());
  EXPECT_EQ(open_descriptors(), before);
}

TEST(ContainerFile, WithoutAFolderIsAnError) {
  const test::OwnTemporaryFolder folder;
  std::filesystem::remove(folder.path());
  const std::size_t before = open_descriptors();
  expect_error(ErrorCode::failed_precondition, {"TMPDIR names no folder: "}, [] { const ContainerFile file("some"); });
  EXPECT_EQ(open_descriptors(), before);
}

}  // namespace
}  // namespace deform::io::container_file_test
