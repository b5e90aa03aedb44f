// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/deformers/cage/cage_images.h"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <numeric>
#include <set>
#include <string>
#include <utility>

#include "core/base/parallel.h"
#include "core/base/vectors.h"
#include "core/deformers/option_checks.h"
#include "core/mesh/cages/mirror_search.h"

namespace deform {

namespace {

constexpr double image_tolerance = 1e-9;     // of the diagonal: distance of vertices from the images of others, and from planes
constexpr double beside_face = 1e-5;         // of the diagonal: distance of points from the face of a cage in a plane
constexpr double most_through_plane = 1e-6;  // sum of coordinates of vertices beyond the plane at a point in it
constexpr std::size_t cut_points_per_task = 64;

std::string plane_name(std::size_t k) { return "symmetry[" + std::to_string(k) + "]"; }

/// Points of the mesh in a plane in which a cage ends, outside of its face there.
struct CutPoints {
  std::size_t count = 0;
  PointId first = 0;

  void refuse_any(std::size_t plane) const {
    if (count == 0) return;
    refuse_argument("method.cage: the cage ends in " + plane_name(plane) + ", but " + std::to_string(count) +
                    " points of the mesh in that plane are not in the face of the cage there, the first is " +
                    std::to_string(first) + "; make that face larger, or the cage its own mirror image");
  }
};

/// Places on the side of a cage that ends in planes.
class CageSides {
 public:
  CageSides(Symmetry symmetry, std::vector<CagePlanes::End> ends) : symmetry_(std::move(symmetry)), ends_(std::move(ends)) {}

  /// The planes (mask) in which a place must be reflected to be there.
  unsigned away(const Vec3& place) const {
    const Vec3 at = symmetry_.coordinates(place);
    unsigned planes = 0;
    for (const CagePlanes::End& end : ends_) {
      if (end.side * at[end.plane] < -symmetry_.reach(end.plane)) planes |= 1u << end.plane;
    }
    return planes;
  }
  std::size_t bytes() const { return sizeof *this + ends_.size() * sizeof(CagePlanes::End); }

 private:
  const Symmetry symmetry_;
  const std::vector<CagePlanes::End> ends_;
};

/// The functions of a cage that ends in planes, on its side of them.
class OneSide : public SpaceFunctions {
 public:
  /// `placed`: memory of the places of points that `rows` holds besides the mesh, in bytes.
  OneSide(std::shared_ptr<const CageRows> rows, CageSides sides, std::size_t placed)
      : rows_(std::move(rows)), sides_(std::move(sides)), placed_(placed) {}

  Outside rows(std::span<const Vec3> places, std::uint64_t first, const Use& use) const override {
    Outside outside;
    for (std::size_t i = 0; i < places.size(); ++i) {
      if (sides_.away(places[i]) != 0) {
        outside.push_back(i);
        continue;
      }
      rows_->rows(places.subspan(i, 1), first + i,
                  [&](std::size_t, std::int64_t column, double value) { use(i, column, value); });
    }
    return outside;
  }
  std::size_t bytes() const override { return rows_->bytes() + sides_.bytes() + placed_; }

 private:
  const std::shared_ptr<const CageRows> rows_;
  const CageSides sides_;
  const std::size_t placed_;
};

/// For each vertex of a cage the one that is its image, or no_control.
std::vector<std::uint32_t> vertex_images(const Cage& cage, const std::function<Vec3(const Vec3&)>& reflect, double tolerance) {
  const std::vector<Vec3>& at = cage.vertices();
  std::vector<std::uint32_t> order(at.size());  // ascending in x
  std::iota(order.begin(), order.end(), 0u);
  std::sort(order.begin(), order.end(), [&](std::uint32_t a, std::uint32_t b) { return at[a] < at[b]; });
  std::vector<std::uint32_t> result;
  for (std::uint32_t v = 0; v < at.size(); ++v) {
    const Vec3 place = reflect(at[v]);
    auto found = std::lower_bound(order.begin(), order.end(), place[0] - tolerance,
                                  [&](std::uint32_t a, double x) { return at[a][0] < x; });
    while (found != order.end() && at[*found][0] <= place[0] + tolerance && distance(at[*found], place) > tolerance) ++found;
    const bool known = found != order.end() && at[*found][0] <= place[0] + tolerance;
    result.push_back(known ? *found : ControlMatches::no_control);
  }
  return result;
}

/// `next` of a cage of one sector: the images of its vertices, by one turn and back. Empty if it does not end in periodic
/// boundaries: fewer than three vertices off the axis have an image, or an image has one of its own.
std::vector<std::vector<std::uint32_t>> ends_in_sector(const std::vector<std::uint32_t>& next, std::size_t count) {
  std::vector<std::uint32_t> previous(next.size(), ControlMatches::no_control);
  std::size_t pairs = 0;
  for (std::uint32_t v = 0; v < next.size(); ++v) {
    if (next[v] == ControlMatches::no_control) continue;
    previous[next[v]] = v;
    if (next[v] == v) continue;
    ++pairs;
    const std::uint32_t further = next[next[v]];
    if (further != ControlMatches::no_control && !(count == 2 && further == v)) return {};
  }
  if (pairs < (count == 2 ? 6 : 3)) return {};
  return {next, previous};
}

/// In which vertices of a cage on one side of a plane are images of themselves, the others have none; empty for other cages.
std::vector<std::uint32_t> ends_in_plane(const Cage& cage, const Symmetry& symmetry, std::size_t plane, double side,
                                         double tolerance) {
  std::vector<std::uint32_t> image(cage.size(), ControlMatches::no_control);
  for (std::uint32_t v = 0; v < cage.size(); ++v) {
    const double height = side * symmetry.coordinates(cage.vertices()[v])[plane];
    if (height < -tolerance) return {};
    if (height <= tolerance) image[v] = v;
  }
  return image;
}

/// The mesh on the side of the cage. `reflected`: the planes of each point, empty if there are none.
std::shared_ptr<const Mesh> placed(const std::shared_ptr<const Mesh>& mesh, const Symmetry& symmetry, const CageSides& sides,
                                   std::vector<std::uint8_t>& reflected) {
  for (const Vec3& x : mesh->points) reflected.push_back(static_cast<std::uint8_t>(sides.away(x)));
  if (std::all_of(reflected.begin(), reflected.end(), [](std::uint8_t planes) { return planes == 0; })) {
    reflected.clear();
    return mesh;
  }
  auto result = std::make_shared<Mesh>();
  for (std::size_t i = 0; i < reflected.size(); ++i) result->points.push_back(symmetry.image(mesh->points[i], reflected[i]));
  return result;
}

}  // namespace

CageImages cage_images(const Cage& cage, const std::function<Vec3(const Vec3&)>& reflect, double tolerance) {
  CageImages result{vertex_images(cage, reflect, tolerance), {}};
  const auto none = std::find(result.image.begin(), result.image.end(), ControlMatches::no_control);
  if (none != result.image.end()) {
    return {{}, "vertex " + std::to_string(none - result.image.begin()) + " has no image"};
  }
  const auto sorted = [](Cage::Triangle t) {
    std::sort(t.begin(), t.end());
    return t;
  };
  std::set<Cage::Triangle> known;
  for (const Cage::Triangle& t : cage.triangles()) known.insert(sorted(t));
  for (std::size_t t = 0; t < cage.triangles().size(); ++t) {
    const auto& [a, b, c] = cage.triangles()[t];
    if (known.contains(sorted({result.image[a], result.image[b], result.image[c]}))) continue;
    return {{},
            "its vertices are images of each other, but triangle " + std::to_string(t) +
                " is not that of another: quadrilaterals must be split alike everywhere"};
  }
  return result;
}

std::vector<CagePlane> own_planes(const Cage& cage) {
  std::vector<TriangleCorners> triangles;
  for (const auto& [a, b, c] : cage.triangles()) {
    triangles.push_back({cage.vertices()[a], cage.vertices()[b], cage.vertices()[c]});
  }
  const double tolerance = image_tolerance * cage.diagonal();
  std::vector<CagePlane> candidates = mirror_candidates(triangles), planes;
  const SurfaceMirrors mirrors = surface_mirrors(triangles, tolerance);
  candidates.insert(candidates.end(), mirrors.planes.begin(), mirrors.planes.end());
  for (const CagePlane& plane : candidates) {
    const bool known = std::any_of(planes.begin(), planes.end(), [&](const CagePlane& other) {
      return std::abs(dot(plane.normal, other.normal)) > 1 - image_tolerance;
    });
    if (known) continue;
    const auto reflect = [&](const Vec3& x) { return reflected(plane, x); };
    if (!cage_images(cage, reflect, tolerance).image.empty()) planes.push_back(plane);
  }
  return planes;
}

CagePlanes cage_planes(const Cage& cage, const Symmetry& symmetry) {
  CagePlanes result;
  if (symmetry.is_sector()) {
    result.matches.sectors = static_cast<unsigned>(symmetry.sector().count());
    const auto turn = [&](const Vec3& x) { return symmetry.image(x, 1); };
    CageImages next = cage_images(cage, turn, image_tolerance * cage.diagonal());
    if (!next.image.empty()) {
      result.matches.images.push_back(std::move(next.image));
      return result;
    }
    result.matches.images =
        ends_in_sector(vertex_images(cage, turn, image_tolerance * cage.diagonal()), symmetry.sector().count());
    result.in_sector = !result.matches.images.empty();
    if (!result.in_sector) {
      refuse_argument("method.cage: the cage is not that of a wheel of " + std::to_string(result.matches.sectors) +
                      " sectors: turned by one of them it is another (" + next.no_image +
                      "); it must be around the whole wheel, the same in every sector, or with coordinates GREEN end in the "
                      "periodic boundaries, with the same vertices in both");
    }
    return result;
  }
  for (std::size_t k = 0; k < symmetry.planes(); ++k) {
    const double tolerance = image_tolerance * cage.diagonal() + 2 * symmetry.reach(k);
    CageImages own = cage_images(
        cage, [&](const Vec3& x) { return symmetry.reflected(x, k); }, tolerance);
    for (const double side : {1.0, -1.0}) {
      if (!own.image.empty()) break;
      own.image = ends_in_plane(cage, symmetry, k, side, tolerance);
      if (!own.image.empty()) result.ends.push_back({k, side});
    }
    if (own.image.empty()) {
      refuse_argument(
          "method.cage: the cage is not its own mirror image in " + plane_name(k) + " (" + own.no_image +
          "), nor does it end in that plane; make it symmetric, or leave out what is behind the plane and close it there");
    }
    result.matches.images.push_back(std::move(own.image));
  }
  return result;
}

CageControls cage_controls(const CageOptions& options, const std::shared_ptr<const Mesh>& mesh, const Symmetry& symmetry) {
  CageControls controls{cage_model(options, mesh), mesh};
  ControlModel& model = controls.model;
  const Cage cage = cage_of(options);
  CagePlanes planes = cage_planes(cage, symmetry);
  if (planes.in_sector) {
    refuse_argument(
        "method.cage: the cage ends in the periodic boundaries of its sector, but coordinates MEAN_VALUE reach beyond "
        "it; use coordinates GREEN, or a cage around the whole wheel, the same in every sector");
  }
  model.matches = std::move(planes.matches);
  if (planes.ends.empty()) return controls;
  const CageSides sides(symmetry, std::move(planes.ends));
  ControlImage& only = model.images.front();
  controls.places = placed(mesh, symmetry, sides, only.reflected);
  const auto rows = std::make_shared<const CageRows>(cage, controls.places);
  only.rows = rows;
  model.in_space = std::make_shared<const OneSide>(rows, sides, only.reflected.size() * sizeof(Vec3));
  return controls;
}

void check_faces(const Cage& cage, const ControlMatches& matches, const Mesh& places, const Symmetry& symmetry) {
  for (std::size_t k = 0; k < matches.images.size(); ++k) {
    const std::vector<std::uint32_t>& image = matches.images[k];
    if (std::find(image.begin(), image.end(), ControlMatches::no_control) == image.end()) continue;  // it is its own image
    std::vector<TriangleCorners> faces;
    for (const Cage::Triangle& t : cage.triangles()) {
      const bool lies = std::all_of(t.begin(), t.end(), [&](std::uint32_t v) { return image[v] != ControlMatches::no_control; });
      if (lies) faces.push_back({cage.vertices()[t[0]], cage.vertices()[t[1]], cage.vertices()[t[2]]});
    }
    const double tolerance = beside_face * cage.diagonal() + 2 * symmetry.reach(k);
    const ClosestPoint closest(std::move(faces));
    CutPoints outside;
    for (PointId p = static_cast<PointId>(places.point_count()); p-- > 0;) {
      if ((symmetry.on(p) >> k & 1u) == 0) continue;
      if (!closest.empty() && distance(closest(places.points[p]), places.points[p]) <= tolerance) continue;
      ++outside.count;
      outside.first = p;
    }
    outside.refuse_any(k);
  }
}

void check_cut(const ControlModel& model, const Mesh& mesh, const Symmetry& symmetry, const RunContext& context) {
  for (std::size_t k = 0; k < model.matches.images.size(); ++k) {
    const std::vector<std::uint32_t>& image = model.matches.images[k];
    if (std::find(image.begin(), image.end(), ControlMatches::no_control) == image.end()) continue;
    std::vector<PointId> in_plane;
    for (PointId p = 0; p < mesh.point_count(); ++p) {
      if ((symmetry.on(p) >> k & 1u) != 0) in_plane.push_back(p);
    }
    std::vector<std::uint8_t> led_away(in_plane.size(), 0);
    parallel_for(context, in_plane.size(), cut_points_per_task, [&](std::size_t begin, std::size_t end) {
      for (std::size_t i = begin; i < end; ++i) {
        double through = 0;
        model.images.front().rows->for_each(in_plane[i], [&](std::int64_t v, double value) {
          if (image[static_cast<std::size_t>(v)] == ControlMatches::no_control) through += std::abs(value);
        });
        led_away[i] = through > most_through_plane ? 1 : 0;
      }
    });
    CutPoints outside;
    for (std::size_t i = in_plane.size(); i-- > 0;) {
      if (led_away[i] == 0) continue;
      ++outside.count;
      outside.first = in_plane[i];
    }
    outside.refuse_any(k);
  }
}

}  // namespace deform
