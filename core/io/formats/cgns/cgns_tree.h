// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <mutex>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "core/io/formats/containers/container_file.h"

namespace deform::io {

/// The nodes of a CGNS file in ADF or HDF5, read through the lowest layer of libcgns (cgio). That layer returns names, types and
/// sizes before any data, so that sizes are checked before anything is allocated; the layer above allocates first and terminates
/// the process on failure. It also reads files of later versions of CGNS, whose new nodes this reader handles itself. Holds the
/// lock of the containers during its lifetime. Throws Error(invalid_argument) naming file and node.
class CgnsTree {
 public:
  enum class Access { read, modify };
  struct Node {
    double id = 0;
    std::string path, name, label;
    bool link = false;  ///< link to another node, possibly in another file; its label is empty if that is not found
  };

  /// `name` is used in errors. Unlinks `file`.
  CgnsTree(ContainerFile& file, std::size_t bytes, std::string name, Access access);
  ~CgnsTree();
  CgnsTree(const CgnsTree&) = delete;
  CgnsTree& operator=(const CgnsTree&) = delete;

  /// Writes pending data and closes the file. Write errors are reported only here.
  void close();

  Node root() const;
  /// The children in the order of the file.
  std::vector<Node> children(const Node& parent) const;
  std::vector<Node> children(const Node& parent, std::string_view label) const;
  std::optional<Node> child(const Node& parent, std::string_view name) const;
  Node at(const std::string& path) const;

  /// "MT", "I4", "I8", "R4", "R8", "C1", ...
  std::string type(const Node& node) const;
  /// The dimensions, fastest first; empty for a node without data.
  std::vector<std::int64_t> dimensions(const Node& node) const;

  std::vector<std::int64_t> integers(const Node& node) const;
  std::vector<double> reals(const Node& node) const;
  /// The text of a node without trailing blanks.
  std::string text(const Node& node) const;

  /// Overwrites all data of a node of type R4 or R8 with as many values, in its own type.
  void overwrite(const Node& node, std::span<const double> values);

  [[noreturn]] void fail(const Node& node, const std::string& what) const;

 private:
  /// Throws with the message of the library.
  void check(int status, const Node& node, const char* what) const;
  void refuse_link(const Node& node) const;
  /// The number of entries of a node, of `size` bytes each; throws if the file is too small for them.
  std::size_t entries(const Node& node, std::size_t size) const;

  const std::unique_lock<std::mutex> lock_;
  const std::string name_;
  std::uint64_t most_bytes_ = 0;
  int file_ = 0;
  bool open_ = false;
};

}  // namespace deform::io
