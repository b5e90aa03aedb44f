// SPDX-License-Identifier: GPL-3.0-or-later
// The deformd process: port file, signals, exit codes, one-line errors.
#include <grpcpp/grpcpp.h>
#include <gtest/gtest.h>
#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include <chrono>
#include <cstdlib>
#include <fstream>
#include <iterator>
#include <string>
#include <vector>

#include "core/numerics/dense/blas_kernels.h"
#include "deform/v1/service.grpc.pb.h"
#include "tests/support/fake_engine.h"
#include "tests/support/in_process_server.h"

namespace deform::server::deformd_test {
namespace {

using support::eventually;

std::string content(const std::filesystem::path& path) {
  std::ifstream in(path);
  return {std::istreambuf_iterator<char>(in), {}};
}

/// Runs deformd with its standard error in a file. Killed at the end when it still runs.
class Process {
 public:
  Process(std::vector<std::string> arguments, std::filesystem::path output) : output_(std::move(output)) {
    arguments.insert(arguments.begin(), DEFORMD_BINARY);
    std::vector<char*> argv;
    for (std::string& argument : arguments) argv.push_back(argument.data());
    argv.push_back(nullptr);
    pid_ = fork();
    if (pid_ == 0) {
      if (freopen(output_.c_str(), "w", stderr) == nullptr) _exit(126);
      execv(argv[0], argv.data());
      _exit(127);
    }
  }
  ~Process() {
    if (code_) return;
    kill(pid_, SIGKILL);
    wait();
  }
  Process(const Process&) = delete;
  Process& operator=(const Process&) = delete;

  pid_t id() const { return pid_; }
  void signal(int number) const { kill(pid_, number); }
  bool ended() {
    int status = 0;
    if (!code_ && waitpid(pid_, &status, WNOHANG) == pid_) code_ = decoded(status);
    return code_.has_value();
  }
  /// Exit code, or minus the signal.
  int wait() {
    int status = 0;
    if (!code_ && waitpid(pid_, &status, 0) == pid_) code_ = decoded(status);
    return *code_;
  }
  std::string output() const { return content(output_); }

 private:
  static int decoded(int status) { return WIFEXITED(status) ? WEXITSTATUS(status) : -WTERMSIG(status); }
  pid_t pid_ = 0;
  std::filesystem::path output_;
  std::optional<int> code_;
};

class Deformd : public testing::Test {
 protected:
  std::vector<std::string> arguments(std::vector<std::string> more = {}) {
    std::vector<std::string> out = {"--address",   "127.0.0.1:0", "--data-dir", (folder.path() / "data").string(),
                                    "--port-file", port_file(),   "--workers",  "1"};
    out.insert(out.end(), more.begin(), more.end());
    return out;
  }
  std::string port_file() { return (folder.path() / "port").string(); }
  std::filesystem::path output(const char* name = "stderr") { return folder.path() / name; }
  std::string address() {
    EXPECT_TRUE(eventually([&] { return std::filesystem::exists(port_file()); }));
    const std::string port = content(port_file());
    return "127.0.0.1:" + port.substr(0, port.find('\n'));
  }
  support::TemporaryFolder folder;
};

TEST_F(Deformd, ServesUntilSigterm) {
  for (const int number : {SIGTERM, SIGINT}) {
    std::filesystem::remove(port_file());
    Process process(arguments(), output());
    const auto stub = v1::DeformService::NewStub(grpc::CreateChannel(address(), grpc::InsecureChannelCredentials()));
    grpc::ClientContext context;
    v1::ServerInfo info;
    ASSERT_TRUE(stub->GetServerInfo(&context, {}, &info).ok());
    process.signal(number);
    const auto begin = std::chrono::steady_clock::now();
    EXPECT_TRUE(eventually([&] { return process.ended(); }));
    EXPECT_LT(std::chrono::steady_clock::now() - begin, std::chrono::seconds(3)) << "an idle connection must not hold it up";
    EXPECT_EQ(process.wait(), 0) << process.output();
    const std::string log = process.output();
    EXPECT_NE(log.find("option workers=1 (flag)"), std::string::npos);
    EXPECT_NE(log.find("option queue-limit=256 (default)"), std::string::npos);
    EXPECT_NE(log.find("method=GetServerInfo"), std::string::npos);
    EXPECT_NE(log.find("stopped"), std::string::npos);
  }
}

/// What the log says of the kernels of OpenBLAS.
std::string kernels_in(const std::string& log) {
  const std::string before = "kernels of OpenBLAS for ";
  const auto at = log.find(before);
  return at == std::string::npos ? "" : log.substr(at + before.size(), log.find('\n', at) - at - before.size());
}

TEST_F(Deformd, ComputesWithTheKernelsOfTheProcessorOrThoseAskedFor) {
  const char* asked = std::getenv("OPENBLAS_CORETYPE");
  const std::string before = asked == nullptr ? "" : asked;
  for (const std::string kernels : {"", "Nehalem"}) {
    std::filesystem::remove(port_file());
    kernels.empty() ? unsetenv("OPENBLAS_CORETYPE") : setenv("OPENBLAS_CORETYPE", kernels.c_str(), 1);
    Process process(arguments(), output());
    address();
    EXPECT_EQ(content("/proc/" + std::to_string(process.id()) + "/comm"), "deformd\n") << "as tools that look for it want it";
    process.signal(SIGTERM);
    EXPECT_EQ(process.wait(), 0) << process.output();
    const std::string used = kernels_in(process.output());
    if (kernels.empty()) {
      EXPECT_NE(used, "");
      EXPECT_EQ(lapack::better_kernels(used, lapack::processor_features()), "") << used;
    } else {
      EXPECT_EQ(used, kernels);
    }
  }
  before.empty() ? unsetenv("OPENBLAS_CORETYPE") : setenv("OPENBLAS_CORETYPE", before.c_str(), 1);
}

TEST_F(Deformd, AnUploadThatStallsIsCutOffAfterTheGrace) {
  Process process(arguments({"--grace", "0.5"}), output());
  const auto stub = v1::DeformService::NewStub(grpc::CreateChannel(address(), grpc::InsecureChannelCredentials()));
  grpc::ClientContext context;
  v1::GeometryInfo info;
  const auto writer = stub->RegisterGeometry(&context, &info);
  v1::RegisterGeometryRequest header;
  header.mutable_header()->set_point_count(10);
  ASSERT_TRUE(writer->Write(header));
  process.signal(SIGTERM);
  EXPECT_TRUE(eventually([&] { return process.ended(); }));
  EXPECT_EQ(process.wait(), 0) << process.output();
  EXPECT_FALSE(writer->Finish().ok());
}

TEST_F(Deformd, ASecondSignalEndsItAtOnce) {
  Process process(arguments({"--grace", "3600"}), output());
  const auto stub = v1::DeformService::NewStub(grpc::CreateChannel(address(), grpc::InsecureChannelCredentials()));
  grpc::ClientContext context;
  v1::GeometryInfo info;
  const auto writer = stub->RegisterGeometry(&context, &info);
  v1::RegisterGeometryRequest header;
  header.mutable_header()->set_point_count(10);
  ASSERT_TRUE(writer->Write(header));
  process.signal(SIGTERM);
  EXPECT_TRUE(eventually([&] { return process.output().find("SIGTERM: stopping") != std::string::npos; }));
  EXPECT_FALSE(process.ended());
  process.signal(SIGTERM);
  EXPECT_TRUE(eventually([&] { return process.ended(); }));
  EXPECT_EQ(process.wait(), 1);
  EXPECT_FALSE(writer->Finish().ok());
}

TEST_F(Deformd, MistakesInTheOptionsExitWithTwoAndOneLine) {
  const std::vector<std::vector<std::string>> mistakes = {{"--wrokers", "3"},
                                                          {"--workers", "x"},
                                                          {"--address", "0.0.0.0:0"},
                                                          {"--config", "/nowhere.yaml"},
                                                          {"--log-file", "/proc/no/log"}};
  for (const auto& mistake : mistakes) {
    Process process(mistake, output());
    EXPECT_EQ(process.wait(), 2) << mistake[0];
    const std::string text = process.output();
    EXPECT_TRUE(text.starts_with("deformd: ")) << text;
    EXPECT_EQ(std::count(text.begin(), text.end(), '\n'), 1) << text;
  }
}

TEST_F(Deformd, ADataDirectoryInUseExitsWithOne) {
  Process first(arguments(), output());
  address();
  Process second(arguments({"--log-level", "off"}), output("second"));
  EXPECT_EQ(second.wait(), 1);
  EXPECT_TRUE(second.output().starts_with("deformd: ")) << second.output();
  first.signal(SIGTERM);
  EXPECT_EQ(first.wait(), 0);
}

}  // namespace
}  // namespace deform::server::deformd_test
