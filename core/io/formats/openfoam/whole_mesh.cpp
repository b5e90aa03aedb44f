// SPDX-License-Identifier: Apache-2.0
#include "core/io/formats/openfoam/whole_mesh.h"

#include <algorithm>
#include <cstdlib>
#include <limits>
#include <unordered_map>
#include <utility>

#include "core/base/error.h"
#include "core/base/types.h"
#include "core/base/vectors.h"
#include "core/io/formats/openfoam/foam_scanner.h"

namespace deform::io {

namespace {

constexpr std::uint32_t none = std::numeric_limits<std::uint32_t>::max();

[[noreturn]] void refuse(const std::string& file, const std::string& reason) {
  throw Error(ErrorCode::invalid_argument, file + ": " + reason);
}

std::string nth(std::size_t i) { return "entry " + std::to_string(i); }

void check_count(const std::string& file, std::size_t addresses, std::size_t members, const char* what) {
  if (addresses == members) return;
  refuse(file, std::to_string(addresses) + " entries for the " + std::to_string(members) + " " + what +
                   " of this part; the mesh was changed after it was decomposed (reconstructParMesh writes the entries anew)");
}

/// How many members the whole has: the largest address and one. It has at most as many as the parts together.
template <typename Addresses, typename Number>
std::size_t whole_count(const std::vector<CasePart>& parts, Addresses CasePart::*addresses, std::string CasePart::*name,
                        const Number& number) {
  std::size_t most = 0, count = 0;
  for (const CasePart& part : parts) most += (part.*addresses).size();
  for (const CasePart& part : parts) {
    for (std::size_t i = 0; i < (part.*addresses).size(); ++i) {
      const std::size_t member = number((part.*addresses)[i]);
      if (member >= most) {
        refuse(part.*name,
               nth(i) + " is " + std::to_string((part.*addresses)[i]) + ", all parts together have only " + std::to_string(most));
      }
      count = std::max(count, member + 1);
    }
  }
  return count;
}

std::size_t face_number(std::int64_t address) { return static_cast<std::size_t>(std::abs(address)) - 1; }
std::size_t same_number(std::uint32_t address) { return address; }

/// A face of the whole in one of the parts.
struct FaceSource {
  std::uint32_t part = none, face = 0;
  bool turned = false;
};

class Whole {
 public:
  explicit Whole(const std::vector<CasePart>& parts) : parts_(parts) {}

  FoamMesh join() {
    join_points();
    cells().cell_count = whole_count(parts_, &CasePart::cells, &CasePart::cells_name, same_number);
    join_faces();
    join_patches();
    for (const CasePart& part : parts_) {
      join_zones(part.mesh.point_zones, point_zones_, [&](std::uint32_t i) { return part.points[i]; });
      join_zones(part.mesh.face_zones, face_zones_,
                 [&](std::uint32_t i) { return static_cast<std::uint32_t>(face_number(part.faces[i])); });
      join_zones(part.mesh.cell_zones, cell_zones_, [&](std::uint32_t i) { return part.cells[i]; });
    }
    whole_.point_zones = point_zones_.finish();
    whole_.face_zones = face_zones_.finish();
    whole_.cell_zones = cell_zones_.finish();
    return std::move(whole_);
  }

 private:
  /// Zones by name, in order of first appearance.
  struct Zones {
    std::vector<FoamZone> all;
    std::unordered_map<std::string, std::size_t> index;

    std::vector<FoamZone> finish() {
      for (FoamZone& zone : all) {
        std::sort(zone.members.begin(), zone.members.end());
        zone.members.erase(std::unique(zone.members.begin(), zone.members.end()), zone.members.end());
      }
      return std::move(all);
    }
  };

  template <typename Number>
  static void join_zones(const std::vector<FoamZone>& zones, Zones& whole, const Number& number) {
    for (const FoamZone& zone : zones) {
      const auto [found, added] = whole.index.try_emplace(zone.name, whole.all.size());
      if (added) whole.all.push_back({zone.name, {}});
      auto& members = whole.all[found->second].members;
      for (const std::uint32_t member : zone.members) members.push_back(number(member));
    }
  }

  PolyhedralCells& cells() { return whole_.cells; }

  void join_points() {
    auto& points = whole_.points.points;
    points.resize(whole_count(parts_, &CasePart::points, &CasePart::points_name, same_number));
    std::vector<std::uint32_t> first(points.size(), none);
    for (std::uint32_t p = 0; p < parts_.size(); ++p) {
      const CasePart& part = parts_[p];
      for (std::size_t i = 0; i < part.points.size(); ++i) {
        if (first[part.points[i]] != none) continue;
        first[part.points[i]] = p;
        points[part.points[i]] = part.mesh.points.points[i];
      }
    }
    const auto missing = std::find(first.begin(), first.end(), none);
    if (missing != first.end()) {
      refuse(parts_.front().points_name, "no part has point " + std::to_string(missing - first.begin()) + " of the whole case");
    }
    check_places(first);
  }

  /// Files round, and solvers move shared points in each part on its own; anything more is another mesh.
  void check_places(const std::vector<std::uint32_t>& first) const {
    const auto& points = whole_.points.points;
    const double tolerance = 1e-6 * bounding_box(points).diagonal();
    for (const CasePart& part : parts_) {
      for (std::size_t i = 0; i < part.points.size(); ++i) {
        const PointId point = part.points[i];
        if (distance(part.mesh.points.points[i], points[point]) <= tolerance) continue;
        refuse(part.points_path.string(),
               "point " + std::to_string(i) + " is not where " + parts_[first[point]].points_path.string() +
                   " has it: the parts are of different times, or " + part.points_name + " is of another mesh");
      }
    }
  }

  void join_faces() {
    const std::size_t faces = whole_count(parts_, &CasePart::faces, &CasePart::faces_name, face_number);
    cells().owner.assign(faces, none);
    neighbour_.assign(faces, none);
    sources_.resize(faces);
    for (std::uint32_t p = 0; p < parts_.size(); ++p) {
      for (std::uint32_t f = 0; f < parts_[p].faces.size(); ++f) add_face(p, f);
    }
    const auto boundary = std::find(neighbour_.begin(), neighbour_.end(), none);
    const auto late = std::find_if(boundary, neighbour_.end(), [](std::uint32_t cell) { return cell != none; });
    if (late != neighbour_.end()) {
      const auto face = static_cast<std::size_t>(boundary - neighbour_.begin());
      refuse(name_of(face), "face " + std::to_string(face) + " of the whole case has one cell only, and face " +
                                std::to_string(late - neighbour_.begin()) + " after it has two");
    }
    cells().neighbour.assign(neighbour_.begin(), boundary);
    for (std::size_t f = 0; f < faces; ++f) add_corners(f);
  }

  std::string name_of(std::size_t face) const {
    const std::uint32_t part = sources_[face].part;
    return (part == none ? parts_.front() : parts_[part]).faces_name;
  }

  void set(std::uint32_t& cell, std::uint32_t value, const CasePart& part, std::uint32_t face) {
    if (cell != none) {
      refuse(part.faces_name, nth(face) + ": face " + std::to_string(face_number(part.faces[face])) +
                                  " of the whole case is here and in another place with the same side");
    }
    cell = value;
  }

  void add_face(std::uint32_t p, std::uint32_t face) {
    const CasePart& part = parts_[p];
    const PolyhedralCells& mesh = part.mesh.cells;
    const std::size_t g = face_number(part.faces[face]);
    const bool inside = face < mesh.internal_faces();
    // The cyclic faces of the whole are two faces there, each with its owner.
    const bool turned = part.faces[face] < 0 && (inside || part.shared(face));
    set(turned ? neighbour_[g] : cells().owner[g], part.cells[mesh.owner[face]], part, face);
    if (inside) set(turned ? cells().owner[g] : neighbour_[g], part.cells[mesh.neighbour[face]], part, face);
    if (!turned || inside) sources_[g] = {p, face, turned};
  }

  /// The first corner of a turned face stays the first.
  void add_corners(std::size_t face) {
    const FaceSource source = sources_[face];
    if (source.part == none)
      refuse(name_of(face), "no part has the owner of face " + std::to_string(face) + " of the whole case");
    const CasePart& part = parts_[source.part];
    if (face >= cells().internal_faces() && part.shared(source.face)) {
      refuse(part.faces_name, nth(source.face) + ": no other part has the neighbour of this face");
    }
    const auto corners = part.mesh.cells.face(source.face);
    auto& all = cells().face_points;
    const std::size_t begin = all.size();
    for (const PointId corner : corners) all.push_back(part.points[corner]);
    if (source.turned && !corners.empty()) std::reverse(all.begin() + static_cast<std::ptrdiff_t>(begin) + 1, all.end());
    cells().face_offsets.push_back(all.size());
  }

  void join_patches() {
    std::unordered_map<std::string, std::size_t> index;
    for (const CasePart& part : parts_) {
      for (const FoamPatch& patch : part.mesh.patches) {
        if (!patch.between_parts) join_patch(part, patch, index);
      }
    }
    auto& patches = whole_.patches;
    std::erase_if(patches, [](const FoamPatch& patch) { return patch.count == 0; });
    std::stable_sort(patches.begin(), patches.end(), [](const auto& a, const auto& b) { return a.first < b.first; });
    for (std::size_t i = 0; i < patches.size(); ++i) {
      const std::uint64_t next = i + 1 < patches.size() ? patches[i + 1].first : cells().face_count();
      if (patches[i].first >= cells().internal_faces() && patches[i].first + patches[i].count <= next) continue;
      refuse(parts_.front().faces_name,
             "the faces of patch \"" + patches[i].name + "\" do not follow each other in the whole case");
    }
  }

  void join_patch(const CasePart& part, const FoamPatch& patch, std::unordered_map<std::string, std::size_t>& index) {
    const std::string& name = patch.cyclic.empty() ? patch.name : patch.cyclic;
    const auto [found, added] = index.try_emplace(name, whole_.patches.size());
    if (added) {
      whole_.patches.push_back({.name = name, .groups = {}, .empty = false, .between_parts = false, .cyclic = {}});
      whole_.patches.back().first = cells().face_count();
    }
    FoamPatch& whole = whole_.patches[found->second];
    if (patch.cyclic.empty()) {
      whole.groups = patch.groups;
      whole.empty = patch.empty;
    }
    for (std::uint64_t f = patch.first; f < patch.first + patch.count; ++f) {
      whole.first = std::min<std::uint64_t>(whole.first, face_number(part.faces[f]));
    }
    whole.count += patch.count;
  }

  const std::vector<CasePart>& parts_;
  FoamMesh whole_;
  std::vector<std::uint32_t> neighbour_;  // of all faces
  std::vector<FaceSource> sources_;
  Zones point_zones_, face_zones_, cell_zones_;
};

}  // namespace

bool CasePart::shared(std::uint64_t face) const {
  return std::any_of(mesh.patches.begin(), mesh.patches.end(), [face](const FoamPatch& patch) {
    return patch.between_parts && face >= patch.first && face - patch.first < patch.count;
  });
}

CasePart parse_case_part(FoamFiles files, const CaseAddresses& addresses) {
  CasePart part;
  part.mesh = read_foam_mesh(files);
  part.point_bytes = std::move(files.points.bytes);
  part.points_path = files.points.name;
  const auto scan = [](const FoamFiles::Part& file, std::string& name, const auto& read) {
    name = file.name;
    FoamScanner scanner(file.bytes, name);
    scanner.read_header();
    read(scanner);
  };
  scan(addresses.points, part.points_name, [&](auto& scanner) { part.points = scanner.labels("a point", none, scanner.left()); });
  scan(addresses.cells, part.cells_name, [&](auto& scanner) { part.cells = scanner.labels("a cell", none, scanner.left()); });
  scan(addresses.faces, part.faces_name, [&](auto& scanner) { part.faces = scanner.signed_labels("a face"); });
  check_count(part.points_name, part.points.size(), part.mesh.points.points.size(), "points");
  check_count(part.cells_name, part.cells.size(), part.mesh.cells.cell_count, "cells");
  check_count(part.faces_name, part.faces.size(), part.mesh.cells.face_count(), "faces");
  const auto wrong = std::find_if(part.faces.begin(), part.faces.end(),
                                  [](std::int64_t face) { return face == 0 || face > none || face < -std::int64_t{none}; });
  if (wrong != part.faces.end()) {
    refuse(part.faces_name, nth(static_cast<std::size_t>(wrong - part.faces.begin())) + " is " + std::to_string(*wrong) +
                                ", faces are counted from 1 here, with a sign");
  }
  return part;
}

CaseAddresses load_addresses(const FoamFolder& folder) {
  const auto load = [&](const char* name) {
    return load_openfoam_file(folder.topology, name,
                              "which says what this part is in the whole case (reconstructParMesh writes it)");
  };
  return {load("pointProcAddressing"), load("faceProcAddressing"), load("cellProcAddressing")};
}

CasePart read_case_part(FoamFolder folder) {
  const CaseAddresses addresses = load_addresses(folder);
  return parse_case_part(std::move(folder.files), addresses);
}

FoamMesh whole_mesh(const std::vector<CasePart>& parts) { return Whole(parts).join(); }

}  // namespace deform::io
