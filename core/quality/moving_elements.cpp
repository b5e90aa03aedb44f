// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>
#include <limits>
#include <string>
#include <utility>
#include <vector>

#include "core/base/checks.h"
#include "core/base/error.h"
#include "core/quality/bernstein.h"
#include "core/quality/infinity.h"
#include "core/quality/moving_cells.h"
#include "core/quality/quadratic_map.h"
#include "core/quality/scaled_jacobian.h"

namespace deform::quality {

namespace {

constexpr double element_tolerance = 1e-14;  // of the product of lengths; rounding is about a tenth of it
// So that what is not inverted at its start has not got its root there.
constexpr double element_on_the_way = element_tolerance / 2;

template <std::size_t N>
bool collapsed(const std::array<Vec3, N>& edges) {
  return !(determinant(edges, edges, element_tolerance)[0] > 0);
}

/// From the columns at every corner or node, in the order in which they are numbered.
template <typename Columns>
Orientation orientation_at(std::size_t count, const Columns& columns) {
  bool positive = true, mirrored = true;
  for (std::size_t k = 0; k < count; ++k) {
    auto at = columns(k);
    positive = positive && !collapsed(at);
    std::swap(at[0], at[1]);
    mirrored = mirrored && !collapsed(at);
  }
  return positive ? Orientation::positive : mirrored ? Orientation::mirrored : Orientation::neither;
}

/// Where columns, which at rest are `at_rest`, change by at most `weights` times the distance r of any node from its place: how
/// much |Q F^-1| <= sum of |column of Q| |row of F^-1| grows with r. The rows are those of cofactors over the determinant.
double growth(const std::array<Vec3, 3>& at_rest, const Vec3& weights) {
  const auto& [a, b, c] = at_rest;
  return (weights[0] * length(cross(b, c)) + weights[1] * length(cross(c, a)) + weights[2] * length(cross(a, b))) /
         dot(a, cross(b, c));
}

double growth(const std::array<Vec3, 2>& at_rest, const Vec3& weights) {
  return (weights[0] * length(at_rest[1]) + weights[1] * length(at_rest[0])) / determinant(at_rest, at_rest, 0)[0];
}

/// The tolerance of cells whose determinants are those of columns F = B (I + N) F_rest, |N| <= growth r < most_growth. On the way
/// X + s (Y - X) the symmetric part of B (I + N) has no eigenvalue below (1 - most_growth) times the least one of that of B, see
/// MotionCertificate::Stretch, so determinants stay positive. Over the lengths of its D columns a determinant falls by at most
/// the condition to the power D - 1, and ((1 - x) / (1 + x))^(D - 1) >= 1 - 2 (D - 1) x.
CellTolerance tolerance_of(double determinant, double growth, int dimension) {
  constexpr double least_determinant = 1e-6, most_growth = 0.4, condition = 10;
  if (!(determinant > least_determinant) || !(growth > 0) || !(growth < infinity)) return {};
  return {most_growth / growth, condition, determinant, 2 * (dimension - 1) * most_growth * determinant, 0};
}

class MovingElements : public MovingCells {
 public:
  MovingElements(const Elements& elements, std::size_t points) : elements_(elements) {
    for (std::size_t e = 0; e < elements.size(); ++e) {
      check_ids(elements.nodes(e), points, FieldEntry{"elements", e}, "point");
    }
  }

  std::size_t size() const override { return elements_.size(); }

  State state(PointSpan points, std::size_t e) const override {
    const auto handedness = left_handed(e) ? Handedness::left : Handedness::right;
    State state{scaled_jacobian(points, elements_.nodes(e), elements_.types[e], handedness), false};
    for (std::size_t k = 0; k < places(e) && !state.inverted; ++k) state.inverted = collapsed(columns(points, e, k));
    return state;
  }

  Orientation orientation(PointSpan points, std::size_t e) const override {
    return orientation_at(places(e), [&](std::size_t k) { return columns_as_numbered(points, e, k); });
  }

  std::vector<CellLink> links() const override {
    SideLinks sides;
    std::vector<PointId> around;
    for (std::size_t e = 0; e < size(); ++e) {
      const auto nodes = elements_.nodes(e);
      const ElementShape& form = shape(elements_.types[e]);
      for (const auto& face : form.faces) {
        around.clear();
        for (std::size_t c = 0; c < face.size(); c += form.quadratic() ? 2 : 1) around.push_back(nodes[face[c]]);
        sides.add(static_cast<std::uint32_t>(e), around);
      }
    }
    return std::move(sides).links();
  }

  double first_inversion(PointSpan from, PointSpan to, std::size_t e, double bound) const override {
    double first = infinity;
    for (std::size_t k = 0; k < places(e); ++k) {
      const auto p = determinant(columns(from, e, k), columns(to, e, k), element_on_the_way);
      first = std::min(first, first_not_positive(p, 0, 1, std::min(first, bound)));
    }
    return first;
  }

  CellTolerance motion_tolerance(PointSpan rest, std::size_t e, double determinant) const override {
    double largest = 0;
    for (std::size_t k = 0; k < places(e); ++k) largest = std::max(largest, growth(columns(rest, e, k), weights(e, k)));
    return tolerance_of(determinant, largest, 3);
  }
  int distortion() const override { return 2; }
  NodeLists nodes() const override { return {elements_.offsets, elements_.points}; }

 private:
  /// How far columns go when every node goes up to a distance of 1 in any direction.
  Vec3 weights(std::size_t e, std::size_t place) const {
    if (!shape(elements_.types[e]).quadratic()) return {2, 2, 2};
    const auto& gradients = QuadraticMap::of(elements_.types[e]).samples()[place].gradients;
    Vec3 result{}, sum{};
    for (std::size_t node = 1; node < gradients.size(); ++node) {
      sum = sum + gradients[node];
      for (std::size_t k = 0; k < 3; ++k) result[k] += std::abs(gradients[node][k]);
    }
    for (std::size_t k = 0; k < 3; ++k) result[k] += std::abs(sum[k]);
    if (left_handed(e)) std::swap(result[0], result[1]);
    return result;
  }

  /// Where the determinant is looked at: corners, or all nodes of a quadratic map.
  std::size_t places(std::size_t e) const {
    const ElementShape& form = shape(elements_.types[e]);
    return form.quadratic() ? form.nodes : form.corner_edges.size();
  }

  /// Those of a left-handed element as in a mirror.
  std::array<Vec3, 3> columns(PointSpan points, std::size_t e, std::size_t place) const {
    auto result = columns_as_numbered(points, e, place);
    if (left_handed(e)) std::swap(result[0], result[1]);
    return result;
  }

  std::array<Vec3, 3> columns_as_numbered(PointSpan points, std::size_t e, std::size_t place) const {
    const auto nodes = elements_.nodes(e);
    const ElementShape& form = shape(elements_.types[e]);
    if (!form.quadratic()) {
      const auto& corner = form.corner_edges[place];
      const Vec3& at = points[nodes[corner[0]]];
      return {points[nodes[corner[1]]] - at, points[nodes[corner[2]]] - at, points[nodes[corner[3]]] - at};
    }
    const auto& gradients = QuadraticMap::of(elements_.types[e]).samples()[place].gradients;
    std::array<Vec3, 3> result{};
    for (std::size_t node = 1; node < nodes.size();
         ++node) {  // the gradients add up to 0: from the first node, for few digits lost
      const Vec3 way = points[nodes[node]] - points[nodes[0]];
      for (std::size_t k = 0; k < 3; ++k) result[k] = result[k] + gradients[node][k] * way;
    }
    return result;
  }

  const Elements& elements_;
};

class MovingFaces : public MovingCells {
 public:
  explicit MovingFaces(const Mesh& mesh) : mesh_(mesh), offsets_(mesh.face_offsets()) {
    for (std::size_t f = 0; f < mesh.face_count(); ++f) {
      const auto corners = face(f);
      if (corners.size() != 3 && corners.size() != 4) {
        throw Error(ErrorCode::invalid_argument, "faces[" + std::to_string(f) + "]: has " + std::to_string(corners.size()) +
                                                     " corners, as cells in the plane only triangles and quads can be used");
      }
      check_ids(corners, mesh.point_count(), FieldEntry{"faces", f}, "point");
    }
  }

  std::size_t size() const override { return mesh_.face_count(); }

  State state(PointSpan points, std::size_t f) const override {
    State state{1, false};
    for (std::size_t c = 0; c < face(f).size(); ++c) {
      const auto edges = corner(points, f, c);
      const double lengths = length(edges[0]) * length(edges[1]);
      state.determinant = std::min(state.determinant, lengths > 0 ? determinant(edges, edges, 0)[0] / lengths : 0.0);
      state.inverted = state.inverted || collapsed(edges);
    }
    return state;
  }

  double first_inversion(PointSpan from, PointSpan to, std::size_t f, double bound) const override {
    double first = infinity;
    for (std::size_t c = 0; c < face(f).size(); ++c) {
      const auto p = determinant(corner(from, f, c), corner(to, f, c), element_on_the_way);
      first = std::min(first, first_not_positive(p, 0, 1, std::min(first, bound)));
    }
    return first;
  }

  CellTolerance motion_tolerance(PointSpan rest, std::size_t f, double determinant) const override {
    double largest = 0;
    for (std::size_t c = 0; c < face(f).size(); ++c) largest = std::max(largest, growth(corner(rest, f, c), {2, 2, 0}));
    return tolerance_of(determinant, largest, 2);
  }
  int distortion() const override { return 1; }
  NodeLists nodes() const override { return {offsets_, mesh_.face_points}; }

  Orientation orientation(PointSpan points, std::size_t f) const override {
    return orientation_at(face(f).size(), [&](std::size_t c) { return corner_as_numbered(points, f, c); });
  }

  std::vector<CellLink> links() const override {
    SideLinks sides;
    for (std::size_t f = 0; f < size(); ++f) {
      const auto corners = face(f);
      for (std::size_t c = 0; c < corners.size(); ++c) {
        const PointId edge[] = {corners[c], corners[(c + 1) % corners.size()]};
        sides.add(static_cast<std::uint32_t>(f), edge);
      }
    }
    return std::move(sides).links();
  }

 private:
  std::span<const PointId> face(std::size_t f) const {
    return std::span(mesh_.face_points).subspan(offsets_[f], mesh_.face_sizes[f]);
  }

  /// The other way round in a clockwise face.
  std::array<Vec3, 2> corner(PointSpan points, std::size_t f, std::size_t c) const {
    auto result = corner_as_numbered(points, f, c);
    if (left_handed(f)) std::swap(result[0], result[1]);
    return result;
  }

  /// The edges to the next corner and the one before.
  std::array<Vec3, 2> corner_as_numbered(PointSpan points, std::size_t f, std::size_t c) const {
    const auto corners = face(f);
    const auto edge = [&](std::size_t other) {
      const Vec3 way = points[corners[other % corners.size()]] - points[corners[c]];
      return Vec3{way[0], way[1], 0};
    };
    return {edge(c + 1), edge(c + corners.size() - 1)};
  }

  const Mesh& mesh_;
  std::vector<std::uint64_t> offsets_;
};

}  // namespace

std::unique_ptr<MovingCells> moving_elements(const Elements& elements, std::size_t points) {
  return std::make_unique<MovingElements>(elements, points);
}

std::unique_ptr<MovingCells> moving_faces(const Mesh& mesh) { return std::make_unique<MovingFaces>(mesh); }

}  // namespace deform::quality
