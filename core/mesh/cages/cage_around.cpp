// SPDX-License-Identifier: Apache-2.0
#include "core/mesh/cages/cage_around.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <limits>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "core/base/error.h"
#include "core/base/number_text.h"
#include "core/base/parallel.h"
#include "core/base/vectors.h"
#include "core/mesh/cages/convex_hull.h"
#include "core/mesh/cages/crossing_triangles.h"
#include "core/mesh/cages/divided_box.h"
#include "core/mesh/cages/offset_surface.h"
#include "core/mesh/inspect.h"
#include "core/mesh/remeshing/closest_point.h"
#include "core/mesh/remeshing/isotropic_remeshing.h"
#include "core/mesh/remeshing/triangles.h"
#include "core/mesh/winding_number.h"

namespace deform {

namespace {

constexpr double box_padding = 0.05;     // of D
constexpr double offset_of_edge = 0.35;  // an edge that bridges a right angle cuts a quarter of it off, and more at a corner
constexpr double offset_growth = 1.25;
constexpr double most_offset = 0.5;    // of D
constexpr double cells_of_offset = 2;  // that a cell of the grid has to be shorter
constexpr double fewest_cells = 1.2;   // where the grid would be too large
constexpr std::size_t most_grid_nodes = 6000000;
constexpr std::size_t points_per_task = 1024;
constexpr double longest_piece = 0.05;  // of D: trees of boxes are slow over long triangles
constexpr std::size_t most_pieces = 500000;

[[noreturn]] void refuse(const std::string& message) { throw Error(ErrorCode::invalid_argument, message); }

/// As on pages of figures: enough digits to tell one from another.
std::string short_text(double value) {
  std::array<char, 32> text{};
  std::snprintf(text.data(), text.size(), "%.4g", value);
  return text.data();
}

/// Faces fanned into triangles, and of a mesh without cells points that no face has.
std::vector<TriangleCorners> triangles_of(const Mesh& mesh) {
  std::vector<TriangleCorners> triangles;
  std::vector<char> used(mesh.point_count(), 0);
  std::size_t at = 0;
  for (const std::uint32_t size : mesh.face_sizes) {
    const PointId* const corners = mesh.face_points.data() + at;
    const Vec3& first = mesh.points[corners[0]];
    if (size < 3) triangles.push_back({first, mesh.points[corners[size - 1]], first});
    for (std::size_t i = 2; i < size; ++i) triangles.push_back({first, mesh.points[corners[i - 1]], mesh.points[corners[i]]});
    for (std::size_t i = 0; i < size; ++i) used[corners[i]] = 1;
    at += size;
  }
  if (mesh.cell_count() > 0 && !triangles.empty()) return triangles;
  for (std::size_t i = 0; i < used.size(); ++i) {
    if (used[i] == 0) triangles.push_back({mesh.points[i], mesh.points[i], mesh.points[i]});
  }
  return triangles;
}

/// The same surface in triangles whose edges are at most so long, as far as there are not too many of them.
std::vector<TriangleCorners> in_pieces(std::vector<TriangleCorners> triangles, double longest) {
  for (std::size_t t = 0; t < triangles.size();) {
    const auto& [a, b, c] = triangles[t];
    const std::array<double, 3> edges{squared_distance(a, b), squared_distance(b, c), squared_distance(c, a)};
    const auto edge = static_cast<std::size_t>(std::max_element(edges.begin(), edges.end()) - edges.begin());
    if (edges[edge] <= longest * longest || triangles.size() >= most_pieces) {
      ++t;
      continue;
    }
    TriangleCorners first = triangles[t], second = first;
    first[(edge + 1) % 3] = second[edge] = 0.5 * (first[edge] + first[(edge + 1) % 3]);
    triangles[t] = first;
    triangles.push_back(second);
  }
  return triangles;
}

/// Where the points of the model are, seen from a closed mesh.
struct Enclosed {
  std::size_t outside = 0;
  double nearest = std::numeric_limits<double>::infinity();  ///< distance from the mesh
};

Enclosed enclosed(const Mesh& cage, const Points& points, const RunContext& context) {
  const WindingNumber winding(cage, cage.points);
  const ClosestPoint closest(triangles_of(cage));
  std::vector<Enclosed> parts(points.size() / points_per_task + 1);
  parallel_for(context, points.size(), points_per_task, [&](std::size_t begin, std::size_t end) {
    Enclosed& part = parts[begin / points_per_task];
    for (std::size_t i = begin; i < end; ++i) {
      part.outside += winding.at(points[i]) < 0.5 ? 1 : 0;
      part.nearest = std::min(part.nearest, distance(points[i], closest(points[i])));
    }
  });
  Enclosed all;
  for (const Enclosed& part : parts) {
    all.outside += part.outside;
    all.nearest = std::min(all.nearest, part.nearest);
  }
  return all;
}

void describe(CageAround& cage, const Points& points, const RunContext& context) {
  cage.least_angle = least_angle(SurfaceMesh(cage.mesh));
  cage.clearance = enclosed(cage.mesh, points, context).nearest;
  const MeshReport report = inspect(cage.mesh);
  cage.components = report.components;
  // In closed surfaces V - E + F is two for each component less two for each handle.
  const std::size_t even = 2 * report.components + report.edges - report.points - report.faces;
  cage.genus = even / 2;
}

[[noreturn]] void refuse_count(std::size_t points, const SquarestDivisions& squarest) {
  std::string near = squarest.below > 0 ? std::to_string(squarest.below) : "";
  if (squarest.above > 0) near += (near.empty() ? "" : " and ") + std::to_string(squarest.above);
  refuse("points: a box of these proportions has no " + std::to_string(points) + " points with angles of 15 degrees or more" +
         (near.empty() ? "" : "; near are " + near));
}

bool is_closed(const Mesh& mesh) {
  const MeshReport report = inspect(mesh);
  return report.boundary_edges + report.non_manifold_edges + report.inconsistent_edges + report.non_manifold_points +
             report.degenerate_faces ==
         0;
}

/// Length of the edges of so many points on an area.
double edge_of(double area, std::size_t points) { return std::sqrt(2 * area / (std::sqrt(3.0) * static_cast<double>(points))); }

/// Triangles with their mirror images in the first planes.
std::vector<TriangleCorners> with_images(std::vector<TriangleCorners> triangles, std::size_t planes) {
  for (std::size_t k = 0; k < planes; ++k) {
    const std::size_t count = triangles.size();
    for (std::size_t t = 0; t < count; ++t) {
      TriangleCorners image = triangles[t];
      for (Vec3& x : image) x[k] = -x[k];
      triangles.push_back(image);
    }
  }
  return triangles;
}

/// What is to be wrapped: of a half model the whole one, of which a wrap needs nothing behind the planes, as from in front of
/// them its mirror image is nearer. The triangles of a hull are not images of each other.
std::vector<TriangleCorners> wrapped(const Mesh& mesh, CageKind kind, std::size_t planes) {
  std::vector<TriangleCorners> triangles = with_images(triangles_of(mesh), planes);
  if (kind == CageKind::hull) {
    std::vector<Vec3> corners = mesh.points;
    if (planes > 0) {
      corners.clear();
      for (const TriangleCorners& t : triangles) corners.insert(corners.end(), t.begin(), t.end());
    }
    return triangles_of(convex_hull(corners));
  }
  std::erase_if(triangles, [&](const TriangleCorners& t) {
    bool behind = false;
    for (std::size_t k = 0; k < planes; ++k) behind = behind || (t[0][k] < 0 && t[1][k] < 0 && t[2][k] < 0);
    return behind;
  });
  return triangles;
}

/// Cages of kind hull and wrap. With symmetry planes the mesh is in coordinates of a MirrorFrame.
class Wrapping {
 public:
  Wrapping(const Mesh& mesh, const CageRequest& request, const Box& box, const RunContext& context)
      : mesh_(mesh),
        request_(request),
        box_(box),
        context_(context),
        triangles_(in_pieces(wrapped(mesh, request.kind, request.planes.size()), longest_piece * box.diagonal())) {}

  CageAround run() {
    const double diagonal = box_.diagonal();
    double offset = request_.offset;
    if (!(offset > 0)) {
      const double area = 2 * (box_.side(0) * box_.side(1) + box_.side(1) * box_.side(2) + box_.side(2) * box_.side(0));
      offset = std::max(offset_of_edge * edge_of(area, request_.points), 0.004 * diagonal);
    }
    CageAround cage;
    std::string wrong;
    for (; cage.attempts == 0 || offset <= most_offset * diagonal; offset *= offset_growth) {
      ++cage.attempts;
      OffsetGrid grid{offset, offset / cells_of_offset, request_.planes.size()};
      if (offset_nodes(box_, grid) > most_grid_nodes) grid.cell = offset / fewest_cells;
      if (offset_nodes(box_, grid) > most_grid_nodes) {
        if (request_.offset > 0 && cage.attempts == 1) {
          refuse("offset: " + number_digits(offset) + " is too small for a mesh of diagonal " + short_text(diagonal));
        }
        --cage.attempts;
        continue;
      }
      cage.offset = offset;
      wrong = attempt(grid, cage);
      if (wrong.empty()) {
        describe(cage, mesh_.points, context_);
        return cage;
      }
    }
    throw Error(ErrorCode::failed_precondition, "no cage of " + std::to_string(request_.points) +
                                                    " points was found; at the last offset, " + short_text(cage.offset) + ", " +
                                                    wrong + ". Ask for more points, or for another kind");
  }

 private:
  /// What is wrong with the cage of this offset; nothing: it is one.
  std::string attempt(const OffsetGrid& grid, CageAround& cage) const {
    const std::size_t planes = grid.planes;
    const SurfaceMesh surface(deform::with_images(offset_surface(triangles_, box_, grid, context_), planes));
    context_.check();
    SurfaceMesh made = isotropic_remeshing(surface, {.vertices = request_.points, .feature_degrees = 180, .planes = planes});
    context_.check();
    if (planes > 0) {
      // The two sides of a plane were remeshed each for itself.
      const Mesh part = part_beyond(made.to_mesh(), planes);
      if (part.points.empty()) return "none of its triangles is on the side of the mesh only";
      const Mesh whole = deform::with_images(part, planes);
      if (!is_closed(whole)) return "it is no surface where its two sides meet in a symmetry plane";
      made = SurfaceMesh(whole);
    }
    const auto wanted = static_cast<double>(request_.points);
    if (std::abs(static_cast<double>(made.vertex_count()) - wanted) > CageRequest::count_tolerance * wanted) {
      return "its surface has " + std::to_string(made.vertex_count()) + " points";
    }
    if (const double angle = least_angle(made); angle < CageRequest::least_angle) {
      return "its least angle is " + short_text(angle) + " degrees";
    }
    cage.mesh = made.to_mesh();
    if (const std::size_t crossing = crossing_triangles(cage.mesh); crossing > 0) {
      return std::to_string(crossing) + " pairs of its triangles cross each other";
    }
    const Enclosed model = enclosed(cage.mesh, mesh_.points, context_);
    if (model.outside > 0) return std::to_string(model.outside) + " points of the mesh are outside";
    if (model.nearest < CageRequest::least_clearance * cage.offset) {
      return "a point of the mesh is only " + short_text(model.nearest) + " away from it";
    }
    return {};
  }

  const Mesh& mesh_;
  const CageRequest& request_;
  const Box box_;
  const RunContext& context_;
  const ClosestPoint triangles_;
};

/// Made in coordinates in which the planes are coordinate planes, so that mirror images differ in signs only. The mesh may be on
/// both sides of a plane.
CageAround around_half(const Mesh& mesh, const CageRequest& request, const RunContext& context) {
  const MirrorFrame frame(request.planes, mesh);
  Mesh half = mesh;
  for (Vec3& x : half.points) x = frame.coordinates(x);
  Box whole = bounding_box(half.points);
  for (std::size_t k = 0; k < frame.planes(); ++k) {
    whole.max[k] = std::max(whole.max[k], -whole.min[k]);
    whole.min[k] = -whole.max[k];
  }
  CageAround cage = Wrapping(half, request, whole, context).run();
  for (Vec3& x : cage.mesh.points) x = frame.point(x);
  for (std::size_t c = 0; c < cage.mesh.face_points.size() && !frame.is_right_handed(); c += 3) {
    std::swap(cage.mesh.face_points[c + 1], cage.mesh.face_points[c + 2]);
  }
  cage.planes = request.planes;
  return cage;
}

SurfaceMirrors mirrors_of(const Mesh& mesh, const CageRequest& request, double diagonal, const RunContext& context) {
  if (request.symmetry_tolerance == 0) return {};
  return surface_mirrors(in_pieces(wrapped(mesh, request.kind, 0), longest_piece * diagonal),
                         request.symmetry_tolerance * diagonal, context);
}

/// Around a mesh that may be its own mirror image.
CageAround around_whole(const Mesh& mesh, const CageRequest& request, const Box& box, const RunContext& context) {
  const SurfaceMirrors mirrors = mirrors_of(mesh, request, box.diagonal(), context);
  CageRequest mirrored = request;
  mirrored.planes = mirrors.planes;
  std::vector<CagePlane> without;
  for (; !mirrored.planes.empty(); mirrored.planes.pop_back()) {
    try {
      CageAround cage = around_half(mesh, mirrored, context);
      cage.without = std::move(without);
      cage.asymmetry = mirrors.deviation;
      return cage;
    } catch (const Error& error) {
      // Loops of edges in the planes can be too much for few points.
      if (error.code() != ErrorCode::failed_precondition) throw;
    }
    without.insert(without.begin(), mirrored.planes.back());
  }
  CageAround cage = Wrapping(mesh, request, box, context).run();
  cage.without = std::move(without);
  cage.nearly_symmetric = mirrors.near;
  return cage;
}

/// The box that is to be divided.
Box padded(const Box& model, const CageRequest& request, double offset) {
  Box box = model;
  for (std::size_t k = 0; k < 3; ++k) {
    box.min[k] = std::max(box.min[k] - offset, request.lowest[k]);
    box.max[k] = std::min(box.max[k] + offset, request.highest[k]);
  }
  return box;
}

Vec3 sides_of(const Box& box) { return {box.side(0), box.side(1), box.side(2)}; }

/// Planes of the model in which a box may be its own mirror image: across which axes, where, and which these are.
struct BoxPlanes {
  std::array<std::optional<CagePlane>, 3> across;

  /// The box of the model enlarged to that of the model and its images in some of the planes.
  Box enlarged(Box box, const std::array<bool, 3>& mirrored) const {
    for (std::size_t k = 0; k < 3; ++k) {
      if (!mirrored[k]) continue;
      const double middle = across[k]->point[k], half = std::max(box.max[k] - middle, middle - box.min[k]);
      box.min[k] = middle - half;
      box.max[k] = middle + half;
    }
    return box;
  }
};

/// Around a mesh that may be its own mirror image, along the axes.
CageAround box_around(const Mesh& mesh, const CageRequest& request, const Box& model, const RunContext& context) {
  CageAround cage;
  cage.offset = request.offset > 0 ? request.offset : box_padding * model.diagonal();
  cage.attempts = 1;
  const SurfaceMirrors mirrors = mirrors_of(mesh, request, model.diagonal(), context);
  BoxPlanes planes;
  for (const CagePlane& plane : mirrors.planes) {
    if (const auto axis = axis_of(plane)) planes.across[*axis] = plane;
  }
  // As many of the planes as can be, those across the first axes rather.
  std::optional<BoxDivisions> divisions;
  Box box;
  for (const unsigned mask : {7U, 3U, 5U, 6U, 1U, 2U, 4U, 0U}) {
    std::array<bool, 3> mirrored{};
    bool possible = true;
    for (std::size_t k = 0; k < 3; ++k) {
      mirrored[k] = (mask >> k & 1U) != 0;
      possible = possible && (!mirrored[k] || planes.across[k]);
    }
    if (!possible) continue;
    const Box around = planes.enlarged(model, mirrored);
    box = padded(around, request, cage.offset);
    for (std::size_t k = 0; k < 3; ++k) {
      // It must not end in `lowest` or `highest` on one side only.
      possible =
          possible && (!mirrored[k] || (box.min[k] == around.min[k] - cage.offset && box.max[k] == around.max[k] + cage.offset));
    }
    if (!possible) continue;
    const SquarestDivisions squarest = squarest_divisions(sides_of(box), request.points, mirrored);
    divisions = squarest.divisions;
    if (divisions) break;
    if (mask == 0) refuse_count(request.points, squarest);
  }
  cage.mesh = divided_box(box, *divisions);
  for (const CagePlane& plane : mirrors.planes) {
    const auto axis = axis_of(plane);
    (axis && divisions->mirrored[*axis] ? cage.planes : cage.without).push_back(plane);
  }
  if (!cage.planes.empty()) cage.asymmetry = mirrors.deviation;
  if (mirrors.near && axis_of(mirrors.near->plane)) cage.nearly_symmetric = mirrors.near;
  describe(cage, mesh.points, context);
  return cage;
}

}  // namespace

CageAround cage_around(const Mesh& mesh, const CageRequest& request, const RunContext& context) {
  if (request.points < CageRequest::least_points || request.points > CageRequest::most_points) {
    refuse("points: " + std::to_string(request.points) + " is out of range, allowed are " +
           std::to_string(CageRequest::least_points) + " to " + std::to_string(CageRequest::most_points));
  }
  if (!(request.offset >= 0) || !std::isfinite(request.offset)) {
    refuse("offset: " + number_digits(request.offset) + " must be 0 or more and finite");
  }
  if (!(request.symmetry_tolerance >= 0) || !(request.symmetry_tolerance <= CageRequest::most_symmetry_tolerance)) {
    refuse("symmetry_tolerance: " + number_digits(request.symmetry_tolerance) + " is out of range, allowed are 0 to " +
           number_digits(CageRequest::most_symmetry_tolerance) + " of the diagonal");
  }
  if (mesh.points.empty()) refuse("mesh: it has no points");
  const Box box = bounding_box(mesh.points);
  if (!(box.diagonal() > 0) || !std::isfinite(box.diagonal())) {
    refuse("mesh: all points coincide or its extent is not finite, so it takes no cage");
  }
  if (request.kind == CageKind::box) {
    if (!request.planes.empty()) refuse("planes: a box ends where `lowest` and `highest` are; leave them out");
    return box_around(mesh, request, box, context);
  }
  if (request.planes.empty()) return around_whole(mesh, request, box, context);
  return around_half(mesh, request, context);
}

}  // namespace deform
