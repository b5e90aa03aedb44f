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

/// The nodes of a CGNS file in either container, ADF or HDF5, read through the lowest layer of libcgns (cgio): it hands over
/// names, types and sizes before any data, so that what a file claims is checked before anything is allocated; the layer above
/// would allocate first and end the process where that fails. It also reads files of later versions of CGNS, whose new nodes this
/// reader knows itself. Holds the lock of the containers while it lives. Errors are Error(invalid_argument) naming file and node.
class CgnsTree {
 public:
  enum class Access { read, modify };
  struct Node {
    double id = 0;
    std::string path, name, label;
    bool link = false;  ///< to a node elsewhere, perhaps in another file; without a label when that is not found
  };

  /// `name` stands in errors. `file` loses its name.
  CgnsTree(ContainerFile& file, std::size_t bytes, std::string name, Access access);
  ~CgnsTree();
  CgnsTree(const CgnsTree&) = delete;
  CgnsTree& operator=(const CgnsTree&) = delete;

  /// Writes what is not yet written and gives up the file; errors are only seen here.
  void close();

  Node root() const;
  /// In the order of the file.
  std::vector<Node> children(const Node& parent) const;
  std::vector<Node> children(const Node& parent, std::string_view label) const;
  std::optional<Node> child(const Node& parent, std::string_view name) const;
  Node at(const std::string& path) const;

  /// "MT", "I4", "I8", "R4", "R8", "C1", ...
  std::string type(const Node& node) const;
  /// The first varies fastest; empty for a node without data.
  std::vector<std::int64_t> dimensions(const Node& node) const;

  std::vector<std::int64_t> integers(const Node& node) const;
  std::vector<double> reals(const Node& node) const;
  /// Without the blanks behind it.
  std::string text(const Node& node) const;

  /// Of all data, with the node's own type, which is R4 or R8; the size must be the same.
  void overwrite(const Node& node, std::span<const double> values);

  [[noreturn]] void fail(const Node& node, const std::string& what) const;

 private:
  /// The library's own words.
  void check(int status, const Node& node, const char* what) const;
  void refuse_link(const Node& node) const;
  /// The number of a node's entries, of `size` bytes each; throws when the file cannot hold them.
  std::size_t entries(const Node& node, std::size_t size) const;

  const std::unique_lock<std::mutex> lock_;
  const std::string name_;
  std::uint64_t most_bytes_ = 0;
  int file_ = 0;
  bool open_ = false;
};

}  // namespace deform::io
