// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <gtest/gtest.h>
#include <netcdf.h>
#include <unistd.h>

#include <filesystem>
#include <map>
#include <stdexcept>
#include <string>
#include <vector>

#include "core/base/types.h"
#include "core/io/mesh_file.h"

namespace deform::test {

/// A netCDF file in memory of the test, written in one go.
class NetcdfWriter {
 public:
  struct Variable {
    std::string name;
    std::vector<std::string> dimensions;
    std::vector<long long> integers;
    std::vector<double> reals;
    std::string text;
    std::string elem_type;  ///< attribute
  };

  /// `mode`: 0, NC_64BIT_OFFSET, NC_64BIT_DATA or NC_NETCDF4.
  std::string bytes(int mode, nc_type integer = NC_INT, nc_type real = NC_DOUBLE) const {
    const std::string path =
        (std::filesystem::path(testing::TempDir()) / ("netcdf_" + std::to_string(::getpid()) + ".e")).string();
    int file = 0;
    check(nc_create(path.c_str(), NC_CLOBBER | mode, &file));
    std::map<std::string, int> ids;
    for (const auto& [name, length] : dimensions) check(nc_def_dim(file, name.c_str(), length, &ids[name]));
    std::vector<int> numbers;
    for (const Variable& variable : variables) {
      std::vector<int> along;
      for (const std::string& dimension : variable.dimensions) along.push_back(ids.at(dimension));
      const nc_type type = !variable.text.empty() ? NC_CHAR : variable.reals.empty() ? integer : real;
      int number = 0;
      check(nc_def_var(file, variable.name.c_str(), type, static_cast<int>(along.size()), along.data(), &number));
      if (compressed && type != NC_CHAR && mode == NC_NETCDF4) check(nc_def_var_deflate(file, number, 1, 1, 6));
      const std::string& elements = variable.elem_type;
      if (!elements.empty()) check(nc_put_att_text(file, number, "elem_type", elements.size(), elements.c_str()));
      numbers.push_back(number);
    }
    check(nc_put_att_text(file, NC_GLOBAL, "title", 5, "a cat"));
    check(nc_enddef(file));
    for (std::size_t i = 0; i < variables.size(); ++i) {
      const Variable& variable = variables[i];
      if (!variable.text.empty()) {
        check(nc_put_var_text(file, numbers[i], variable.text.c_str()));
      } else if (!variable.reals.empty()) {
        check(nc_put_var_double(file, numbers[i], variable.reals.data()));
      } else if (!variable.integers.empty()) {
        check(nc_put_var_longlong(file, numbers[i], variable.integers.data()));
      }
    }
    check(nc_close(file));
    const std::string content = io::read_file(path);
    std::filesystem::remove(path);
    return content;
  }

  std::vector<std::pair<std::string, std::size_t>> dimensions;
  std::vector<Variable> variables;
  bool compressed = false;

 private:
  static void check(int status) {
    if (status != NC_NOERR) throw std::runtime_error(nc_strerror(status));
  }
};

/// An Exodus file: blocks, sets, and the names and ids of both.
class ExodusWriter : public NetcdfWriter {
 public:
  enum class Coordinates { together, apart };

  ExodusWriter(const Points& points, std::size_t axes, Coordinates coordinates) {
    dimensions = {{"len_name", 8}, {"num_dim", axes}, {"num_nodes", points.size()}};
    if (coordinates == Coordinates::together) variables.push_back({"coord", {"num_dim", "num_nodes"}, {}, {}, "", ""});
    for (std::size_t axis = 0; axis < axes; ++axis) {
      if (coordinates == Coordinates::apart)
        variables.push_back({std::string("coord") + "xyz" [axis], { "num_nodes" }, {}, {}, "", ""});
      for (const Vec3& p : points) variables.back().reals.push_back(p[axis]);
    }
  }

  /// `nodes` from 1, element by element.
  void block(const std::string& elem_type, std::size_t nodes_of_each, const std::vector<long long>& nodes) {
    const std::string number = std::to_string(++blocks_);
    dimensions.emplace_back("num_el_in_blk" + number, nodes.size() / nodes_of_each);
    dimensions.emplace_back("num_nod_per_el" + number, nodes_of_each);
    variables.push_back({"connect" + number, {"num_el_in_blk" + number, "num_nod_per_el" + number}, nodes, {}, "", elem_type});
  }
  void side_set(const std::vector<long long>& elements, const std::vector<long long>& sides) {
    const std::string number = std::to_string(++side_sets_);
    dimensions.emplace_back("num_side_ss" + number, elements.size());
    variables.push_back({"elem_ss" + number, {"num_side_ss" + number}, elements, {}, "", ""});
    variables.push_back({"side_ss" + number, {"num_side_ss" + number}, sides, {}, "", ""});
  }
  void node_set(const std::vector<long long>& nodes) {
    const std::string number = std::to_string(++node_sets_);
    dimensions.emplace_back("num_nod_ns" + number, nodes.size());
    variables.push_back({"node_ns" + number, {"num_nod_ns" + number}, nodes, {}, "", ""});
  }
  /// `kind`: eb, ss or ns. Names of up to 8 letters; empty ones are left to the reader.
  void names(const std::string& kind, const std::vector<std::string>& list, const std::vector<long long>& ids) {
    std::string text;
    for (const std::string& name : list) text += name + std::string(8 - name.size(), '\0');
    finish();
    const std::string dimension = kind == "eb" ? "num_el_blk" : kind == "ss" ? "num_side_sets" : "num_node_sets";
    variables.push_back({kind + "_names", {dimension, "len_name"}, {}, {}, text, ""});
    variables.push_back({kind + "_prop1", {dimension}, ids, {}, "", ""});
  }
  /// The numbers of blocks and sets, once all are there.
  void finish() {
    if (finished_) return;
    finished_ = true;
    if (blocks_ > 0) dimensions.emplace_back("num_el_blk", blocks_);
    if (side_sets_ > 0) dimensions.emplace_back("num_side_sets", side_sets_);
    if (node_sets_ > 0) dimensions.emplace_back("num_node_sets", node_sets_);
  }

 private:
  std::size_t blocks_ = 0, side_sets_ = 0, node_sets_ = 0;
  bool finished_ = false;
};

}  // namespace deform::test
