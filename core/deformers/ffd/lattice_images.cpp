// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/deformers/ffd/lattice_images.h"

#include <algorithm>
#include <array>
#include <iterator>
#include <memory>
#include <numeric>
#include <optional>
#include <string>
#include <utility>

#include "core/base/vectors.h"
#include "core/deformers/energy/spaces/model_lattice.h"
#include "core/deformers/option_checks.h"

namespace deform {

namespace {

constexpr double image_tolerance = 1e-9;  // of the diagonal: distance of control points from the images of others

using LatticeIndex = std::array<std::int64_t, 3>;
using LatticeReflection = std::function<LatticeIndex(const LatticeIndex&)>;

/// The reflections of indices that may be one of the lattice.
std::vector<LatticeReflection> index_reflections(const LatticeIndex& size, LatticeBasis basis) {
  std::vector<LatticeReflection> maps;
  for (std::size_t a = 0; a < 3; ++a) {
    std::vector<std::int64_t> sums{size[a] - 1};
    if (basis == LatticeBasis::uniform_cubic) {
      sums.resize(static_cast<std::size_t>(2 * size[a] - 1));
      std::iota(sums.begin(), sums.end(), std::int64_t{0});
    } else {
      sums.insert(sums.end(), {0, 2 * (size[a] - 1)});
    }
    for (const std::int64_t sum : sums) {
      maps.push_back([a, sum](LatticeIndex i) {
        i[a] = sum - i[a];
        return i;
      });
    }
    const std::size_t b = (a + 1) % 3;
    if (size[a] != size[b]) continue;
    maps.push_back([a, b](LatticeIndex i) {
      std::swap(i[a], i[b]);
      return i;
    });
    maps.push_back([a, b, last = size[a] - 1](LatticeIndex i) {
      i[a] = last - std::exchange(i[b], last - i[a]);
      return i;
    });
  }
  return maps;
}

/// A mesh whose points are where their functions are taken, and the planes in which they are reflected.
struct PlacedMesh {
  Mesh mesh;
  std::vector<std::uint8_t> reflected;
  std::size_t outside = 0;
};

/// The first of the images in the planes of `image` and any of the matched ones that lies in the lattice.
PlacedMesh placed(const Mesh& mesh, const Symmetry& symmetry, const LatticeFunctions& functions, unsigned image, unsigned matched,
                  const RunContext& context) {
  PlacedMesh result{mesh, std::vector<std::uint8_t>(mesh.point_count(), static_cast<std::uint8_t>(image)), 0};
  for (Vec3& x : result.mesh.points) x = symmetry.image(x, image);
  std::vector<std::uint32_t> left(mesh.point_count());
  std::iota(left.begin(), left.end(), 0u);
  for (unsigned planes = 0; planes <= matched && !left.empty(); ++planes) {
    if ((planes & ~matched) != 0) continue;
    std::vector<Vec3> places;
    for (const std::uint32_t i : left) places.push_back(symmetry.image(mesh.points[i], image | planes));
    const std::vector<std::uint32_t> outside = functions.coordinates(places, context).outside;
    std::vector<std::uint32_t> still;
    for (std::size_t j = 0, o = 0; j < left.size(); ++j) {
      if (o < outside.size() && outside[o] == j) {
        still.push_back(left[j]);
        ++o;
        continue;
      }
      result.mesh.points[left[j]] = places[j];
      result.reflected[left[j]] = static_cast<std::uint8_t>(image | planes);
    }
    left = std::move(still);
  }
  result.outside = left.size();
  return result;
}

std::string plane_name(std::size_t k) { return "symmetry[" + std::to_string(k) + "]"; }

/// Whether a box that was turned by so many sectors may have a place in common with another box.
bool may_meet(const Box& turned, const Symmetry& symmetry, unsigned image, const Box& other) {
  Box around;
  for (unsigned corner = 0; corner < 8; ++corner) {
    Vec3 x{};
    for (std::size_t k = 0; k < 3; ++k) x[k] = (corner >> k & 1u) != 0 ? turned.max[k] : turned.min[k];
    around.add(symmetry.image(x, image));
  }
  const double rounding = image_tolerance * around.diagonal();
  for (std::size_t k = 0; k < 3; ++k) {
    if (around.min[k] > other.max[k] + rounding || around.max[k] < other.min[k] - rounding) return false;
  }
  return true;
}

/// Every sector has an image of the lattice. Those that reach the mesh move it, where several do they add up.
ControlModel sector_controls(const LatticeOptions& options, const Mesh& mesh, const Symmetry& symmetry,
                             const RunContext& context) {
  ControlModel model;
  model.matches.sectors = static_cast<unsigned>(symmetry.sector().count());
  const Lattice lattice = lattice_of(options, mesh);
  auto controls = std::make_shared<Mesh>();
  controls->points = options.control_points.empty() ? lattice.control_points() : options.control_points;
  model.controls = controls;
  const Box reach = bounding_box(controls->points), model_box = bounding_box(mesh.points);
  std::vector<std::uint32_t> reached(mesh.point_count(), 0);  // by how many
  std::vector<Vec3> crossings;
  for (unsigned image = 0; image < model.matches.sectors; ++image) {
    const unsigned back = symmetry.inverse(image);
    if (image != 0 && !may_meet(model_box, symmetry, back, reach)) continue;
    Mesh placed = mesh;
    for (Vec3& x : placed.points) x = symmetry.image(x, back);
    ModelLattice made = control_lattice(placed, options, context);
    if (image == 0) {
      model.notes = std::move(made.notes);
      model.in_space = made.in_space;
    } else if (made.outside.size() == mesh.point_count()) {
      continue;
    }
    model.images.push_back({image, made.rows, {}});
    for (std::uint32_t& count : reached) ++count;
    for (const std::uint32_t id : made.outside) --reached[id];
    const std::vector<Vec3> torn = boundary_crossings(placed, options, made);
    crossings.insert(crossings.end(), torn.begin(), torn.end());
  }
  for (std::uint32_t id = 0; id < reached.size(); ++id) {
    if (reached[id] == 0) model.outside.push_back(id);
  }
  const auto several = std::count_if(reached.begin(), reached.end(), [](std::uint32_t count) { return count > 1; });
  if (several > 0) {
    model.notes.push_back("Lattices of " + std::to_string(model.images.size()) + " sectors reach the mesh, " +
                          std::to_string(several) +
                          " points are in several of them, where displacements add up; keep control points there at rest, or "
                          "the lattice within its sector");
  }
  if (!crossings.empty()) {
    model.crossings = std::make_shared<const LatticeRows>(lattice, LatticeCoordinates{std::move(crossings), {}});
  }
  return model;
}

constexpr const char* how_to_match = "place it symmetrically about the plane, let it end in the plane, or keep it away from it";

}  // namespace

LatticeOptions whole_lattice(LatticeOptions options, const Mesh& mesh, const Symmetry& symmetry) {
  if (symmetry.planes() == 0 || options.frame) return options;
  const Lattice lattice = lattice_around(options, whole_box(mesh, symmetry));
  options.frame = lattice.frame();
  options.points = {lattice.axis(0).size(), lattice.axis(1).size(), lattice.axis(2).size()};
  return options;
}

std::vector<std::uint32_t> lattice_images(const Lattice& lattice, LatticeBasis basis, const std::vector<Vec3>& places,
                                          const std::function<Vec3(const Vec3&)>& reflect, double tolerance) {
  LatticeIndex size{};
  for (std::size_t k = 0; k < 3; ++k) size[k] = static_cast<std::int64_t>(lattice.axis(k).size());
  const auto index_of = [&](std::size_t p) {
    const auto q = static_cast<std::int64_t>(p);
    return LatticeIndex{q % size[0], q / size[0] % size[1], q / size[0] / size[1]};
  };
  for (const LatticeReflection& map : index_reflections(size, basis)) {
    std::vector<std::uint32_t> images(places.size(), ControlMatches::no_control);
    bool fits = true;
    for (std::size_t p = 0; p < places.size() && fits; ++p) {
      const LatticeIndex to = map(index_of(p));
      bool within = true;
      for (std::size_t k = 0; k < 3; ++k) within = within && to[k] >= 0 && to[k] < size[k];
      if (!within) continue;
      const std::size_t q =
          lattice.number(static_cast<std::size_t>(to[0]), static_cast<std::size_t>(to[1]), static_cast<std::size_t>(to[2]));
      images[p] = static_cast<std::uint32_t>(q);
      fits = distance(reflect(places[p]), places[q]) <= tolerance;
    }
    if (fits) return images;
  }
  return {};
}

ControlModel lattice_controls(const LatticeOptions& given, const Mesh& mesh, const Symmetry& symmetry,
                              const RunContext& context) {
  if (symmetry.is_sector()) return sector_controls(given, mesh, symmetry, context);
  const LatticeOptions options = whole_lattice(given, mesh, symmetry);
  const Lattice lattice = lattice_of(options, mesh);
  auto controls = std::make_shared<Mesh>();
  controls->points = options.control_points.empty() ? lattice.control_points() : options.control_points;
  ControlModel model;
  model.controls = controls;
  unsigned matched = 0;
  for (std::size_t k = 0; k < symmetry.planes(); ++k) {
    const double tolerance = image_tolerance * bounding_box(controls->points).diagonal() + 2 * symmetry.reach(k);
    model.matches.images.push_back(lattice_images(
        lattice, options.basis, controls->points, [&](const Vec3& x) { return symmetry.reflected(x, k); }, tolerance));
    if (!model.matches.images.back().empty()) {
      matched |= 1u << k;
    } else if (!given.frame) {
      refuse_argument("method.ffd.lattice: an automatic lattice is not symmetric about " + plane_name(k) +
                      ", which is not perpendicular to an axis; give `frame` with its axes along and across the plane");
    }
  }
  std::vector<Vec3> crossings;
  for (unsigned image = 0; image < 1u << symmetry.planes(); ++image) {
    if ((image & matched) != 0) continue;
    ControlImage& to = model.images.emplace_back();
    to.image = image;
    ModelLattice made = symmetry.planes() == 0 ? control_lattice(mesh, options, context) : [&] {
      const LatticeFunctions functions(lattice, options.control_points);
      PlacedMesh at = placed(mesh, symmetry, functions, image, matched, context);
      ModelLattice of_image = control_lattice(at.mesh, options, context);
      const std::vector<Vec3> torn = boundary_crossings(at.mesh, options, of_image);
      crossings.insert(crossings.end(), torn.begin(), torn.end());
      to.reflected = std::move(at.reflected);
      return of_image;
    }();
    if (symmetry.planes() == 0) crossings = boundary_crossings(mesh, options, made);
    const std::size_t reached = mesh.point_count() - made.outside.size();
    if (image == 0) {
      model.notes = std::move(made.notes);
      model.outside = std::move(made.outside);
      model.in_space = made.in_space;
      to.rows = made.rows;
      continue;
    }
    std::vector<std::uint32_t> both;
    std::set_intersection(model.outside.begin(), model.outside.end(), made.outside.begin(), made.outside.end(),
                          std::back_inserter(both));
    model.outside = std::move(both);
    if (reached == 0) {
      to.reflected.clear();
      continue;
    }
    to.rows = made.rows;
    std::string planes;
    for (std::size_t k = 0; k < symmetry.planes(); ++k) {
      if ((image >> k & 1u) != 0) planes += (planes.empty() ? "" : " and ") + plane_name(k);
    }
    model.notes.push_back("The lattice is not symmetric about " + planes + " but reaches through: its mirror image moves " +
                          std::to_string(reached) + " points too, and where both do, displacements add up; " + how_to_match);
  }
  if (!crossings.empty()) {
    model.crossings = std::make_shared<const LatticeRows>(lattice, LatticeCoordinates{std::move(crossings), {}});
  }
  return model;
}

}  // namespace deform
