// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/deformers/energy/spaces/model_lattice.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <optional>
#include <span>
#include <utility>

#include "core/base/checks.h"
#include "core/base/error.h"
#include "core/base/vectors.h"
#include "core/deformers/option_checks.h"
#include "core/mesh/cells.h"
#include "core/mesh/elements.h"
#include "core/numerics/lattice/moved_lattice.h"

namespace deform {

namespace {

constexpr std::size_t most_points = 1000, most_in_all = 100000;

void refuse_outside(const std::vector<std::uint32_t>& outside, const std::vector<RegionIndex>& region_of) {
  std::size_t handle_points = 0, others = 0;
  std::uint32_t first = 0;
  for (const std::uint32_t i : outside) {
    if (region_of[i] == fixed_region) continue;
    if (handle_points + others == 0) first = i;
    ++(region_of[i] == deformable_region ? others : handle_points);
  }
  if (handle_points + others == 0) return;
  refuse_argument("method.ffd.lattice: " + std::to_string(handle_points + others) + " points lie outside of the lattice (" +
                  std::to_string(handle_points) + " of handles, " + std::to_string(others) +
                  " that are neither in a handle nor fixed), the first is " + std::to_string(first) +
                  "; make it larger or put them into a fixed region");
}

/// The edges of faces and cells from points inside to points outside, ascending.
std::vector<std::pair<PointId, PointId>> cut_edges(const Mesh& mesh, const std::vector<std::uint32_t>& outside) {
  std::vector<std::pair<PointId, PointId>> cut;
  if (outside.empty()) return cut;
  std::vector<bool> out(mesh.point_count(), false);
  for (const std::uint32_t i : outside) out[i] = true;
  const auto add = [&](PointId a, PointId b) {
    if (out[a] != out[b]) cut.emplace_back(out[a] ? b : a, out[a] ? a : b);
  };
  const auto add_face = [&](std::span<const PointId> face) {
    for (std::size_t i = 0; i < face.size(); ++i) add(face[i], face[(i + 1) % face.size()]);
  };
  std::size_t at = 0;
  for (const std::uint32_t size : mesh.face_sizes) {
    add_face(std::span(mesh.face_points).subspan(at, size));
    at += size;
  }
  for (std::size_t f = 0; mesh.cells && f < mesh.cells->face_count(); ++f) add_face(mesh.cells->face(f));
  for (std::size_t e = 0; mesh.elements && e < mesh.elements->size(); ++e) {
    const std::span<const PointId> nodes = mesh.elements->nodes(e);
    for (const auto& [a, b] : shape(mesh.elements->types[e]).edges) add(nodes[a], nodes[b]);
  }
  std::sort(cut.begin(), cut.end());
  cut.erase(std::unique(cut.begin(), cut.end()), cut.end());
  return cut;
}

const char* name_of(LatticeBasis basis) {
  switch (basis) {
    case LatticeBasis::uniform_cubic:
      return "UNIFORM_CUBIC";
    case LatticeBasis::clamped_cubic:
      return "CLAMPED_CUBIC";
    case LatticeBasis::bernstein:
      return "BERNSTEIN";
  }
  return "";
}

std::vector<std::string> notes_of(const Lattice& lattice, LatticeBasis basis) {
  std::string size, cell;
  for (std::size_t k = 0; k < 3; ++k) {
    char length[32];
    std::snprintf(length, sizeof length, "%.3g", norm(lattice.frame().axes[k]) / static_cast<double>(lattice.axis(k).spans()));
    size += (k == 0 ? "" : " x ") + std::to_string(lattice.axis(k).size());
    cell += (k == 0 ? "" : " x ") + std::string(length);
  }
  return {size + " control points of " + name_of(basis) + ", in cells of " + cell};
}

/// points: "120 fixed points"; end: what to do about it.
void add_outside_note(const Mesh& mesh, const char* points, const char* end, ModelLattice& made) {
  if (made.outside.empty()) return;
  made.notes.push_back(std::to_string(made.outside.size()) + points + " lie outside of the lattice, the first is " +
                       std::to_string(made.outside.front()) + "; " + std::to_string(cut_edges(mesh, made.outside).size()) +
                       " edges cross its boundary, where the deformation ends at once unless " + end);
}

/// Adds the field to what MovedLattice says of it.
template <typename Call>
auto about_control_points(const Call& call) {
  try {
    return call();
  } catch (const Error& error) {
    if (error.code() != ErrorCode::invalid_argument) throw;
    refuse_argument(std::string("method.ffd.lattice.control_points: ") + error.what());
  }
}

std::unique_ptr<const MovedLattice> moved_lattice(const Lattice& lattice, const std::vector<Vec3>& control_points) {
  if (control_points.empty()) return nullptr;
  return std::make_unique<const MovedLattice>(lattice, control_points);
}

ModelLattice made_lattice(const Mesh& mesh, const LatticeOptions& options, const RunContext& context) {
  const Lattice lattice = lattice_of(options, mesh);
  auto in_space = about_control_points([&] { return std::make_shared<const LatticeFunctions>(lattice, options.control_points); });
  LatticeCoordinates at = about_control_points([&] { return in_space->coordinates(mesh.points, context); });
  std::vector<std::uint32_t> outside = at.outside;
  std::vector<std::string> notes = notes_of(lattice, options.basis);
  const auto units =
      units_note("lattice", bounding_box(lattice.control_points()).diagonal(), bounding_box(mesh.points).diagonal());
  if (units) notes.push_back(*units);
  if (!outside.empty() && outside.size() == mesh.point_count()) {
    notes.push_back(std::string("No point of the mesh lies in the lattice") +
                    (units ? "." : ": is it the lattice of this mesh, in the same units and the same place?"));
  }
  return {lattice, std::make_shared<const LatticeRows>(lattice, std::move(at)), std::move(in_space), std::move(notes),
          std::move(outside)};
}

void check_control_points(const LatticeOptions& options, const Lattice& lattice, const std::string& field) {
  if (options.control_points.empty()) return;
  if (options.control_points.size() != lattice.size()) {
    refuse_argument(field + ": " + std::to_string(options.control_points.size()) + " control points for a lattice of " +
                    std::to_string(lattice.axis(0).size()) + " x " + std::to_string(lattice.axis(1).size()) + " x " +
                    std::to_string(lattice.axis(2).size()));
  }
  if (lattice.size() > most_moved_points) {
    refuse_argument(field + ": " + std::to_string(lattice.size()) + " are more than the limit of " +
                    std::to_string(most_moved_points));
  }
  check_finite(options.control_points, field);
}

}  // namespace

void check_lattice(Problems& problems, const LatticeOptions& options, const Mesh& mesh) {
  const std::string field = "method.ffd.lattice";
  const bool bernstein = options.basis == LatticeBasis::bernstein;
  bool sound = true;
  if (options.points != std::array<std::size_t, 3>{}) {
    const double least = bernstein ? 2 : static_cast<double>(SplineAxis::least_points);
    const auto most = static_cast<double>(bernstein ? SplineAxis::most_bernstein_points : most_points);
    for (std::size_t k = 0; k < 3; ++k) {
      const std::string points = field + ".points[" + std::to_string(k) + "]";
      sound = problems.check(points, [&] { check_option_range(static_cast<double>(options.points[k]), least, most, points); }) &&
              sound;
    }
  }
  sound = sound && problems.check(field + ".points", [&] {
    const std::size_t all = options.points[0] * options.points[1] * options.points[2];
    if (all > most_in_all) {
      refuse_argument(field + ".points: " + std::to_string(all) + " control points are more than the limit of " +
                      std::to_string(most_in_all));
    }
  });
  if (!sound) return;
  std::optional<Lattice> lattice;
  const auto make = [&] {
    try {
      lattice = lattice_of(options, mesh);
    } catch (const Error& error) {
      refuse_argument(field + ": " + error.what());
    }
  };
  if (!problems.check(field, make)) return;
  problems.check(field + ".control_points", [&] { check_control_points(options, *lattice, field + ".control_points"); });
}

LatticeRows::LatticeRows(const Lattice& lattice, LatticeCoordinates at) : sums_(lattice), u_(std::move(at.u)) {
  for (const std::uint32_t i : at.outside) u_[i][0] = -1;
}

LatticeFunctions::LatticeFunctions(const Lattice& lattice, const std::vector<Vec3>& control_points)
    : sums_(lattice), moved_(moved_lattice(lattice, control_points)) {}

LatticeCoordinates LatticeFunctions::coordinates(std::span<const Vec3> points, const RunContext& context) const {
  return moved_ ? moved_->coordinates(points, context) : coordinates_in(sums_.lattice(), points, context);
}

std::optional<Vec3> LatticeFunctions::inside(const Vec3& place, std::uint64_t number) const {
  if (!moved_) return sums_.lattice().inside(place);
  try {
    return moved_->coordinates(place);
  } catch (const Error& error) {
    if (error.code() != ErrorCode::invalid_argument) throw;
    refuse_argument("points[" + std::to_string(number) + "]: " + error.what());
  }
}

SpaceFunctions::Outside LatticeFunctions::rows(std::span<const Vec3> places, std::uint64_t first, const Use& use) const {
  Outside outside;
  for (std::size_t i = 0; i < places.size(); ++i) {
    const std::optional<Vec3> u = inside(places[i], first + i);
    if (!u) {
      outside.push_back(i);
      continue;
    }
    sums_.lattice().for_each(sums_.lattice().weights(*u),
                             [&](std::size_t p, double weight) { use(i, static_cast<std::int64_t>(p), weight); });
  }
  return outside;
}

SpaceFunctions::Outside LatticeFunctions::sums(std::span<const Vec3> places, std::uint64_t first, const Vec3* vectors,
                                               Vec3* out) const {
  Outside outside;
  std::vector<Vec3> u(places.size());
  for (std::size_t i = 0; i < places.size(); ++i) {
    const std::optional<Vec3> found = inside(places[i], first + i);
    u[i] = found.value_or(Vec3{-1, 0, 0});
    if (!found) outside.push_back(i);
  }
  sums_(u, {&vectors, 1}, out);
  return outside;
}

std::size_t LatticeFunctions::bytes() const { return sizeof(*this) + (moved_ ? moved_->bytes() : 0); }

ModelLattice model_lattice(const Mesh& mesh, const LatticeOptions& options, const std::vector<RegionIndex>& region_of,
                           const RunContext& context) {
  ModelLattice made = made_lattice(mesh, options, context);
  refuse_outside(made.outside, region_of);
  add_outside_note(mesh, " fixed points", "what is near is fixed", made);
  return made;
}

ModelLattice control_lattice(const Mesh& mesh, const LatticeOptions& options, const RunContext& context) {
  ModelLattice made = made_lattice(mesh, options, context);
  add_outside_note(mesh, " points", "the control points near it stay", made);
  return made;
}

std::vector<Vec3> boundary_crossings(const Mesh& mesh, const LatticeOptions& options, const ModelLattice& made) {
  std::vector<Vec3> crossings;
  for (const auto& [in, out] : cut_edges(mesh, made.outside)) {
    const Vec3& from = made.rows->coordinates(in);
    if (options.control_points.empty()) {
      const Vec3 to = made.lattice.coordinates(mesh.points[out]);
      double t = 1;  // of the way to the first face on it
      for (std::size_t k = 0; k < 3; ++k) {
        const double limit = to[k] < 0 ? 0 : 1;
        if (to[k] < 0 || to[k] > 1) t = std::min(t, (limit - from[k]) / (to[k] - from[k]));
      }
      Vec3 u = lerp(from, to, t);
      for (double& value : u) value = std::clamp(value, 0.0, 1.0);
      crossings.push_back(u);
      continue;
    }
    std::size_t axis = 0;
    double nearest = 1;
    for (std::size_t k = 0; k < 3; ++k) {
      const double away = std::min(from[k], 1 - from[k]);
      if (away < nearest) {
        nearest = away;
        axis = k;
      }
    }
    Vec3 u = from;
    u[axis] = from[axis] < 0.5 ? 0 : 1;
    crossings.push_back(u);
  }
  return crossings;
}

}  // namespace deform
