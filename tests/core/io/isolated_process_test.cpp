// SPDX-License-Identifier: GPL-3.0-or-later
// Programs started for one request: what they inherit, how they end and what is left of them.
#include "core/io/formats/containers/isolated_process.h"

#include <fcntl.h>
#include <gtest/gtest.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cerrno>
#include <csignal>
#include <string>
#include <vector>

#include "tests/core/io/open_descriptors.h"
#include "tests/support/expect_error.h"

namespace deform::io::isolated_process_test {
namespace {

using test::open_descriptors;

/// A request that has nothing to say.
class Nothing {
 public:
  ~Nothing() { ::close(descriptor_); }
  int get() const { return descriptor_; }

 private:
  const int descriptor_ = ::open("/dev/null", O_RDONLY | O_CLOEXEC);
};

std::string all_of(IsolatedProcess& process) {
  std::string answer(1 << 16, '\0');
  std::size_t used = 0;
  while (const std::size_t got = process.read(answer.data() + used, answer.size() - used, {})) used += got;
  return answer.substr(0, used);
}

std::string answer_of(const std::vector<std::string>& command) {
  const Nothing nothing;
  IsolatedProcess process(command, nothing.get());
  std::string answer = all_of(process);
  const std::optional<int> status = process.end();
  EXPECT_TRUE(status && WIFEXITED(*status) && WEXITSTATUS(*status) == 0);
  return answer;
}

void expect_no_children() {
  EXPECT_EQ(::waitpid(-1, nullptr, WNOHANG), -1);
  EXPECT_EQ(errno, ECHILD);
}

TEST(IsolatedProcess, ReadsItsRequestAndAnswers) {
  const std::string path = testing::TempDir() + "deform_request_" + std::to_string(::getpid());
  const int request = ::open(path.c_str(), O_RDWR | O_CREAT | O_TRUNC | O_CLOEXEC, 0600);
  ASSERT_GE(request, 0);
  ASSERT_EQ(::write(request, "a question", 10), 10);
  ASSERT_EQ(::lseek(request, 0, SEEK_SET), 0);
  ::unlink(path.c_str());
  IsolatedProcess process({"/bin/sh", "-c", "echo beside >&2; printf 'answer to '; cat"}, request);
  EXPECT_EQ(all_of(process), "answer to a question");
  const std::optional<int> status = process.end();
  ASSERT_TRUE(status);
  EXPECT_EQ(*status, 0);
  EXPECT_EQ(process.end(), status) << "it is said once more";
  EXPECT_EQ(::close(request), 0) << "it stays open here";
  expect_no_children();
}

TEST(IsolatedProcess, InheritsNoSignalThatIsBlockedOrBrokenPipesThatAreIgnored) {
  sigset_t all, before;
  sigfillset(&all);
  ASSERT_EQ(pthread_sigmask(SIG_BLOCK, &all, &before), 0);
  const auto handler = std::signal(SIGPIPE, SIG_IGN);
  const std::string status = answer_of({"/bin/sh", "-c", "while read -r line; do echo \"$line\"; done < /proc/$$/status"});
  std::signal(SIGPIPE, handler);
  pthread_sigmask(SIG_SETMASK, &before, nullptr);
  const auto signals = [&](const std::string& name) {
    const std::size_t at = status.find("\n" + name + ":");
    return at == std::string::npos ? ~0ull : std::stoull(status.substr(at + name.size() + 2), nullptr, 16);
  };
  EXPECT_EQ(signals("SigBlk"), 0u);
  EXPECT_EQ(signals("SigIgn") & 1ull << (SIGPIPE - 1), 0u);
}

TEST(IsolatedProcess, InheritsTheStandardStreamsOnly) {
  // Not closed by themselves where a program starts.
  const int low = ::open("/dev/null", O_RDONLY), high = ::fcntl(low, F_DUPFD, 40);
  const std::string asked = "0 1 2 " + std::to_string(low) + " " + std::to_string(high);
  const std::string streams =
      answer_of({"/bin/sh", "-c", "for i in " + asked + "; do [ -e /proc/$$/fd/$i ] && echo $i; done; exit 0"});
  ::close(low);
  ::close(high);
  EXPECT_EQ(streams, "0\n1\n2\n");
  EXPECT_EQ(answer_of({"/bin/sh", "-c", "readlink /proc/$$/fd/2"}), "/dev/null\n");
}

TEST(IsolatedProcess, SaysHowItEnded) {
  const Nothing nothing;
  for (const int code : {0, 3}) {
    IsolatedProcess process({"/bin/sh", "-c", "exit " + std::to_string(code)}, nothing.get());
    EXPECT_EQ(all_of(process), "");
    const int status = process.end().value_or(-1);
    EXPECT_TRUE(WIFEXITED(status));
    EXPECT_EQ(WEXITSTATUS(status), code);
  }
  IsolatedProcess sleeping({"/bin/sh", "-c", "exec sleep 60"}, nothing.get());
  const int status = sleeping.end().value_or(-1);
  EXPECT_TRUE(WIFSIGNALED(status));
  EXPECT_EQ(WTERMSIG(status), SIGKILL);
  expect_no_children();
}

TEST(IsolatedProcess, LeavesNothingBehind) {
  const Nothing nothing;
  const std::size_t before = open_descriptors();
  {
    const IsolatedProcess sleeping({"/bin/sh", "-c", "exec sleep 60"}, nothing.get());
    EXPECT_EQ(open_descriptors(), before + 1);
  }
  EXPECT_EQ(open_descriptors(), before);
  test::expect_error(ErrorCode::failed_precondition, {"cannot start /no/such/program: No such file or directory"},
                     [&] { const IsolatedProcess none({"/no/such/program"}, nothing.get()); });
  EXPECT_EQ(open_descriptors(), before);
  test::expect_error(ErrorCode::failed_precondition, {"cannot start /bin/sh: Bad file descriptor"}, [&] {
    const IsolatedProcess none({"/bin/sh", "-c", "exit 0"}, -1);
  });
  EXPECT_EQ(open_descriptors(), before);
  expect_no_children();
}

TEST(IsolatedProcess, IsNotWaitedForOnceItIsCancelled) {
  const Nothing nothing;
  IsolatedProcess sleeping({"/bin/sh", "-c", "exec sleep 60"}, nothing.get());
  std::stop_source stop;
  stop.request_stop();
  char byte = 0;
  test::expect_error(ErrorCode::cancelled, {"interrupted"}, [&] { (void)sleeping.read(&byte, 1, stop.get_token()); });
}

}  // namespace
}  // namespace deform::io::isolated_process_test
