// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>
#include <limits>
#include <string>

#include "core/base/checks.h"
#include "core/base/error.h"
#include "core/quality/bernstein.h"
#include "core/quality/moving_cells.h"
#include "core/quality/quadratic_map.h"
#include "core/quality/scaled_jacobian.h"

namespace deform::quality {

namespace {

constexpr double tolerance = 1e-14;           // of the product of lengths; rounding is about a tenth of it
constexpr double on_the_way = tolerance / 2;  // so that what is not inverted at its start has not got its root there
constexpr double infinity = std::numeric_limits<double>::infinity();

template <std::size_t N>
bool collapsed(const std::array<Vec3, N>& edges) {
  return !(determinant(edges, edges, tolerance)[0] > 0);
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
    State state{scaled_jacobian(points, elements_.nodes(e), elements_.types[e]), false};
    for (std::size_t k = 0; k < places(e) && !state.inverted; ++k) state.inverted = collapsed(columns(points, e, k));
    return state;
  }

  double first_inversion(PointSpan from, PointSpan to, std::size_t e, double bound) const override {
    double first = infinity;
    for (std::size_t k = 0; k < places(e); ++k) {
      const auto p = determinant(columns(from, e, k), columns(to, e, k), on_the_way);
      first = std::min(first, first_not_positive(p, 0, 1, std::min(first, bound)));
    }
    return first;
  }

 private:
  /// Where the determinant is looked at: corners, or all nodes of a quadratic map.
  std::size_t places(std::size_t e) const {
    const ElementShape& form = shape(elements_.types[e]);
    return form.quadratic() ? form.nodes : form.corner_edges.size();
  }

  std::array<Vec3, 3> columns(PointSpan points, std::size_t e, std::size_t place) const {
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
  MovingFaces(const Mesh& mesh, PointSpan rest) : mesh_(mesh), offsets_(mesh.face_offsets()) {
    double area = 0;
    for (std::size_t f = 0; f < mesh.face_count(); ++f) {
      const auto corners = face(f);
      if (corners.size() != 3 && corners.size() != 4) {
        throw Error(ErrorCode::invalid_argument, "faces[" + std::to_string(f) + "]: has " + std::to_string(corners.size()) +
                                                     " corners, as cells in the plane only triangles and quads can be used");
      }
      check_ids(corners, rest.size(), FieldEntry{"faces", f}, "point");
      for (std::size_t c = 1; c + 1 < corners.size(); ++c) {
        const Vec3& at = rest[corners[0]];
        area += cross(rest[corners[c]] - at, rest[corners[c + 1]] - at)[2];
      }
    }
    clockwise_ = area < 0;
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
      const auto p = determinant(corner(from, f, c), corner(to, f, c), on_the_way);
      first = std::min(first, first_not_positive(p, 0, 1, std::min(first, bound)));
    }
    return first;
  }

 private:
  std::span<const PointId> face(std::size_t f) const {
    return std::span(mesh_.face_points).subspan(offsets_[f], mesh_.face_sizes[f]);
  }

  /// The edges to the next corner and the one before, the other way round in a clockwise mesh.
  std::array<Vec3, 2> corner(PointSpan points, std::size_t f, std::size_t c) const {
    const auto corners = face(f);
    const auto edge = [&](std::size_t other) {
      const Vec3 way = points[corners[other % corners.size()]] - points[corners[c]];
      return Vec3{way[0], way[1], 0};
    };
    const Vec3 next = edge(c + 1), before = edge(c + corners.size() - 1);
    if (clockwise_) return {before, next};
    return {next, before};
  }

  const Mesh& mesh_;
  std::vector<std::uint64_t> offsets_;
  bool clockwise_ = false;
};

}  // namespace

std::unique_ptr<const MovingCells> moving_elements(const Elements& elements, std::size_t points) {
  return std::make_unique<MovingElements>(elements, points);
}

std::unique_ptr<const MovingCells> moving_faces(const Mesh& mesh, std::span<const Vec3> rest) {
  return std::make_unique<MovingFaces>(mesh, rest);
}

}  // namespace deform::quality
