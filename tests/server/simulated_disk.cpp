// SPDX-License-Identifier: GPL-3.0-or-later
#include "tests/server/simulated_disk.h"

#include <fcntl.h>
#include <sqlite3.h>

#include <algorithm>
#include <atomic>
#include <cerrno>
#include <cstring>
#include <set>
#include <utility>

namespace deform::server {

namespace {

constexpr std::uint64_t root = 1;
constexpr std::uint64_t block = 4096;

int failed(int error) {
  errno = error;
  return -1;
}

void replay(std::string& content, const SimulatedDisk::Write& write) {
  if (write.cuts) {
    content.resize(write.offset);
    return;
  }
  if (content.size() < write.offset + write.data.size()) content.resize(write.offset + write.data.size());
  content.replace(write.offset, write.data.size(), write.data);
}

/// Some sectors of a write; the file may have grown to its end all the same, with zeros.
void replay_torn(std::string& content, const SimulatedDisk::Write& write, std::mt19937_64& random) {
  const std::uint64_t sector = random() % 2 == 0 ? 512 : block;
  const bool in_order = random() % 2 == 0;
  const std::uint64_t end = write.offset + write.data.size();
  if (random() % 2 == 0 && content.size() < end) content.resize(end);
  for (std::uint64_t at = write.offset; at < end;) {
    const std::uint64_t next = std::min(end, (at / sector + 1) * sector);
    if (random() % 2 == 0) {
      replay(content, {at, write.data.substr(at - write.offset, next - at), false});
    } else if (in_order) {
      return;
    }
    at = next;
  }
}

std::string survivor(const SimulatedDisk::Node& node, SimulatedDisk::Survival survival, std::mt19937_64& random) {
  using Survival = SimulatedDisk::Survival;
  std::string content = node.durable;
  if (survival == Survival::durable || survival == Survival::names) return content;
  // All or nothing of a file is as likely as a part.
  const std::uint64_t of_file = survival == Survival::random ? random() % 3 : 1;
  if (of_file == 0) return content;
  for (const auto& write : node.pending) {
    if (of_file == 1) {
      replay(content, write);
      continue;
    }
    const std::uint64_t fate = random() % 3;
    if (fate == 1) replay(content, write);
    if (fate == 2 && !write.cuts) replay_torn(content, write, random);
  }
  return content;
}

}  // namespace

// ---- what a crash leaves ----

SimulatedDisk::State SimulatedDisk::empty() {
  Node node;
  node.directory = true;
  State state;
  state.nodes[root] = std::make_shared<const Node>(std::move(node));
  return state;
}

SimulatedDisk::State SimulatedDisk::after_crash(const State& state, Survival survival, std::mt19937_64& random) {
  std::map<std::uint64_t, Node> nodes;
  for (const auto& [id, node] : state.nodes) {
    Node left;
    left.directory = node->directory;
    left.entries = node->synced;
    if (!node->directory) left.content = left.durable = survivor(*node, survival, random);
    nodes[id] = std::move(left);
  }
  for (const auto& change : state.changes) {
    const bool kept =
        survival == Survival::all || survival == Survival::names || (survival == Survival::random && random() % 2 == 0);
    if (!kept) continue;
    for (const auto& edit : change) {
      auto& entries = nodes[edit.directory].entries;
      if (edit.node == 0) {
        entries.erase(edit.name);
      } else {
        entries[edit.name] = edit.node;
      }
    }
  }
  State left;
  left.next = state.next;
  std::vector<std::uint64_t> reached = {root};
  while (!reached.empty()) {
    const std::uint64_t id = reached.back();
    reached.pop_back();
    if (left.nodes.count(id) > 0) continue;
    Node& node = nodes.at(id);
    node.synced = node.entries;
    for (const auto& [name, child] : node.entries) reached.push_back(child);
    left.nodes[id] = std::make_shared<const Node>(std::move(node));
  }
  return left;
}

// ---- the disk ----

SimulatedDisk::SimulatedDisk(State state, std::uint64_t seed) : state_(std::move(state)), random_(seed) {
  static std::atomic<std::uint64_t> number{0};
  vfs_name_ = "simulated-" + std::to_string(number++);
  vfs_ = register_vfs(*this, vfs_name_.c_str());
}

SimulatedDisk::~SimulatedDisk() { sqlite3_vfs_unregister(vfs_.get()); }

/// Counts and decides; errno is set when the call fails.
bool SimulatedDisk::fails(bool changing) {
  if (changing && !stopped_) {
    if (before_change) before_change();
    if (++changes_ >= stops_at) stopped_ = true;
  }
  errno = stopped_ ? EIO : (fault ? fault(changing) : 0);
  return errno != 0;
}

SimulatedDisk::Node& SimulatedDisk::edit(std::uint64_t node) {
  auto& shared = state_.nodes.at(node);
  auto copy = std::make_shared<Node>(*shared);
  Node& edited = *copy;
  shared = std::move(copy);
  return edited;
}

std::uint64_t SimulatedDisk::find(const Path& path) const {
  std::uint64_t at = root;
  for (const auto& part : path.relative_path()) {
    if (part.empty() || part == ".") continue;
    const Node& node = *state_.nodes.at(at);
    const auto found = node.entries.find(part.string());
    if (!node.directory || found == node.entries.end()) return 0;
    at = found->second;
  }
  return at;
}

std::uint64_t SimulatedDisk::parent(const Path& path) const {
  const std::uint64_t node = find(path.parent_path());
  return node != 0 && state_.nodes.at(node)->directory ? node : 0;
}

int SimulatedDisk::changed(std::vector<Edit> edits) {
  for (const auto& change : edits) {
    auto& entries = edit(change.directory).entries;
    if (change.node == 0) {
      entries.erase(change.name);
    } else {
      entries[change.name] = change.node;
    }
  }
  state_.changes.push_back(std::move(edits));
  forget_unused();
  return 0;
}

/// Nodes that no name leads to, now or after a crash, and that nobody has open.
void SimulatedDisk::forget_unused() {
  std::set<std::uint64_t> used = {root};
  for (const auto& [id, node] : state_.nodes) {
    for (const auto& [name, child] : node->entries) used.insert(child);
    for (const auto& [name, child] : node->synced) used.insert(child);
  }
  for (const auto& change : state_.changes) {
    for (const auto& edit : change) used.insert({edit.node, edit.directory});
  }
  for (const auto& [descriptor, open] : open_) used.insert(open.node);
  std::erase_if(state_.nodes, [&](const auto& entry) { return used.count(entry.first) == 0; });
}

std::uint64_t SimulatedDisk::used() const {
  std::set<std::uint64_t> held;
  for (const auto& [id, node] : state_.nodes) {
    for (const auto& [name, child] : node->entries) held.insert(child);
  }
  for (const auto& [descriptor, open] : open_) held.insert(open.node);
  std::uint64_t bytes = 0;
  for (const std::uint64_t id : held) bytes += (state_.nodes.at(id)->content.size() + block - 1) / block * block;
  return bytes;
}

std::map<std::string, std::uint64_t> SimulatedDisk::files(const Path& folder) const {
  std::map<std::string, std::uint64_t> found;
  const std::uint64_t id = find(folder);
  if (id == 0) return found;
  for (const auto& [name, child] : state_.nodes.at(id)->entries) {
    if (state_.nodes.at(child)->directory) {
      found.merge(files(folder / name));
    } else {
      found[(folder / name).string()] = size_of(child);
    }
  }
  return found;
}

void SimulatedDisk::flip_bit(const Path& file, std::uint64_t bit) {
  Node& node = edit(find(file));
  for (std::string* bytes : {&node.content, &node.durable}) {
    if (bit / 8 < bytes->size()) (*bytes)[bit / 8] = static_cast<char>((*bytes)[bit / 8] ^ (1 << (bit % 8)));
  }
}

// ---- open files ----

int SimulatedDisk::open(const Path& path, int flags) {
  std::uint64_t node = find(path);
  const bool creates = node == 0 && (flags & O_CREAT) != 0;
  if (fails(creates)) return -1;
  if (node != 0 && (flags & O_EXCL) != 0) return failed(EEXIST);
  if (node == 0 && !creates) return failed(ENOENT);
  if (creates) {
    const std::uint64_t directory = parent(path);
    if (directory == 0) return failed(ENOENT);
    node = state_.next++;
    state_.nodes[node] = std::make_shared<const Node>();
    changed({{directory, path.filename().string(), node}});
  } else if (state_.nodes.at(node)->directory != ((flags & O_DIRECTORY) != 0)) {
    return failed((flags & O_DIRECTORY) != 0 ? ENOTDIR : EISDIR);
  } else if ((flags & O_TRUNC) != 0 && truncate_node(node, 0) != 0) {
    return -1;
  }
  open_[next_descriptor_] = {node, 0, Lock::none};
  return next_descriptor_++;
}

ssize_t SimulatedDisk::write(int descriptor, const void* data, std::size_t size) {
  Open& open = open_.at(descriptor);
  const ssize_t written = write_at(open.node, data, size, open.offset);
  if (written > 0) open.offset += static_cast<std::uint64_t>(written);
  return written;
}

ssize_t SimulatedDisk::read(int descriptor, void* data, std::size_t size) {
  Open& open = open_.at(descriptor);
  const ssize_t got = read_at(open.node, data, size, open.offset);
  if (got > 0) open.offset += static_cast<std::uint64_t>(got);
  return got;
}

ssize_t SimulatedDisk::write_at(std::uint64_t node, const void* data, std::size_t size, std::uint64_t offset) {
  if (fails(true)) return -1;
  const std::uint64_t has = (size_of(node) + block - 1) / block * block;
  const std::uint64_t most = has + free_bytes("/").value_or(0);
  if (offset >= most && size > 0) return failed(ENOSPC);
  size = std::min<std::size_t>(size, most - offset);
  Write write{offset, std::string(static_cast<const char*>(data), size), false};
  Node& written = edit(node);
  replay(written.content, write);
  written.pending.push_back(std::move(write));
  return static_cast<ssize_t>(size);
}

ssize_t SimulatedDisk::read_at(std::uint64_t node, void* data, std::size_t size, std::uint64_t offset) {
  if (fails(false)) return -1;
  const std::string& content = state_.nodes.at(node)->content;
  if (offset >= content.size()) return 0;
  size = std::min<std::size_t>(size, content.size() - offset);
  std::memcpy(data, content.data() + offset, size);
  return static_cast<ssize_t>(size);
}

int SimulatedDisk::sync(int descriptor) { return sync_node(node_of(descriptor)); }

int SimulatedDisk::sync_node(std::uint64_t node) {
  if (fails(true)) {
    const int error = errno;
    edit(node).pending.clear();  // they stay readable, and no later sync writes them
    return failed(error);
  }
  Node& synced = edit(node);
  if (synced.directory) {
    // Whole changes: a rename is durable in both directories or in none.
    std::vector<std::vector<Edit>> left;
    const auto settle = [&](const Edit& settled) {  // what was done to that name before
      for (auto& change : left) {
        std::erase_if(change, [&](const Edit& e) { return e.directory == settled.directory && e.name == settled.name; });
      }
    };
    for (auto& change : state_.changes) {
      const bool here = std::any_of(change.begin(), change.end(), [&](const Edit& e) { return e.directory == node; });
      if (!here) {
        left.push_back(std::move(change));
        continue;
      }
      for (const auto& e : change) {
        settle(e);
        auto& entries = (e.directory == node ? synced : edit(e.directory)).synced;
        if (e.node == 0) {
          entries.erase(e.name);
        } else {
          entries[e.name] = e.node;
        }
      }
    }
    state_.changes = std::move(left);
    forget_unused();
    return 0;
  }
  for (const auto& write : synced.pending) replay(synced.durable, write);
  synced.pending.clear();
  return 0;
}

int SimulatedDisk::sync_all(int) {
  if (fails(true)) return -1;
  for (auto& [id, shared] : state_.nodes) {
    auto node = std::make_shared<Node>(*shared);
    for (const auto& write : node->pending) replay(node->durable, write);
    node->pending.clear();
    node->synced = node->entries;
    shared = std::move(node);
  }
  state_.changes.clear();
  forget_unused();
  return 0;
}

int SimulatedDisk::allocate(int descriptor, std::uint64_t size) {
  if (fails(true)) return -1;
  const std::uint64_t node = node_of(descriptor), has = size_of(node);
  if (size <= has) return 0;
  if (size - has > free_bytes("/").value_or(0)) return failed(ENOSPC);
  Write write{has, std::string(size - has, '\0'), false};
  Node& grown = edit(node);
  replay(grown.content, write);
  grown.pending.push_back(std::move(write));
  return 0;
}

int SimulatedDisk::truncate(int descriptor, std::uint64_t size) { return truncate_node(node_of(descriptor), size); }

int SimulatedDisk::truncate_node(std::uint64_t node, std::uint64_t size) {
  if (fails(true)) return -1;
  Node& cut = edit(node);
  Write write{size, {}, true};
  replay(cut.content, write);
  cut.pending.push_back(std::move(write));
  return 0;
}

int SimulatedDisk::lock(int descriptor) {
  if (fails(false)) return -1;
  Open& open = open_.at(descriptor);
  Locks& locks = locked_[open.node];
  if (locks.alone > 0 || locks.shared > 0) return failed(EWOULDBLOCK);
  ++locks.alone;
  open.lock = Lock::alone;
  return 0;
}

int SimulatedDisk::lock_shared(int descriptor) {
  if (fails(false)) return -1;
  Open& open = open_.at(descriptor);
  Locks& locks = locked_[open.node];
  if (locks.alone > 0) return failed(EWOULDBLOCK);
  ++locks.shared;
  open.lock = Lock::shared;
  return 0;
}

int SimulatedDisk::close(int descriptor) {
  const auto found = open_.find(descriptor);
  if (found == open_.end()) return failed(EBADF);
  Locks& locks = locked_[found->second.node];
  if (found->second.lock == Lock::alone) --locks.alone;
  if (found->second.lock == Lock::shared) --locks.shared;
  open_.erase(found);
  return 0;
}

// ---- names ----

int SimulatedDisk::rename(const Path& from, const Path& to) {
  if (fails(true)) return -1;
  const std::uint64_t node = find(from), source = parent(from), target = parent(to);
  if (node == 0 || target == 0) return failed(ENOENT);
  if (node == find(to)) return 0;  // two links to one file: nothing is done
  return changed({{target, to.filename().string(), node}, {source, from.filename().string(), 0}});
}

int SimulatedDisk::link(const Path& file, const Path& name) {
  if (fails(true)) return -1;
  const std::uint64_t node = find(file), target = parent(name);
  if (node == 0 || target == 0) return failed(ENOENT);
  if (find(name) != 0) return failed(EEXIST);
  return changed({{target, name.filename().string(), node}});
}

int SimulatedDisk::remove(const Path& path) {
  const std::uint64_t node = find(path);
  if (fails(node != 0)) return -1;
  if (node == 0) return failed(ENOENT);
  if (!state_.nodes.at(node)->entries.empty()) return failed(ENOTEMPTY);
  return changed({{parent(path), path.filename().string(), 0}});
}

int SimulatedDisk::make_directory(const Path& path) {
  const bool there = find(path) != 0;
  if (fails(!there)) return -1;
  const std::uint64_t directory = parent(path);
  if (there) return failed(EEXIST);
  if (directory == 0) return failed(ENOENT);
  const std::uint64_t node = state_.next++;
  Node made;
  made.directory = true;
  state_.nodes[node] = std::make_shared<const Node>(std::move(made));
  return changed({{directory, path.filename().string(), node}});
}

int SimulatedDisk::close_to_others(const Path& path) { return find(path) == 0 ? failed(ENOENT) : 0; }

int SimulatedDisk::status(const Path& path, Links, struct stat& status) {
  if (fails(false)) return -1;
  const std::uint64_t id = find(path);
  if (id == 0) return failed(ENOENT);
  const Node& node = *state_.nodes.at(id);
  status = {};
  status.st_ino = id;
  status.st_mode = node.directory ? S_IFDIR | 0700 : S_IFREG | 0640;
  status.st_size = static_cast<off_t>(node.content.size());
  for (const auto& [other, directory] : state_.nodes) {
    for (const auto& [name, child] : directory->entries) status.st_nlink += child == id;
  }
  return 0;
}

int SimulatedDisk::list(const Path& directory, std::vector<std::string>& names) {
  if (fails(false)) return -1;
  const std::uint64_t id = find(directory);
  if (id == 0) return failed(ENOENT);
  if (!state_.nodes.at(id)->directory) return failed(ENOTDIR);
  for (const auto& [name, child] : state_.nodes.at(id)->entries) names.push_back(name);
  return 0;
}

bool SimulatedDisk::is_writable(const Path& path) { return find(path) != 0; }

std::optional<std::uint64_t> SimulatedDisk::free_bytes(const Path&) {
  const std::uint64_t bytes = used();
  return bytes < capacity ? capacity - bytes : 0;
}

}  // namespace deform::server
