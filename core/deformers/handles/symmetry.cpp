// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/deformers/handles/symmetry.h"

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <limits>
#include <sstream>

#include "core/base/direction.h"
#include "core/base/error.h"
#include "core/base/number_text.h"
#include "core/base/vectors.h"
#include "core/numerics/dense/decompositions.h"

namespace deform {

namespace {

Vec3 normalized(const Vec3& v) { return v / norm(v); }

std::string field(std::size_t plane) { return "symmetry[" + std::to_string(plane) + "]"; }

/// A unit vector across two others, or one at right angles to one.
Vec3 across(const Vec3& n) {
  std::size_t least = 0;
  for (std::size_t k = 1; k < 3; ++k) {
    if (std::abs(n[k]) < std::abs(n[least])) least = k;
  }
  Vec3 e{};
  e[least] = 1;
  return normalized(e - n[least] * n);
}

std::size_t main_axis(const Vec3& n) {
  std::size_t main = 0;
  for (std::size_t k = 1; k < 3; ++k) {
    if (std::abs(n[k]) > std::abs(n[main])) main = k;
  }
  return main;
}

}  // namespace

/// One plane on the mesh, before they are made orthogonal.
struct Symmetry::Found {
  Vec3 point{}, normal{};
  std::vector<PointId> region;  ///< whose points it was found from
};

void Symmetry::find(const SymmetryPlane& plane, std::size_t index, const Mesh& mesh, const Box& box, Found& found) {
  if (const auto* given = std::get_if<SymmetryPlane::Plane>(&plane.kind)) {
    if (!is_finite(given->point)) throw Error(ErrorCode::invalid_argument, field(index) + ".point: must be finite");
    if (const char* problem = direction_problem(given->normal)) {
      throw Error(ErrorCode::invalid_argument, field(index) + ".normal: it " + problem);
    }
    found.point = given->point;
    found.normal = normalized(given->normal);
    return;
  }
  const std::string what = field(index) + ".region";
  found.region = select(std::get<Region>(plane.kind), mesh, what);
  if (found.region.empty()) throw Error(ErrorCode::invalid_argument, what + ": " + no_point_text(mesh));
  // About the first point, so that points of one coordinate have the mean of exactly that coordinate.
  const auto count = static_cast<double>(found.region.size());
  Eigen::Vector3d mean = Eigen::Vector3d::Zero();
  Eigen::Matrix3d scatter = Eigen::Matrix3d::Zero();
  const auto local = [&](PointId id) {
    const Vec3 d = mesh.points[id] - mesh.points[found.region[0]];
    return Eigen::Vector3d(d[0], d[1], d[2]);
  };
  for (const PointId id : found.region) mean += local(id) / count;
  for (const PointId id : found.region) scatter += (local(id) - mean) * (local(id) - mean).transpose();
  // A 2D mesh is cut along a line.
  if (box.min[2] == box.max[2]) scatter(2, 2) = 2 * scatter.trace();
  const Eigen::Matrix3d U = svd(scatter).U;
  double second = 0, largest = 0;
  PointId farthest = 0;
  for (const PointId id : found.region) {
    const Eigen::Vector3d along = U.transpose() * (local(id) - mean);
    second = std::max(second, std::abs(along[1]));
    if (std::abs(along[2]) > largest) {
      largest = std::abs(along[2]);
      farthest = id;
    }
  }
  std::ostringstream text;
  const double diagonal = box.diagonal();
  if (second <= flatness * diagonal) {
    text << what << ": its " << found.region.size()
         << " points do not define a plane; a plane needs three that are not on a line, in a 2D mesh two";
    throw Error(ErrorCode::invalid_argument, text.str());
  }
  if (largest > flatness * diagonal) {
    text << what << ": its points do not lie in one plane: point " << farthest << " is " << number_digits(largest)
         << " away from the nearest one, the limit is " << number_digits(flatness * diagonal) << " (" << flatness
         << " of the diagonal)";
    throw Error(ErrorCode::invalid_argument, text.str());
  }
  for (int k = 0; k < 3; ++k) {
    found.point[k] = mesh.points[found.region[0]][k] + mean[k];
    found.normal[k] = U(k, 2);
  }
  found.normal = normalized(found.normal);
  // What rounding has tilted was meant to be at right angles to an axis.
  const std::size_t k = main_axis(found.normal);
  double off_axis = 0;
  for (const PointId id : found.region) off_axis = std::max(off_axis, std::abs(mesh.points[id][k] - found.point[k]));
  if (off_axis > 2 * largest + tolerance * diagonal) return;
  found.normal = {};
  found.normal[k] = 1;
}

void Symmetry::make_orthonormal(std::span<const Found> found) {
  for (std::size_t k = 0; k < planes_; ++k) {
    axes_[k] = found[k].normal;
    anchors_[k] = found[k].point;
    for (std::size_t j = 0; j < k; ++j) {
      const double limit = found[k].region.empty() && found[j].region.empty() ? tolerance : flatness;
      const double cosine = dot(found[j].normal, found[k].normal);
      if (std::abs(cosine) > limit) {
        std::ostringstream text;
        text << field(k) << ": is not orthogonal to " << field(j) << ", the cosine of the angle between them is "
             << number_digits(cosine) << ", the limit is " << number_digits(limit);
        throw Error(ErrorCode::invalid_argument, text.str());
      }
      axes_[k] = axes_[k] - dot(axes_[j], axes_[k]) * axes_[j];
    }
    axes_[k] = normalized(axes_[k]);
  }
  if (planes_ == 1) axes_[1] = across(axes_[0]);
  if (planes_ <= 2) axes_[2] = normalized(cross(axes_[0], axes_[1]));
  for (std::size_t k = planes_; k < 3; ++k) anchors_[k] = anchors_[0];
}

void Symmetry::mark(std::size_t plane, const Found& found, const Mesh& mesh, double diagonal) {
  const auto distance = [&](std::size_t id) { return dot(axes_[plane], mesh.points[id] - anchors_[plane]); };
  double near = tolerance * diagonal;
  for (const PointId id : found.region) near = std::max(near, std::abs(distance(id)));
  reach_[plane] = near;
  std::array<std::size_t, 2> count{}, first{};
  for (std::size_t i = mesh.point_count(); i-- > 0;) {
    const double d = distance(i);
    if (std::abs(d) <= near) {
      on_[i] = static_cast<std::uint8_t>(on_[i] | (1u << plane));
      ++held_[plane];
    } else {
      const std::size_t side = d > 0 ? 1 : 0;
      ++count[side];
      first[side] = i;
    }
  }
  if (count[0] > 0 && count[1] > 0) {
    const std::size_t fewer = count[0] <= count[1] ? 0 : 1;
    std::ostringstream text;
    text << field(plane) << ": " << count[fewer] << " points lie beyond the plane, the first is point " << first[fewer]
         << " at a distance of " << number_digits(std::abs(distance(first[fewer])))
         << "; a half model lies on one side, and points on the plane "
         << "lie within " << number_digits(near) << " of it (give a patch of points that are not so accurate as `region`)";
    throw Error(ErrorCode::invalid_argument, text.str());
  }
  if (count[0] > 0) {
    for (double& x : axes_[plane]) x = -x;
  }
}

Symmetry::Symmetry(std::span<const SymmetryPlane> planes, const Mesh& mesh) : planes_(planes.size()) {
  if (planes.empty()) return;
  for (std::size_t k = 0; k < planes.size(); ++k) {
    const auto* sector = std::get_if<SectorOptions>(&planes[k].kind);
    if (sector == nullptr) continue;
    if (planes.size() > 1) {
      throw Error(ErrorCode::invalid_argument,
                  field(k) +
                      ".sector: a sector has no symmetry planes or other sectors besides it; deform the whole wheel, or a "
                      "sector without planes");
    }
    planes_ = 0;
    set_sector(*sector, mesh, bounding_box(mesh.points).diagonal(), field(k) + ".sector");
    return;
  }
  if (planes.size() > 3) {
    throw Error(ErrorCode::invalid_argument, "symmetry[3]: " + std::to_string(planes.size()) +
                                                 " planes, there are at most 3 that are orthogonal to each other");
  }
  const Box box = bounding_box(mesh.points);
  std::vector<Found> found(planes.size());
  for (std::size_t k = 0; k < planes.size(); ++k) find(planes[k], k, mesh, box, found[k]);
  make_orthonormal(found);
  on_.assign(mesh.point_count(), 0);
  for (std::size_t k = 0; k < planes.size(); ++k) mark(k, found[k], mesh, box.diagonal());
}

Symmetry Symmetry::for_points(std::span<const Vec3> points) const {
  Symmetry result = *this;
  result.held_ = {};
  result.on_.clear();
  for (std::size_t i = 0; i < points.size() && planes_ > 0; ++i) {
    result.on_.push_back(static_cast<std::uint8_t>(on(points[i])));
    for (std::size_t k = 0; k < planes_; ++k) result.held_[k] += result.on_[i] >> k & 1u;
  }
  return result;
}

void Symmetry::set_sector(const SectorOptions& options, const Mesh& mesh, double diagonal, const std::string& what) {
  if (!is_finite(options.origin)) throw Error(ErrorCode::invalid_argument, what + ".origin: must be finite");
  if (const char* problem = direction_problem(options.axis)) {
    throw Error(ErrorCode::invalid_argument, what + ".axis: it " + problem);
  }
  axes_[0] = normalized(options.axis);
  axes_[1] = across(axes_[0]);
  axes_[2] = normalized(cross(axes_[0], axes_[1]));
  anchors_.fill(options.origin);
  std::vector<Vec3> places;
  places.reserve(mesh.point_count());
  double farthest = 0;
  for (const Vec3& x : mesh.points) {
    places.push_back(coordinates(x));
    farthest = std::max(farthest, norm(places.back()));
  }
  // Where the rounding of a place is as large as the distance within which points are partners.
  if (diagonal > 0 && !(farthest * std::numeric_limits<double>::epsilon() <= Sector::tolerance * diagonal)) {
    throw Error(ErrorCode::invalid_argument,
                what + ".origin: is " + number_digits(farthest / diagonal) +
                    " diagonals of the bounding box from the mesh, too far to tell its points apart; "
                    "give a point of the axis beside the mesh");
  }
  sector_ = Sector(options, mesh, places, diagonal, what);
}

Vec3 Symmetry::admissible(Vec3 components, const Vec3& place) const {
  if (!is_sector()) return within(components, on(place));
  return sector_.on_axis(coordinates(place)) ? Vec3{components[0], 0, 0} : components;
}

Vec3 Symmetry::turned(const Vec3& vector, std::size_t sectors) const {
  return from_frame(sector_.turned(to_frame(vector), sectors));
}

Vec3 Symmetry::turned_point(const Vec3& point, std::size_t sectors) const {
  return anchors_[0] + turned(point - anchors_[0], sectors);
}

unsigned Symmetry::on(const Vec3& place) const {
  unsigned mask = 0;
  for (std::size_t k = 0; k < planes_; ++k) {
    if (std::abs(dot(axes_[k], place - anchors_[k])) <= reach_[k]) mask |= 1u << k;
  }
  return mask;
}

Vec3 Symmetry::within(Vec3 components, unsigned mask) {
  for (std::size_t k = 0; k < 3; ++k) {
    if ((mask >> k & 1u) != 0) components[k] = 0;
  }
  return components;
}

Vec3 Symmetry::to_frame(const Vec3& vector) const {
  return {dot(axes_[0], vector), dot(axes_[1], vector), dot(axes_[2], vector)};
}

Vec3 Symmetry::from_frame(const Vec3& components) const {
  Vec3 vector{};
  for (std::size_t k = 0; k < 3; ++k) vector = vector + components[k] * axes_[k];
  return vector;
}

Vec3 Symmetry::coordinates(const Vec3& point) const {
  Vec3 result{};
  for (std::size_t k = 0; k < 3; ++k) result[k] = dot(axes_[k], point - anchors_[k]);
  return result;
}

Vec3 Symmetry::reflected(const Vec3& point, std::size_t plane) const {
  return point - 2 * dot(axes_[plane], point - anchors_[plane]) * axes_[plane];
}

Vec3 Symmetry::slid(const Vec3& x, const Vec3& to, unsigned mask) const {
  Vec3 result = to;
  for (std::size_t k = 0; k < planes_; ++k) {
    if ((mask >> k & 1u) != 0) result = result - dot(axes_[k], result - x) * axes_[k];
  }
  return result;
}

Vec3 Symmetry::image(Vec3 point, unsigned image) const {
  if (is_sector()) return image == 0 ? point : turned_point(point, image);
  for (std::size_t k = 0; k < planes_; ++k) {
    if ((image >> k & 1u) != 0) point = reflected(point, k);
  }
  return point;
}

Vec3 Symmetry::components_in(Vec3 components, unsigned image) const {
  if (is_sector()) return sector_.turned(components, image);
  for (std::size_t k = 0; k < planes_; ++k) {
    if ((image >> k & 1u) != 0) components[k] = -components[k];
  }
  return components;
}

unsigned Symmetry::inverse(unsigned image) const {
  const auto count = static_cast<unsigned>(sector_.count());
  return is_sector() ? (count - image) % count : image;
}

unsigned Symmetry::composed(unsigned first, unsigned second) const {
  return is_sector() ? (first + second) % static_cast<unsigned>(sector_.count()) : first ^ second;
}

Box whole_box(const Mesh& mesh, const Symmetry& symmetry) {
  Box box;
  for (std::size_t g = 0; g < symmetry.images(); ++g) {
    for (const Vec3& x : mesh.points) box.add(symmetry.image(x, static_cast<unsigned>(g)));
  }
  return box;
}

}  // namespace deform
