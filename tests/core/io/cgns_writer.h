// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cgns_io.h>
#include <cgnslib.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>
#include <functional>
#include <stdexcept>
#include <string>
#include <vector>

#include "core/base/types.h"
#include "core/io/mesh_file.h"

namespace deform::test {

/// A file in the folder of this test run.
inline std::string temporary_path(const std::string& name) {
  return (std::filesystem::path(testing::TempDir()) / ("containers_" + std::to_string(::getpid()) + "_" + name)).string();
}

/// A CGNS file with one base, made by the upper layer of libcgns, of which the reader knows nothing.
class CgnsWriter {
 public:
  using Numbers = std::vector<cgsize_t>;

  explicit CgnsWriter(int container, int cell_dimension = 3, int space = 3)
      : path_(temporary_path("a.cgns")), space_(static_cast<std::size_t>(space)) {
    std::filesystem::remove(path_);
    check(cg_set_file_type(container));
    check(cg_open(path_.c_str(), CG_MODE_WRITE, &file_));
    check(cg_base_write(file_, "Base", cell_dimension, space, &base_));
  }
  ~CgnsWriter() { std::filesystem::remove(path_); }

  int unstructured(const std::string& name, const Points& points, int cells, DataType_t type = RealDouble) {
    const cgsize_t sizes[] = {static_cast<cgsize_t>(points.size()), cells, 0};
    int zone = 0;
    check(cg_zone_write(file_, base_, name.c_str(), sizes, Unstructured, &zone));
    coordinates(zone, points, type);
    return zone;
  }

  int structured(const std::string& name, const Numbers& vertices, const Points& points) {
    Numbers sizes = vertices;
    for (const cgsize_t n : vertices) sizes.push_back(n - 1);
    sizes.resize(3 * vertices.size());
    int zone = 0;
    check(cg_zone_write(file_, base_, name.c_str(), sizes.data(), Structured, &zone));
    coordinates(zone, points, RealDouble);
    return zone;
  }

  /// `nodes` from 1. Numbers of elements go on from those of the sections before.
  void section(int zone, const std::string& name, ElementType_t type, int count, const Numbers& nodes) {
    int section = 0;
    check(cg_section_write(file_, base_, zone, name.c_str(), type, next_, next_ + count - 1, 0, nodes.data(), &section));
    next_ += count;
  }
  int lists(int zone, const std::string& name, ElementType_t type, const Numbers& offsets, const Numbers& entries) {
    int section = 0;
    const auto count = static_cast<cgsize_t>(offsets.size()) - 1;
    check(cg_poly_section_write(file_, base_, zone, name.c_str(), type, next_, next_ + count - 1, 0, entries.data(),
                                offsets.data(), &section));
    next_ += count;
    return section;
  }
  void parents(int zone, int section, const Numbers& parents) {
    check(cg_parent_data_write(file_, base_, zone, section, parents.data()));
  }

  void condition(int zone, const std::string& name, PointSetType_t set, const Numbers& numbers, int count,
                 GridLocation_t location, const std::string& family = "") {
    int condition = 0;
    check(cg_boco_write(file_, base_, zone, name.c_str(), BCWall, set, count, numbers.data(), &condition));
    if (location != Vertex) check(cg_boco_gridlocation_write(file_, base_, zone, condition, location));
    if (family.empty()) return;
    check(cg_goto(file_, base_, "Zone_t", zone, "ZoneBC_t", 1, "BC_t", condition, "end"));
    check(cg_famname_write(family.c_str()));
  }

  std::string bytes() {
    check(cg_close(file_));
    return io::read_file(path_);
  }

 private:
  static void check(int status) {
    if (status != CG_OK) throw std::runtime_error(cg_get_error());
  }

  void coordinates(int zone, const Points& points, DataType_t type) {
    const char* names[] = {"CoordinateX", "CoordinateY", "CoordinateZ"};
    for (std::size_t axis = 0; axis < space_; ++axis) {
      std::vector<double> wide;
      for (const Vec3& p : points) wide.push_back(p[axis]);
      const std::vector<float> narrow(wide.begin(), wide.end());
      int coordinate = 0;
      check(cg_coord_write(file_, base_, zone, type, names[axis],
                           type == RealSingle ? static_cast<const void*>(narrow.data()) : wide.data(), &coordinate));
    }
  }

  const std::string path_;
  const std::size_t space_;
  int file_ = 0, base_ = 0;
  cgsize_t next_ = 1;
};

/// The file after its nodes were changed by the lower layer.
inline std::string edited(const std::string& bytes, const std::function<void(int file, double root)>& edit) {
  const std::string path = temporary_path("b.cgns");
  io::write_file(path, bytes);
  int file = 0;
  double root = 0;
  if (cgio_open_file(path.c_str(), CGIO_MODE_MODIFY, CGIO_FILE_NONE, &file) != 0 || cgio_get_root_id(file, &root) != 0) {
    throw std::runtime_error("cannot open what was written");
  }
  edit(file, root);
  if (cgio_close_file(file) != 0) throw std::runtime_error("cannot write what was changed");
  const std::string changed = io::read_file(path);
  std::filesystem::remove(path);
  return changed;
}

inline double node_at(int file, double root, const std::string& path) {
  double id = 0;
  if (cgio_get_node_id(file, root, path.c_str(), &id) != 0) throw std::runtime_error("no node " + path);
  return id;
}

/// Other data for the node at `path`.
inline std::string with_numbers(const std::string& bytes, const std::string& path, const std::vector<cgsize_t>& numbers) {
  return edited(bytes, [&](int file, double root) {
    const double id = node_at(file, root, path);
    const auto count = static_cast<cgsize_t>(numbers.size());
    if (cgio_set_dimensions(file, id, "I4", 1, &count) != 0 || cgio_write_all_data(file, id, numbers.data()) != 0) {
      throw std::runtime_error("cannot write " + path);
    }
  });
}

/// The same numbers as 64-bit integers.
inline std::string with_long_numbers(const std::string& bytes, const std::string& path) {
  return edited(bytes, [&](int file, double root) {
    const double id = node_at(file, root, path);
    int count = 0;
    cgsize_t lengths[CGIO_MAX_DIMENSIONS] = {};
    if (cgio_get_dimensions(file, id, &count, lengths) != 0) throw std::runtime_error("no data in " + path);
    std::size_t size = 1;
    for (int k = 0; k < count; ++k) size *= static_cast<std::size_t>(lengths[k]);
    std::vector<cgsize_t> numbers(size);
    if (cgio_read_all_data(file, id, numbers.data()) != 0) throw std::runtime_error("cannot read " + path);
    const std::vector<cglong_t> wide(numbers.begin(), numbers.end());
    if (cgio_set_dimensions(file, id, "I8", count, lengths) != 0 || cgio_write_all_data(file, id, wide.data()) != 0) {
      throw std::runtime_error("cannot write " + path);
    }
  });
}

inline std::string without(const std::string& bytes, const std::string& parent, const std::string& name) {
  return edited(bytes, [&](int file, double root) {
    const double id = node_at(file, root, parent);
    if (cgio_delete_node(file, id, node_at(file, root, parent + "/" + name)) != 0) throw std::runtime_error("cannot delete");
  });
}

}  // namespace deform::test
