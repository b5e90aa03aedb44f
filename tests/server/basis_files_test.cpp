// SPDX-License-Identifier: GPL-3.0-or-later
// Files of handle bases on a disk that stops, fills up and fails: what has a name is whole.
#include "server/store/basis_files.h"

#include <gtest/gtest.h>
#include <spdlog/spdlog.h>

#include <fcntl.h>

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <optional>
#include <random>
#include <stop_token>
#include <string>

#include "core/base/error.h"
#include "tests/server/server_fakes.h"
#include "tests/server/simulated_disk.h"

namespace deform::server::basis_files_test {
namespace {

const std::filesystem::path root = "/data";

class BasisFilesTest : public testing::Test {
 protected:
  BasisFilesTest() { spdlog::set_level(spdlog::level::off); }

  static OwnedId system(char digit, const std::string& tenant = default_tenant) { return {tenant, std::string(64, digit)}; }
  static std::string content(std::size_t size) {
    std::string text(size, '\0');
    for (std::size_t i = 0; i < size; ++i) text[i] = static_cast<char>('a' + i * i % 23);
    return text;
  }
  /// A store's folder on a disk, and its bases.
  struct Opened {
    Opened(SimulatedDisk& disk, std::uint64_t most)
        : directory(root, StoreDirectory::Accept::stores, disk),
          space(root, directory.reserve(), {std::uint64_t{1} << 16, {}}, disk),
          files(directory, space, most) {}
    StoreDirectory directory;
    DiskSpace space;
    BasisFiles files;
  };
  static void put(BasisFiles& files, const OwnedId& id, const std::string& text, const RunContext& context = {}) {
    files.put(
        id, text.size(),
        [&](const BasisFiles::Sink& sink) {
          for (std::size_t i = 0; i < text.size(); i += 1000) sink(text.data() + i, std::min<std::size_t>(1000, text.size() - i));
        },
        context);
  }
  /// Verified; nothing when there is none.
  static std::optional<std::string> get(const BasisFiles& files, const OwnedId& id) {
    const auto reader = files.open(id);
    if (!reader) return std::nullopt;
    std::string text(reader->size(), '\0');
    reader->read(text.data(), text.size());
    reader->verify();
    return text;
  }
  template <typename Action>
  static std::optional<ErrorCode> error_of(Action action) {
    try {
      action();
    } catch (const Error& error) {
      return error.code();
    }
    return std::nullopt;
  }
};

TEST_F(BasisFilesTest, what_was_put_is_read_by_whoever_it_belongs_to) {
  SimulatedDisk disk(SimulatedDisk::empty());
  Opened opened(disk, 1 << 20);
  const std::string large = content(100'000), small = content(3);
  put(opened.files, system('a'), large);
  put(opened.files, system('a', "team"), small);
  EXPECT_EQ(get(opened.files, system('a')), large);
  EXPECT_EQ(get(opened.files, system('a', "team")), small);
  EXPECT_EQ(get(opened.files, system('b')), std::nullopt);
  EXPECT_EQ(opened.files.bytes_of("team"), 3u + 64u);
  EXPECT_EQ(opened.files.bytes(), 100'000u + 3u + 2 * 64u);
  put(opened.files, system('a'), small);
  EXPECT_EQ(get(opened.files, system('a')), large) << "what is there stays";
  opened.files.remove(system('a'));
  EXPECT_EQ(get(opened.files, system('a')), std::nullopt);
  EXPECT_EQ(get(opened.files, system('a', "team")), small);
}

TEST_F(BasisFilesTest, a_flipped_bit_is_found_wherever_it_is_and_so_is_another_name) {
  SimulatedDisk disk(SimulatedDisk::empty());
  Opened opened(disk, 1 << 20);
  put(opened.files, system('a'), content(500));
  const auto path = opened.directory.bases() / (std::string(64, 'a') + ".basis");
  std::size_t checked = 0;
  for (std::uint64_t bit = 0; bit < 8 * (500 + 64); bit += 13) {
    disk.flip_bit(path, bit);
    EXPECT_EQ(error_of([&] { get(opened.files, system('a')); }), ErrorCode::data_loss) << bit;
    checked += opened.files.check({}, [](const OwnedId&, const std::string&) {});
    disk.flip_bit(path, bit);
  }
  EXPECT_EQ(get(opened.files, system('a')), content(500));
  std::size_t damaged = 0;
  disk.rename(path, opened.directory.bases() / (std::string(64, 'b') + ".basis"));
  EXPECT_EQ(error_of([&] { get(opened.files, system('b')); }), ErrorCode::data_loss);
  opened.files.check({}, [&](const OwnedId& id, const std::string&) { damaged += id == system('b') ? 1 : 0; });
  EXPECT_EQ(damaged, 1u);
  EXPECT_GT(checked, 0u);
  opened.files.set_aside(system('b'));
  EXPECT_FALSE(opened.files.contains(system('b')));
  EXPECT_EQ(count_entries(opened.directory.damaged(), disk), 1u);
}

TEST_F(BasisFilesTest, a_machine_that_stops_leaves_a_whole_file_or_none) {
  const std::string text = content(20'000);
  std::uint64_t first = 0, last = 0;
  SimulatedDisk::State before;
  {
    SimulatedDisk disk(SimulatedDisk::empty());
    Opened opened(disk, 1 << 20);
    put(opened.files, system('a'), text);
    before = disk.state();
    first = disk.changes();
    put(opened.files, system('b'), text);
    last = disk.changes();
  }
  ASSERT_GT(last, first + 3);
  using Survival = SimulatedDisk::Survival;
  std::mt19937_64 random(5);
  for (std::uint64_t stop = 1; stop <= last - first + 1; ++stop) {  // the first change that does not happen
    for (const Survival survival : {Survival::durable, Survival::all, Survival::names, Survival::content, Survival::random}) {
      SimulatedDisk::State state;
      {
        SimulatedDisk disk(before);
        Opened opened(disk, 1 << 20);
        disk.stops_at = disk.changes() + stop;
        error_of([&] { put(opened.files, system('b'), text); });
        state = SimulatedDisk::after_crash(disk.state(), survival, random);
      }
      SimulatedDisk disk(state);
      Opened opened(disk, 1 << 20);
      opened.files.sweep(BasisFiles::Alone::yes);
      EXPECT_EQ(get(opened.files, system('a')), text);
      const auto found = get(opened.files, system('b'));
      EXPECT_TRUE(found || stop <= last - first) << "it was put";
      EXPECT_EQ(found.value_or(text), text) << stop;
      EXPECT_EQ(disk.files(opened.directory.bases()).size(), found ? 2u : 1u) << "nothing half";
    }
  }
}

TEST_F(BasisFilesTest, a_disk_that_fills_up_or_fails_leaves_nothing_behind) {
  const std::string text = content(20'000);
  for (int failing = 0; failing < 12; ++failing) {
    for (const int error : {ENOSPC, EIO}) {
      SimulatedDisk disk(SimulatedDisk::empty());
      Opened opened(disk, 1 << 20);
      put(opened.files, system('a'), text);
      int changes = 0;
      bool failed = false;
      disk.fault = [&](bool changing) {
        const bool now = changing && changes++ == failing;
        failed = failed || now;
        return now ? error : 0;
      };
      const auto code = error_of([&] { put(opened.files, system('b'), text); });
      disk.fault = nullptr;
      EXPECT_EQ(code.has_value(), failed);
      const ErrorCode expected = error == ENOSPC ? ErrorCode::out_of_budget : ErrorCode::unavailable;
      EXPECT_EQ(code.value_or(expected), expected);
      EXPECT_EQ(get(opened.files, system('a')), text);
      EXPECT_EQ(get(opened.files, system('b')).value_or(text), text);
      EXPECT_LE(disk.files(opened.directory.bases()).size(), 2u);
    }
  }
}

TEST_F(BasisFilesTest, the_oldest_give_way_to_new_ones_and_to_what_the_disk_has_no_room_for) {
  SimulatedDisk disk(SimulatedDisk::empty());
  Opened opened(disk, 3 * 10'064);
  EXPECT_EQ(error_of([&] { put(opened.files, system('9'), content(40'000)); }), ErrorCode::out_of_budget);
  for (const char name : {'a', 'b', 'c', 'd'}) put(opened.files, system(name), content(10'000));
  EXPECT_EQ(opened.files.bytes(), 3 * 10'064u);
  EXPECT_TRUE(opened.files.contains(system('d')));
  const std::uint64_t free = opened.space.free() - opened.space.keep_free();
  opened.files.make_room(free + 40'000);
  EXPECT_EQ(opened.files.bytes(), 3 * 10'064u) << "all of them would not be enough";
  opened.files.make_room(free);
  EXPECT_EQ(opened.files.bytes(), 3 * 10'064u) << "there is room";
  opened.files.make_room(free + 15'000);
  EXPECT_EQ(opened.files.bytes(), 10'064u);
  disk.capacity = disk.used() + (1 << 16) + 5'000;
  EXPECT_EQ(error_of([&] { put(opened.files, system('e'), content(10'000)); }), ErrorCode::out_of_budget);
  EXPECT_EQ(opened.files.bytes(), 10'064u) << "they do not give way to their like where the disk is full";
}

TEST_F(BasisFilesTest, who_is_told_to_stop_leaves_nothing) {
  SimulatedDisk disk(SimulatedDisk::empty());
  Opened opened(disk, 1 << 20);
  std::stop_source stop;
  stop.request_stop();
  RunContext context;
  context.stop = stop.get_token();
  EXPECT_EQ(error_of([&] { put(opened.files, system('a'), content(10), context); }), ErrorCode::cancelled);
  EXPECT_TRUE(disk.files(opened.directory.bases()).empty());
}

TEST_F(BasisFilesTest, only_abandoned_parts_are_swept) {
  const TemporaryDirectory temporary;
  StoreDirectory directory(temporary.path() / "data", StoreDirectory::Accept::stores, system_files());
  const DiskSpace space(directory.root(), directory.reserve(), {}, system_files());
  BasisFiles files(directory, space, 1 << 20);
  // A tenant may have such a name.
  const OwnedId odd = system('a', "basis.part.x");
  put(files, odd, content(10));
  const auto touch = [&](const std::string& name, std::chrono::hours age) {
    const auto path = directory.bases() / name;
    const File file(system_files(), path, O_WRONLY | O_CREAT);
    std::filesystem::last_write_time(path, std::filesystem::file_time_type::clock::now() - age);
    return path;
  };
  const std::string id(64, 'a');
  const auto old_part = touch(id + ".basis.part.0123.1", std::chrono::hours(30));
  const auto new_part = touch(id + ".basis.part.4567.1", std::chrono::hours(1));
  const auto other = touch("notes.part.1", std::chrono::hours(30));
  files.sweep(BasisFiles::Alone::no);
  EXPECT_FALSE(std::filesystem::exists(old_part));
  EXPECT_TRUE(std::filesystem::exists(new_part)) << "another server may write it";
  files.sweep(BasisFiles::Alone::yes);
  EXPECT_FALSE(std::filesystem::exists(new_part));
  EXPECT_TRUE(std::filesystem::exists(other));
  EXPECT_EQ(get(files, odd), content(10));
}

}  // namespace
}  // namespace deform::server::basis_files_test
