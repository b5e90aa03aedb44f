// SPDX-License-Identifier: Apache-2.0
#include "core/io/vtk_output.h"

#include <algorithm>
#include <bit>
#include <cstdint>
#include <functional>
#include <numeric>

#include "core/base/checks.h"
#include "core/base/error.h"
#include "core/base/text.h"
#include "core/io/binary/byte_order.h"
#include "core/io/formats/vtk/vtk_cells.h"
#include "core/io/mesh_file.h"

namespace deform::io {

namespace {

using Ids = std::vector<std::int64_t>;

/// The two halves of a file: elements that describe arrays, and the bytes behind them that they point to.
class VtkDocument {
 public:
  VtkDocument(const std::string& type, const std::string& piece, const std::vector<VtkTexts>& texts) : type_(type) {
    head_ = "<?xml version=\"1.0\"?>\n<VTKFile type=\"" + type +
            "\" version=\"1.0\" byte_order=\"LittleEndian\" header_type=\"UInt64\">\n<" + type + ">\n";
    if (!texts.empty()) add_texts(texts);
    head_ += "<Piece" + piece + ">\n";
  }

  void open(const std::string& element) { head_ += "<" + element + ">\n"; }
  void close(const std::string& element) { head_ += "</" + element + ">\n"; }

  /// `values` in the place of those of the array.
  void add(const VtkArray& array, std::span<const double> values) {
    if (array.type == VtkArray::Type::float64) {
      describe("Float64", array.name, array.components, 8 * values.size());
      for (const double value : values) append(std::bit_cast<std::uint64_t>(value));
    } else if (array.type == VtkArray::Type::int32) {
      describe("Int32", array.name, array.components, 4 * values.size());
      for (const double value : values) append(static_cast<std::uint32_t>(static_cast<std::int32_t>(value)));
    } else {
      describe("UInt8", array.name, array.components, values.size());
      for (const double value : values) append(static_cast<std::uint8_t>(value));
    }
  }
  void add(const std::string& name, const Ids& values) {
    describe("Int64", name, 1, 8 * values.size());
    for (const std::int64_t value : values) append(static_cast<std::uint64_t>(value));
  }
  void add_bytes(const std::string& name, const std::string& values) {
    describe("UInt8", name, 1, values.size());
    data_ += values;
  }
  void add_points(std::span<const Vec3> points) {
    open("Points");
    describe("Float64", "Points", 3, 24 * points.size());
    for (const Vec3& p : points) {
      for (const double x : p) append(std::bit_cast<std::uint64_t>(x));
    }
    close("Points");
  }
  void add_arrays(const std::string& element, const std::vector<VtkArray>& arrays) {
    open(element);
    for (const VtkArray& array : arrays) add(array, array.values);
    close(element);
  }

  std::string finish() {
    head_ += "</Piece>\n</" + type_ + ">\n<AppendedData encoding=\"raw\">\n_";
    head_ += data_;
    return std::move(head_) + "\n</AppendedData>\n</VTKFile>\n";
  }

 private:
  void describe(const char* type, const std::string& name, std::size_t components, std::size_t bytes) {
    head_ += std::string("<DataArray type=\"") + type + "\" Name=\"" + markup_text(name) + "\" NumberOfComponents=\"" +
             std::to_string(components) + "\" format=\"appended\" offset=\"" + std::to_string(data_.size()) + "\"/>\n";
    append(static_cast<std::uint64_t>(bytes));
  }
  template <typename T>
  void append(T value) {
    char bytes[sizeof(T)];
    store_scalar(bytes, value, std::endian::little);
    data_.append(bytes, sizeof(bytes));
  }
  /// VTK has no other form for texts than the numbers of their bytes, each text with a 0 behind it.
  void add_texts(const std::vector<VtkTexts>& texts) {
    open("FieldData");
    for (const VtkTexts& array : texts) {
      head_ += "<DataArray type=\"String\" Name=\"" + markup_text(array.name) + "\" NumberOfTuples=\"" +
               std::to_string(array.values.size()) + "\" format=\"ascii\">\n";
      for (const std::string& text : array.values) {
        for (const char c : text) head_ += std::to_string(static_cast<unsigned>(static_cast<unsigned char>(c))) + " ";
        head_ += "0\n";
      }
      head_ += "</DataArray>\n";
    }
    close("FieldData");
  }

  const std::string type_;
  std::string head_, data_;
};

[[noreturn]] void refuse(const std::string& name, const std::string& why) {
  throw Error(ErrorCode::invalid_argument, name + ": " + why);
}

void check_arrays(const std::vector<VtkArray>& arrays, std::size_t count, const char* noun, const std::string& name) {
  for (const VtkArray& array : arrays) {
    if (array.values.size() == array.components * count) continue;
    refuse(name, "array \"" + array.name + "\" has " + std::to_string(array.values.size()) + " values, expected " +
                     std::to_string(array.components) + " for each of the " + std::to_string(count) + " " + noun);
  }
}

std::string attribute(const char* name, std::size_t value) {
  return std::string(" ") + name + "=\"" + std::to_string(value) + "\"";
}

/// `element`: Verts, Lines or Polys.
void add_faces(VtkDocument& document, const char* element, const Mesh& mesh, const std::vector<std::size_t>& faces,
               const std::vector<std::uint64_t>& offsets) {
  Ids connectivity, ends;
  for (const std::size_t f : faces) {
    for (std::uint64_t c = offsets[f]; c < offsets[f + 1]; ++c) connectivity.push_back(mesh.face_points[c]);
    ends.push_back(static_cast<std::int64_t>(connectivity.size()));
  }
  document.open(element);
  document.add("connectivity", connectivity);
  document.add("offsets", ends);
  document.close(element);
}

void check_extension(const std::filesystem::path& path, const char* extension, const char* what) {
  if (path.extension() == extension) return;
  refuse(path.string(), std::string(what) + " is written to a name that ends in " + extension);
}

/// The arrays of an unstructured grid beside its cells.
std::string grid_bytes(std::span<const Vec3> points, std::size_t cells, const VtkArrays& arrays,
                       const std::function<void(VtkDocument&)>& add_cells) {
  VtkDocument document("UnstructuredGrid", attribute("NumberOfPoints", points.size()) + attribute("NumberOfCells", cells),
                       arrays.texts);
  document.add_arrays("PointData", arrays.points);
  document.add_arrays("CellData", arrays.cells);
  document.add_points(points);
  document.open("Cells");
  add_cells(document);
  document.close("Cells");
  return document.finish();
}

/// The faces of every cell, ascending.
struct PolyhedronFaces {
  std::vector<std::uint64_t> offsets;
  std::vector<std::uint32_t> faces;

  explicit PolyhedronFaces(const PolyhedralCells& cells) : offsets(cells.cell_count + 1) {
    const auto for_each = [&](const auto& use) {
      for (std::size_t f = 0; f < cells.face_count(); ++f) {
        use(cells.owner[f], f);
        if (f < cells.internal_faces()) use(cells.neighbour[f], f);
      }
    };
    for_each([&](std::uint32_t cell, std::size_t) { ++offsets[cell + 1]; });
    std::partial_sum(offsets.begin(), offsets.end(), offsets.begin());
    faces.resize(offsets.back());
    std::vector<std::uint64_t> next(offsets.begin(), offsets.end() - 1);
    for_each([&](std::uint32_t cell, std::size_t f) { faces[next[cell]++] = static_cast<std::uint32_t>(f); });
  }
};

}  // namespace

std::string vtp_bytes(const Mesh& mesh, const VtkArrays& arrays, const std::string& name) {
  check_arrays(arrays.points, mesh.point_count(), "points", name);
  check_arrays(arrays.cells, mesh.face_count(), "faces", name);
  check_ids(mesh.face_points, mesh.point_count(), name + ": face_points", "point");
  const auto offsets = mesh.face_offsets();
  std::vector<std::size_t> kinds[3];  // faces of one corner, of two, of more
  for (std::size_t f = 0; f < mesh.face_count(); ++f) kinds[std::min<std::uint32_t>(mesh.face_sizes[f], 3) - 1].push_back(f);
  VtkDocument document("PolyData",
                       attribute("NumberOfPoints", mesh.point_count()) + attribute("NumberOfVerts", kinds[0].size()) +
                           attribute("NumberOfLines", kinds[1].size()) + attribute("NumberOfStrips", 0) +
                           attribute("NumberOfPolys", kinds[2].size()),
                       arrays.texts);
  document.add_arrays("PointData", arrays.points);
  if (kinds[2].size() == mesh.face_count()) {
    document.add_arrays("CellData", arrays.cells);
  } else {
    std::vector<VtkArray> sorted;
    Ids ids;
    for (const auto& kind : kinds) ids.insert(ids.end(), kind.begin(), kind.end());
    for (const VtkArray& array : arrays.cells) {
      sorted.push_back({array.name, array.components, {}, array.type});
      for (const std::int64_t f : ids) {
        const auto at = array.values.begin() + f * static_cast<std::int64_t>(array.components);
        sorted.back().values.insert(sorted.back().values.end(), at, at + static_cast<std::int64_t>(array.components));
      }
    }
    document.open("CellData");
    for (const VtkArray& array : sorted) document.add(array, array.values);
    document.add("face", ids);
    document.close("CellData");
  }
  document.add_points(mesh.points);
  add_faces(document, "Verts", mesh, kinds[0], offsets);
  add_faces(document, "Lines", mesh, kinds[1], offsets);
  add_faces(document, "Polys", mesh, kinds[2], offsets);
  return document.finish();
}

std::string vtu_bytes(std::span<const Vec3> points, const Elements& elements, const VtkArrays& arrays, const std::string& name) {
  check_arrays(arrays.points, points.size(), "points", name);
  check_arrays(arrays.cells, elements.size(), "elements", name);
  check_ids(elements.points, points.size(), name + ": elements", "point");
  return grid_bytes(points, elements.size(), arrays, [&](VtkDocument& document) {
    Ids connectivity, ends;
    std::string types;
    for (std::size_t e = 0; e < elements.size(); ++e) {
      const VtkElement& cell = vtk_element(elements.types[e]);
      const auto nodes = elements.nodes(e);
      for (const std::uint8_t node : cell.nodes) connectivity.push_back(nodes[node]);
      ends.push_back(static_cast<std::int64_t>(connectivity.size()));
      types += static_cast<char>(cell.type);
    }
    document.add("connectivity", connectivity);
    document.add("offsets", ends);
    document.add_bytes("types", types);
  });
}

std::string vtu_bytes(std::span<const Vec3> points, const PolyhedralCells& cells, const VtkArrays& arrays,
                      const std::string& name) {
  check_arrays(arrays.points, points.size(), "points", name);
  check_arrays(arrays.cells, cells.cell_count, "cells", name);
  check_ids(cells.face_points, points.size(), name + ": face_points", "point");
  return grid_bytes(points, cells.cell_count, arrays, [&](VtkDocument& document) {
    const PolyhedronFaces around(cells);
    Ids connectivity, ends, faces, face_ends;
    std::vector<std::int64_t> last(points.size(), -1);  // the last cell that has the point
    for (std::size_t c = 0; c < cells.cell_count; ++c) {
      faces.push_back(static_cast<std::int64_t>(around.offsets[c + 1] - around.offsets[c]));
      for (std::uint64_t i = around.offsets[c]; i < around.offsets[c + 1]; ++i) {
        const std::uint32_t f = around.faces[i];
        const auto corners = cells.face(f);
        const std::size_t begin = faces.size() + 1;
        faces.push_back(static_cast<std::int64_t>(corners.size()));
        for (const PointId p : corners) {
          faces.push_back(p);
          if (last[p] != static_cast<std::int64_t>(c)) connectivity.push_back(p);
          last[p] = static_cast<std::int64_t>(c);
        }
        // A face looks from its owner to its neighbour.
        if (cells.owner[f] != c) std::reverse(faces.begin() + static_cast<std::ptrdiff_t>(begin), faces.end());
      }
      ends.push_back(static_cast<std::int64_t>(connectivity.size()));
      face_ends.push_back(static_cast<std::int64_t>(faces.size()));
    }
    document.add("connectivity", connectivity);
    document.add("offsets", ends);
    document.add_bytes("types", std::string(cells.cell_count, static_cast<char>(VtkCells::polyhedron)));
    document.add("faces", faces);
    document.add("faceoffsets", face_ends);
  });
}

void write_vtp(const Mesh& mesh, const VtkArrays& arrays, const std::filesystem::path& path) {
  check_extension(path, ".vtp", "a surface");
  write_file(path, vtp_bytes(mesh, arrays, path.string()));
}

void write_vtu(std::span<const Vec3> points, const Elements& elements, const VtkArrays& arrays,
               const std::filesystem::path& path) {
  check_extension(path, ".vtu", "a volume mesh");
  write_file(path, vtu_bytes(points, elements, arrays, path.string()));
}

void write_vtu(std::span<const Vec3> points, const PolyhedralCells& cells, const VtkArrays& arrays,
               const std::filesystem::path& path) {
  check_extension(path, ".vtu", "a volume mesh");
  write_file(path, vtu_bytes(points, cells, arrays, path.string()));
}

}  // namespace deform::io
