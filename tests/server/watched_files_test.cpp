// SPDX-License-Identifier: GPL-3.0-or-later
#include "server/store/watched_files.h"

#include <fcntl.h>
#include <gtest/gtest.h>

#include <atomic>
#include <cerrno>
#include <future>
#include <thread>

#include "core/base/error.h"
#include "server/store/file.h"

namespace deform::server::watched_files_test {
namespace {

using std::chrono::milliseconds;

/// Files of this machine whose names are not answered for while it is silent. It lives for ever: a look may be under way.
class Mute : public WatchedFiles {
 public:
  Mute() : WatchedFiles(system_files(), "/") {}
  void fall_silent(bool silent) {
    silent_ = silent;
    silent_.notify_all();
  }
  int status(const Path& path, Links links, struct stat& status) override {
    silent_.wait(true);
    return WatchedFiles::status(path, links, status);
  }

 private:
  std::atomic<bool> silent_{false};
};

bool comes(const std::function<bool()>& what) {
  for (int i = 0; i < 2000 && !what(); ++i) std::this_thread::sleep_for(milliseconds(5));
  return what();
}

TEST(WatchedFiles, FailAtOnceWhileTheirFolderIsSilentAndWorkAgainAfterwards) {
  auto& mute = *new Mute;
  WatchedFiles files(mute, "/", {.interval = milliseconds(5), .patience = milliseconds(30)});
  EXPECT_TRUE(files.answers());
  struct stat status {};
  EXPECT_EQ(files.status("/", FileSystem::Links::follow, status), 0);

  mute.fall_silent(true);
  auto begun = std::async(std::launch::async, [&] {
    struct stat of_begun {};
    return mute.status("/", FileSystem::Links::follow, of_begun);
  });
  ASSERT_TRUE(comes([&] { return !files.answers(); }));
  std::vector<std::string> names;
  for (const auto& call : std::initializer_list<std::function<int()>>{
           [&] { return files.status("/", FileSystem::Links::follow, status); }, [&] { return files.open("/", O_RDONLY); },
           [&] { return files.list("/", names); }, [&] { return files.rename("/nowhere/a", "/nowhere/b"); },
           [&] { return files.remove("/nowhere/a"); }, [&] { return files.make_directory("/nowhere/a/b"); },
           [&] { return files.link("/nowhere/a", "/nowhere/b"); }, [&] { return files.close_to_others("/nowhere/a"); }}) {
    errno = 0;
    EXPECT_EQ(call(), -1);
    EXPECT_EQ(errno, ETIMEDOUT);
  }
  EXPECT_FALSE(files.free_bytes("/"));
  EXPECT_FALSE(files.is_writable("/"));
  EXPECT_FALSE(is_seen(files, "/"));
  EXPECT_THROW(exists(files, "/"), Error) << "not taken for one that is not there";
  EXPECT_EQ(begun.wait_for(milliseconds(0)), std::future_status::timeout) << "what had begun waits on";

  mute.fall_silent(false);
  EXPECT_EQ(begun.get(), 0);
  EXPECT_TRUE(comes([&] { return files.answers(); }));
  EXPECT_EQ(files.status("/", FileSystem::Links::follow, status), 0);
  EXPECT_TRUE(files.free_bytes("/"));
}

TEST(WatchedFiles, AreDestroyedWithoutWaitingForALook) {
  auto& mute = *new Mute;
  {
    const WatchedFiles files(mute, "/", {.interval = milliseconds(1), .patience = milliseconds(5)});
    mute.fall_silent(true);
    ASSERT_TRUE(comes([&] { return !files.answers(); }));
  }
  mute.fall_silent(false);
}

}  // namespace
}  // namespace deform::server::watched_files_test
