// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <random>
#include <string>
#include <vector>

#include "server/store/file_system.h"

struct sqlite3_vfs;

namespace deform::server {

/// A disk in memory that tells what is durable from what was only written. Until a file is synced, each of its writes may be
/// lost, kept, or torn between sectors of 512 bytes or pages of 4 KiB, whatever becomes of other files. Until a directory is
/// synced, each change of its names (a rename is one change of two directories) may be lost or kept, whatever becomes of the
/// others. One thread. SQLite works on it, too, by a VFS of its own.
class SimulatedDisk : public FileSystem {
 public:
  /// What the disk holds. Copies are cheap: they share the nodes that stay as they are.
  struct Write {
    std::uint64_t offset = 0;
    std::string data;
    bool cuts = false;  ///< the file ends at the offset
  };
  struct Node {
    bool directory = false;
    std::string content, durable;
    std::vector<Write> pending;                            ///< from `durable` to `content`, but for what a failed sync dropped
    std::map<std::string, std::uint64_t> entries, synced;  ///< of a directory
  };
  struct Edit {
    std::uint64_t directory = 0;
    std::string name;
    std::uint64_t node = 0;  ///< 0: the name is gone
  };
  struct State {
    std::map<std::uint64_t, std::shared_ptr<const Node>> nodes;
    std::vector<std::vector<Edit>> changes;  ///< of names, not durable yet
    std::uint64_t next = 2;                  ///< 1 is the root
  };
  enum class Survival {
    durable,  ///< only what was synced
    all,      ///< as a killed process leaves it
    names,    ///< names, but no content that was not synced
    content,  ///< content, but no names that were not synced
    random    ///< any part
  };
  static State after_crash(const State& state, Survival survival, std::mt19937_64& random);
  static State empty();

  explicit SimulatedDisk(State state, std::uint64_t seed = 0);
  ~SimulatedDisk() override;
  SimulatedDisk(const SimulatedDisk&) = delete;
  SimulatedDisk& operator=(const SimulatedDisk&) = delete;

  const State& state() const { return state_; }

  // ---- faults ----
  /// Operations that change something or make it durable, so far.
  std::uint64_t changes() const { return changes_; }
  /// From this change on nothing happens any more: the machine has stopped.
  std::uint64_t stops_at = UINT64_MAX;
  bool stopped() const { return stopped_; }
  /// Called before each change.
  std::function<void()> before_change;
  /// The error of a call (false: of one that only reads), 0 for none. A failed sync drops what was to be synced.
  std::function<int(bool changing)> fault;
  std::uint64_t capacity = std::uint64_t{1} << 30;
  std::uint64_t used() const;
  /// All files below a folder with their sizes.
  std::map<std::string, std::uint64_t> files(const Path& folder) const;
  /// In what is durable; the file must be that long.
  void flip_bit(const Path& file, std::uint64_t bit);

  // ---- FileSystem ----
  int open(const Path& path, int flags) override;
  ssize_t write(int descriptor, const void* data, std::size_t size) override;
  ssize_t read(int descriptor, void* data, std::size_t size) override;
  int sync(int descriptor) override;
  int sync_all(int descriptor) override;
  int allocate(int descriptor, std::uint64_t size) override;
  int truncate(int descriptor, std::uint64_t size) override;
  int lock(int descriptor) override;
  int lock_shared(int descriptor) override;
  int close(int descriptor) override;
  int rename(const Path& from, const Path& to) override;
  int link(const Path& file, const Path& name) override;
  int remove(const Path& path) override;
  int make_directory(const Path& path) override;
  int close_to_others(const Path& path) override;
  int status(const Path& path, Links links, struct stat& status) override;
  int list(const Path& directory, std::vector<std::string>& names) override;
  bool is_writable(const Path& path) override;
  std::optional<std::uint64_t> free_bytes(const Path& directory) override;
  const char* sqlite_vfs() const override { return vfs_name_.c_str(); }

  // ---- for the VFS ----
  ssize_t write_at(std::uint64_t node, const void* data, std::size_t size, std::uint64_t offset);
  ssize_t read_at(std::uint64_t node, void* data, std::size_t size, std::uint64_t offset);
  int truncate_node(std::uint64_t node, std::uint64_t size);
  int sync_node(std::uint64_t node);
  std::uint64_t node_of(int descriptor) const { return open_.at(descriptor).node; }
  std::uint64_t size_of(std::uint64_t node) const { return state_.nodes.at(node)->content.size(); }
  std::uint64_t random() { return random_(); }
  /// Locks and memory that SQLite's connections to one file share.
  struct Shared {
    int readers = 0;
    const void *reserved = nullptr, *exclusive = nullptr;
    int connections = 0;
    std::vector<std::unique_ptr<char[]>> regions;
    int shared_locks[8] = {};
    const void* exclusive_locks[8] = {};
  };
  Shared& shared(std::uint64_t node) { return shared_[node]; }

 private:
  enum class Lock { none, shared, alone };
  struct Open {
    std::uint64_t node = 0, offset = 0;
    Lock lock = Lock::none;
  };
  struct Locks {
    int shared = 0, alone = 0;
  };
  bool fails(bool changing);
  int changed(std::vector<Edit> edits);
  std::uint64_t find(const Path& path) const;
  std::uint64_t parent(const Path& path) const;
  Node& edit(std::uint64_t node);
  void forget_unused();

  State state_;
  std::map<int, Open> open_;
  std::map<std::uint64_t, Locks> locked_;  // by node
  std::map<std::uint64_t, Shared> shared_;
  std::mt19937_64 random_;
  std::uint64_t changes_ = 0;
  bool stopped_ = false;
  int next_descriptor_ = 3;
  std::string vfs_name_;
  std::unique_ptr<sqlite3_vfs> vfs_;
};

/// Makes SQLite know the disk under that name.
std::unique_ptr<sqlite3_vfs> register_vfs(SimulatedDisk& disk, const char* name);

}  // namespace deform::server
