// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/base/control_group.h"

#include <gtest/gtest.h>

#include <stdlib.h>

#include <algorithm>
#include <fstream>
#include <string>
#include <thread>

namespace deform::control_group_test {
namespace {

/// A folder that stands for "/".
class Root {
 public:
  explicit Root(const std::string& groups) {
    std::string name = (std::filesystem::temp_directory_path() / "control_group.XXXXXX").string();
    folder_ = mkdtemp(name.data());
    write("proc/self/cgroup", groups);
  }
  ~Root() { std::filesystem::remove_all(folder_); }
  Root(const Root&) = delete;
  Root& operator=(const Root&) = delete;
  void write(const std::string& file, const std::string& content) const {
    std::filesystem::create_directories((folder_ / file).parent_path());
    std::ofstream(folder_ / file) << content;
  }
  ControlGroup read() const { return ControlGroup::read(folder_); }

 private:
  std::filesystem::path folder_;
};

TEST(ControlGroup, ContainersSeeTheirGroupAsTheRoot) {
  const Root root("0::/\n");
  EXPECT_FALSE(root.read().cores || root.read().memory) << "a machine without limits";
  root.write("sys/fs/cgroup/cpu.max", "150000 100000\n");
  root.write("sys/fs/cgroup/memory.max", "4294967296\n");
  EXPECT_EQ(root.read().cores, 1.5);
  EXPECT_EQ(root.read().memory, std::uint64_t{1} << 32);
  root.write("sys/fs/cgroup/cpu.max", "max 100000\n");
  root.write("sys/fs/cgroup/memory.max", "max\n");
  EXPECT_FALSE(root.read().cores || root.read().memory);
}

// A service of systemd with CPUQuota=400% and MemoryMax=2G in a slice that has less of the one.
TEST(ControlGroup, TheLeastOfTheGroupAndThoseAroundItCounts) {
  const Root root("0::/optimization.slice/deformd.service\n");
  root.write("sys/fs/cgroup/optimization.slice/deformd.service/cpu.max", "400000 100000\n");
  root.write("sys/fs/cgroup/optimization.slice/deformd.service/memory.max", "2147483648\n");
  root.write("sys/fs/cgroup/optimization.slice/cpu.max", "300000 100000\n");
  root.write("sys/fs/cgroup/optimization.slice/memory.max", "8589934592\n");
  root.write("sys/fs/cgroup/another.slice/cpu.max", "50000 100000\n");
  EXPECT_EQ(root.read().cores, 3);
  EXPECT_EQ(root.read().memory, std::uint64_t{1} << 31);
}

TEST(ControlGroup, VersionOneHasAMountForEachController) {
  const Root root("12:cpu,cpuacct:/docker/0123\n7:memory:/docker/0123\n3:cpuset:/\n1:name=systemd:/docker/0123\n");
  root.write("sys/fs/cgroup/memory/memory.limit_in_bytes", "9223372036854771712\n");
  root.write("sys/fs/cgroup/cpu/docker/0123/cpu.cfs_quota_us", "-1\n");
  root.write("sys/fs/cgroup/cpu/docker/0123/cpu.cfs_period_us", "100000\n");
  EXPECT_FALSE(root.read().cores || root.read().memory);
  root.write("sys/fs/cgroup/cpu/docker/0123/cpu.cfs_quota_us", "250000\n");
  root.write("sys/fs/cgroup/memory/docker/0123/memory.limit_in_bytes", "1073741824\n");
  EXPECT_EQ(root.read().cores, 2.5);
  EXPECT_EQ(root.read().memory, std::uint64_t{1} << 30);
}

// Within a container of version 1 the path is that of the host, where nothing is mounted; its own group is the mount.
TEST(ControlGroup, APathOfTheHostLeadsNowhere) {
  const Root root("5:memory:/docker/0123\n4:cpuacct,cpu:/docker/0123\n0::/../..\n");
  root.write("sys/fs/cgroup/memory/memory.limit_in_bytes", "1073741824\n");
  root.write("sys/fs/cgroup/cpuacct,cpu/cpu.cfs_quota_us", "50000\n");
  root.write("sys/fs/cgroup/cpuacct,cpu/cpu.cfs_period_us", "100000\n");
  EXPECT_EQ(root.read().cores, 0.5);
  EXPECT_EQ(root.read().memory, std::uint64_t{1} << 30);
}

TEST(ControlGroup, BrokenFilesLimitNothing) {
  const Root root("nonsense\n0:\n::\n0::/a\n");
  root.write("sys/fs/cgroup/a/cpu.max", "0 0\n");
  root.write("sys/fs/cgroup/a/memory.max", "many\n");
  EXPECT_FALSE(root.read().cores || root.read().memory);
}

TEST(ControlGroup, CoresAreAtLeastOneAndThoseOfTheMachineAtMost) {
  EXPECT_GE(available_cores(), 1);
  EXPECT_LE(available_cores(), static_cast<int>(std::max(1u, std::thread::hardware_concurrency())));
}

}  // namespace
}  // namespace deform::control_group_test
