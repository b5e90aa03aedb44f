// SPDX-License-Identifier: Apache-2.0
#include "core/io/formats/cgns/cgns_tree.h"

#include <cgns_io.h>

#include <array>
#include <cstring>

#include "core/base/error.h"

namespace deform::io {

namespace {

// The largest compression ratio of deflate, with an allowance for the file itself. ADF does not compress.
constexpr std::uint64_t best_compression = 1100;
// The limits of texts in the library apply to writing; damaged ADF nodes may have longer ones.
constexpr std::size_t text_size = 1024;

std::string library_message() {
  std::array<char, text_size> text{};
  cgio_error_message(text.data());
  return text.data();
}

template <typename T>
std::vector<T> entries_of(const std::vector<char>& bytes) {
  std::vector<T> values(bytes.size() / sizeof(T));
  if (!values.empty()) std::memcpy(values.data(), bytes.data(), values.size() * sizeof(T));
  return values;
}

template <typename Wanted, typename T>
std::vector<Wanted> converted(const std::vector<char>& bytes) {
  const std::vector<T> values = entries_of<T>(bytes);
  return {values.begin(), values.end()};
}

}  // namespace

CgnsTree::CgnsTree(ContainerFile& file, std::size_t bytes, std::string name, Access access)
    : lock_(lock_containers()), name_(std::move(name)) {
  const int mode = access == Access::read ? CGIO_MODE_READ : CGIO_MODE_MODIFY;
  int kind = CGIO_FILE_NONE;
  if (cgio_check_file(file.path().c_str(), &kind) != CGIO_ERR_NONE || kind == CGIO_FILE_NONE) {
    throw Error(ErrorCode::invalid_argument, name_ + ": expected a CGNS file, in a container of ADF or HDF5");
  }
  if (cgio_open_file(file.path().c_str(), mode, kind, &file_) != CGIO_ERR_NONE) {
    throw Error(ErrorCode::invalid_argument, name_ + ": cannot be opened as a CGNS file: " + library_message());
  }
  open_ = true;
  file.unlink();
  most_bytes_ = kind == CGIO_FILE_HDF5 ? bytes * best_compression : bytes;
}

CgnsTree::~CgnsTree() {
  if (open_) cgio_close_file(file_);
}

void CgnsTree::close() {
  open_ = false;
  check(cgio_close_file(file_), {}, "closing the file");
}

void CgnsTree::fail(const Node& node, const std::string& what) const {
  throw Error(ErrorCode::invalid_argument, name_ + ": " + (node.path.empty() ? "" : node.path + ": ") + what);
}

void CgnsTree::check(int status, const Node& node, const char* what) const {
  if (status != CGIO_ERR_NONE) fail(node, std::string(what) + ": " + library_message());
}

CgnsTree::Node CgnsTree::root() const {
  Node node;
  check(cgio_get_root_id(file_, &node.id), node, "the root");
  return node;
}

std::vector<CgnsTree::Node> CgnsTree::children(const Node& parent) const {
  refuse_link(parent);
  int count = 0;
  check(cgio_number_children(file_, parent.id, &count), parent, "the number of nodes");
  if (count < 0 || static_cast<std::uint64_t>(count) > most_bytes_) fail(parent, "more nodes than the file has bytes");
  std::vector<double> ids(static_cast<std::size_t>(count));
  int got = 0;
  if (count > 0) check(cgio_children_ids(file_, parent.id, 1, count, &got, ids.data()), parent, "the nodes");
  ids.resize(static_cast<std::size_t>(got));
  std::vector<Node> result;
  for (const double id : ids) {
    std::array<char, text_size> name{};
    std::array<char, text_size> label{};
    int link = 0;
    check(cgio_get_name(file_, id, name.data()), parent, "the name of a node");
    check(cgio_is_link(file_, id, &link), parent, "a node");
    // The label of a link is that of its target, which may be missing.
    if (cgio_get_label(file_, id, label.data()) != CGIO_ERR_NONE && link == 0)
      fail(parent, "the label of a node: " + library_message());
    result.push_back({id, parent.path + "/" + name.data(), name.data(), label.data(), link != 0});
  }
  return result;
}

std::vector<CgnsTree::Node> CgnsTree::children(const Node& parent, std::string_view label) const {
  std::vector<Node> result;
  for (Node& node : children(parent)) {
    if (node.label == label) result.push_back(std::move(node));
  }
  return result;
}

std::optional<CgnsTree::Node> CgnsTree::child(const Node& parent, std::string_view name) const {
  for (Node& node : children(parent)) {
    if (node.name == name) return std::move(node);
  }
  return std::nullopt;
}

CgnsTree::Node CgnsTree::at(const std::string& path) const {
  Node node{0, path, {}, {}};
  check(cgio_get_node_id(file_, root().id, path.c_str(), &node.id), node, "the node");
  return node;
}

void CgnsTree::refuse_link(const Node& node) const {
  if (node.link) fail(node, "this is a link; meshes that lie in several files or nodes are not supported");
}

std::string CgnsTree::type(const Node& node) const {
  refuse_link(node);
  std::array<char, text_size> text{};
  check(cgio_get_data_type(file_, node.id, text.data()), node, "the type of the data");
  return text.data();
}

std::vector<std::int64_t> CgnsTree::dimensions(const Node& node) const {
  refuse_link(node);
  int count = 0;
  std::array<cgsize_t, CGIO_MAX_DIMENSIONS> values{};
  check(cgio_get_dimensions(file_, node.id, &count, values.data()), node, "the size of the data");
  if (count < 0 || count > CGIO_MAX_DIMENSIONS) fail(node, "the data have " + std::to_string(count) + " dimensions");
  return {values.begin(), values.begin() + count};
}

std::size_t CgnsTree::entries(const Node& node, std::size_t size) const {
  const auto lengths = dimensions(node);
  std::uint64_t count = lengths.empty() ? 0 : 1;
  for (const std::int64_t length : lengths) {
    if (length < 0 || (length > 0 && count > most_bytes_ / size / static_cast<std::uint64_t>(length))) {
      fail(node,
           "the data are said to have " + std::to_string(length) + " entries along a dimension, more than the file can hold");
    }
    count *= static_cast<std::uint64_t>(length);
  }
  return static_cast<std::size_t>(count);
}

std::vector<std::int64_t> CgnsTree::integers(const Node& node) const {
  const std::string kind = type(node);
  if (kind == "MT") return {};
  if (kind != "I4" && kind != "I8" && kind != "U4" && kind != "U8") fail(node, "expected integers, found data of type " + kind);
  std::vector<char> bytes(entries(node, kind[1] == '4' ? 4 : 8) * (kind[1] == '4' ? 4 : 8));
  if (bytes.empty()) return {};
  check(cgio_read_all_data(file_, node.id, bytes.data()), node, "reading the data");
  if (kind[1] == '8') return entries_of<std::int64_t>(bytes);  // beyond 2^63: negative, and so out of every range
  return kind == "I4" ? converted<std::int64_t, std::int32_t>(bytes) : converted<std::int64_t, std::uint32_t>(bytes);
}

std::vector<double> CgnsTree::reals(const Node& node) const {
  const std::string kind = type(node);
  if (kind != "R4" && kind != "R8") fail(node, "expected real numbers, found data of type " + kind);
  std::vector<char> bytes(entries(node, kind == "R4" ? 4 : 8) * (kind == "R4" ? 4 : 8));
  if (bytes.empty()) return {};
  check(cgio_read_all_data(file_, node.id, bytes.data()), node, "reading the data");
  return kind == "R8" ? entries_of<double>(bytes) : converted<double, float>(bytes);
}

std::string CgnsTree::text(const Node& node) const {
  const std::string kind = type(node);
  if (kind == "MT") return {};
  if (kind != "C1") fail(node, "expected text, found data of type " + kind);
  std::string text(entries(node, 1), '\0');
  if (text.empty()) return {};
  check(cgio_read_all_data(file_, node.id, text.data()), node, "reading the data");
  text.resize(std::strlen(text.c_str()));
  text.erase(text.find_last_not_of(' ') + 1);
  return text;
}

void CgnsTree::overwrite(const Node& node, std::span<const double> values) {
  if (type(node) == "R8") {
    return check(cgio_write_all_data(file_, node.id, values.data()), node, "writing the data");
  }
  const std::vector<float> narrow(values.begin(), values.end());
  check(cgio_write_all_data(file_, node.id, narrow.data()), node, "writing the data");
}

}  // namespace deform::io
