// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/deformers/cage/whole_cage.h"

#include <algorithm>
#include <array>
#include <map>
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
  std::vector<ControlSources::Source> numbers;  ///< of the triangles, with their images

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
    const auto [number, image] = half.numbers[t];
    whole.numbers.push_back({number, image});
    whole.numbers.push_back({number, image ^ 1u << plane});
  }
  return whole;
}

/// Which triangles of a cage that ends in periodic boundaries lie in them, in pairs of a triangle and its image.
std::vector<char> in_boundaries(const CageSurface& one, const std::vector<std::uint32_t>& next) {
  const auto sorted = [](Cage::Triangle t) {
    std::sort(t.begin(), t.end());
    return t;
  };
  std::map<Cage::Triangle, std::size_t> number;
  for (std::size_t t = 0; t < one.triangles.size(); ++t) number[sorted(one.triangles[t])] = t;
  std::vector<char> result(one.triangles.size(), 0);
  for (std::size_t t = 0; t < one.triangles.size(); ++t) {
    const auto& [a, b, c] = one.triangles[t];
    const auto is_matched = [&](std::uint32_t v) { return next[v] != ControlMatches::no_control; };
    if (!is_matched(a) || !is_matched(b) || !is_matched(c)) continue;
    const auto image = number.find(sorted({next[a], next[b], next[c]}));
    if (image != number.end()) result[t] = result[image->second] = 1;
  }
  return result;
}

/// A cage that ends in periodic boundaries with its images in all sectors. `matches`: its vertices turned by one, and back.
CageSurface turned_round(const CageSurface& one, const Symmetry& symmetry, const ControlMatches& matches) {
  const auto n = static_cast<std::uint32_t>(one.places.size());
  const std::vector<char> inside = in_boundaries(one, matches.images[0]);
  // The vertex whose image one is, or itself.
  std::vector<std::uint32_t> first(n);
  for (std::uint32_t v = 0; v < n; ++v) {
    const std::uint32_t back = matches.images[1][v];
    const bool is_first = back == ControlMatches::no_control || (matches.sectors == 2 && v < back);
    first[v] = is_first ? v : back;
  }
  std::vector<char> used(n, 0);
  for (std::size_t t = 0; t < one.triangles.size(); ++t) {
    for (const std::uint32_t v : one.triangles[t]) used[first[v]] |= inside[t] == 0 ? 1 : 0;
  }
  const auto on_axis = [&](std::uint32_t v) { return matches.images[0][v] == v; };
  std::size_t size = 0;
  for (std::uint32_t v = 0; v < n; ++v) size += used[v] == 0 ? 0 : on_axis(v) ? 1 : matches.sectors;
  if (size > Cage::most_vertices) {
    refuse_argument("method.cage: in all " + std::to_string(matches.sectors) + " sectors the cage has " + std::to_string(size) +
                    " vertices, at most " + std::to_string(Cage::most_vertices) + " are possible");
  }
  CageSurface whole;
  std::vector<std::uint32_t> number(n);  // of image 0
  for (std::uint32_t v = 0; v < n; ++v) {
    if (used[v] == 0) continue;
    number[v] = static_cast<std::uint32_t>(whole.places.size());
    for (unsigned image = 0; image < (on_axis(v) ? 1 : matches.sectors); ++image) {
      whole.add({v, image}, symmetry.image(one.places[v], image));
    }
  }
  for (unsigned image = 0; image < matches.sectors; ++image) {
    const auto corner = [&](std::uint32_t v) {
      const std::uint32_t of = first[v];
      return number[of] + (on_axis(v) ? 0 : of == v ? image : symmetry.composed(image, 1));
    };
    for (std::size_t t = 0; t < one.triangles.size(); ++t) {
      if (inside[t] != 0) continue;
      const auto& [a, b, c] = one.triangles[t];
      whole.triangles.push_back({corner(a), corner(b), corner(c)});
      whole.numbers.push_back({one.numbers[t].control, image});
    }
  }
  return whole;
}

}  // namespace

std::vector<std::string> WholeCage::idle_notes(const Setup& setup, const SelectedRegions& regions) const {
  std::vector<char> left_out(controls, 1);
  for (const auto& vertex : vertices) {
    for (const auto& [image, control] : matches.images_of(vertex.control)) left_out[control] = 0;
  }
  std::vector<std::string> result;
  for (std::size_t h = 0; h < regions.handles.size(); ++h) {
    const auto& ids = regions.handles[h];
    const auto idle =
        static_cast<std::size_t>(std::count_if(ids.begin(), ids.end(), [&](PointId v) { return left_out[v] != 0; }));
    if (idle == 0) continue;
    result.push_back("Handle \"" + setup.handles[h].name +
                     "\": " + (idle == ids.size() ? "its vertices have" : std::to_string(idle) + " of its vertices have") +
                     " only triangles where the cage ends, which are inside of the whole cage, and move nothing.");
  }
  return result;
}

std::size_t WholeCage::bytes() const {
  return cage.bytes() + (vertices.size() + triangles.size()) * sizeof(ControlSources::Source) + matches.bytes();
}

WholeCage whole_cage(const CageOptions& options, const Symmetry& symmetry) {
  Cage given = cage_of(options);
  const std::size_t controls = given.size();
  CagePlanes planes = cage_planes(given, symmetry);
  std::vector<std::string> notes{size_note(given)};
  CageSurface surface;
  for (std::uint32_t v = 0; v < controls; ++v) surface.add({v, 0}, given.vertices()[v]);
  surface.triangles = given.triangles();
  for (std::uint32_t t = 0; t < surface.triangles.size(); ++t) surface.numbers.push_back({t, 0});
  if (planes.ends.empty() && !planes.in_sector) {
    return {std::move(given), std::move(surface.vertices), std::move(surface.numbers), std::move(planes.matches), controls,
            std::move(notes)};
  }
  std::size_t copies = std::size_t{1} << planes.ends.size();
  if (planes.in_sector) {
    copies = planes.matches.sectors;
    surface = turned_round(surface, symmetry, planes.matches);
  }
  for (const CagePlanes::End& end : planes.ends) {
    surface = mirrored(surface, symmetry, end.plane, planes.matches.images[end.plane]);
  }
  const bool some_inside = surface.triangles.size() < copies * given.triangles().size();
  try {
    Cage cage(std::move(surface.places), std::move(surface.triangles));
    notes.push_back(std::string("With its ") + (planes.in_sector ? "images in all sectors" : "mirror images") +
                    (some_inside ? ", and without its triangles where it ends," : "") + " it has " + std::to_string(cage.size()) +
                    " vertices and " + std::to_string(cage.triangles().size()) + " triangles.");
    return {std::move(cage),
            std::move(surface.vertices),
            std::move(surface.numbers),
            std::move(planes.matches),
            controls,
            std::move(notes),
            true};
  } catch (const Error& error) {
    throw Error(error.code(),
                std::string("method.cage: with its images, which are numbered behind it, it is no cage: ") + error.what());
  }
}

}  // namespace deform
