// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/deformers/cage/whole_cage.h"

#include <algorithm>
#include <array>
#include <utility>

#include "core/base/error.h"
#include "core/base/vectors.h"
#include "core/deformers/cage/cage_images.h"
#include "core/deformers/cage/cage_model.h"
#include "core/deformers/option_checks.h"

namespace deform {

namespace {

/// A cage in the making, not closed perhaps.
struct CageSurface {
  std::vector<ControlSources::Source> vertices;
  std::vector<Vec3> places;
  std::vector<Cage::Triangle> triangles;
  std::vector<std::uint32_t> numbers;  ///< of the triangles

  std::uint32_t add(const ControlSources::Source& vertex, const Vec3& place) {
    vertices.push_back(vertex);
    places.push_back(place);
    return static_cast<std::uint32_t>(places.size() - 1);
  }
};

/// A surface that ends in a plane with its mirror image. `in_plane`: of each vertex of the setup's cage itself where it lies in
/// the plane.
CageSurface mirrored(const CageSurface& half, const Symmetry& symmetry, std::size_t plane,
                     const std::vector<std::uint32_t>& in_plane) {
  std::vector<char> joined(half.places.size(), 0), used(half.places.size(), 0), inside;
  for (const Cage::Triangle& t : half.triangles) {
    const bool lies = std::all_of(
        t.begin(), t.end(), [&](std::uint32_t v) { return in_plane[half.vertices[v].control] != ControlMatches::no_control; });
    inside.push_back(lies ? 1 : 0);
    for (const std::uint32_t v : t) (lies ? joined : used)[v] = 1;
  }
  CageSurface whole;
  std::vector<std::uint32_t> own(half.places.size()), other(half.places.size());
  for (std::size_t v = 0; v < half.places.size(); ++v) {
    if (used[v] == 0) continue;
    const Vec3& x = half.places[v];
    own[v] = whole.add(half.vertices[v], joined[v] != 0 ? 0.5 * (x + symmetry.reflected(x, plane)) : x);
  }
  for (std::size_t v = 0; v < half.places.size(); ++v) {
    if (used[v] == 0) continue;
    const auto [control, image] = half.vertices[v];
    other[v] = joined[v] != 0 ? own[v] : whole.add({control, image ^ 1u << plane}, symmetry.reflected(half.places[v], plane));
  }
  for (std::size_t t = 0; t < half.triangles.size(); ++t) {
    if (inside[t] != 0) continue;
    const auto& [a, b, c] = half.triangles[t];
    whole.triangles.push_back({own[a], own[b], own[c]});
    whole.triangles.push_back({other[a], other[c], other[b]});
    whole.numbers.insert(whole.numbers.end(), 2, half.numbers[t]);
  }
  return whole;
}

}  // namespace

std::vector<std::string> WholeCage::idle_notes(const Setup& setup, const SelectedRegions& regions) const {
  std::vector<char> left_out(controls, 1);
  for (const auto& vertex : vertices) left_out[vertex.control] = 0;
  std::vector<std::string> result;
  for (std::size_t h = 0; h < regions.handles.size(); ++h) {
    const auto& ids = regions.handles[h];
    const auto idle =
        static_cast<std::size_t>(std::count_if(ids.begin(), ids.end(), [&](PointId v) { return left_out[v] != 0; }));
    if (idle == 0) continue;
    result.push_back("Handle \"" + setup.handles[h].name +
                     "\": " + (idle == ids.size() ? "its vertices have" : std::to_string(idle) + " of its vertices have") +
                     " only triangles in a symmetry plane, which are inside of the whole cage, and move nothing.");
  }
  return result;
}

std::size_t WholeCage::bytes() const {
  return cage.bytes() + vertices.size() * sizeof(ControlSources::Source) + triangles.size() * sizeof(std::uint32_t) +
         matches.bytes();
}

WholeCage whole_cage(const CageOptions& options, const Symmetry& symmetry) {
  Cage given = cage_of(options);
  const std::size_t controls = given.size();
  CagePlanes planes = cage_planes(given, symmetry);
  std::vector<std::string> notes{size_note(given)};
  CageSurface surface;
  for (std::uint32_t v = 0; v < controls; ++v) surface.add({v, 0}, given.vertices()[v]);
  surface.triangles = given.triangles();
  for (std::uint32_t t = 0; t < surface.triangles.size(); ++t) surface.numbers.push_back(t);
  if (planes.ends.empty()) {
    return {std::move(given), std::move(surface.vertices), std::move(surface.numbers), std::move(planes.matches), controls,
            std::move(notes)};
  }
  for (const CagePlanes::End& end : planes.ends) {
    surface = mirrored(surface, symmetry, end.plane, planes.matches.images[end.plane]);
  }
  const bool some_inside = surface.triangles.size() < given.triangles().size() << planes.ends.size();
  try {
    Cage cage(std::move(surface.places), std::move(surface.triangles));
    notes.push_back("With its mirror images" + std::string(some_inside ? ", and without its triangles in symmetry planes," : "") +
                    " it has " + std::to_string(cage.size()) + " vertices and " + std::to_string(cage.triangles().size()) +
                    " triangles.");
    return {std::move(cage), std::move(surface.vertices), std::move(surface.numbers), std::move(planes.matches), controls,
            std::move(notes)};
  } catch (const Error& error) {
    throw Error(error.code(),
                std::string("method.cage: with its mirror images, which are numbered behind it, it is no cage: ") + error.what());
  }
}

}  // namespace deform
