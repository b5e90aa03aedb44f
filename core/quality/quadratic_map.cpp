// SPDX-License-Identifier: Apache-2.0
#include "core/quality/quadratic_map.h"

#include <cmath>
#include <utility>

#include "core/base/vectors.h"

namespace deform {

namespace {

enum class Family { tetrahedron, pyramid, prism, hexahedron };

Family family(const ElementShape& form) {
  return form.corners == 4   ? Family::tetrahedron
         : form.corners == 5 ? Family::pyramid
         : form.corners == 6 ? Family::prism
                             : Family::hexahedron;
}

/// x^i y^j z^k / (1 - z)^m, and its derivatives. On the reference pyramid |x| and |y| are at most 1 - z.
struct Monomial {
  int i, j, k, m = 0;

  double value(const Vec3& p) const { return power(p[0], i) * power(p[1], j) * power(p[2], k) * rational(p[2], m); }
  Vec3 gradient(const Vec3& p) const {
    const double x = power(p[0], i), y = power(p[1], j), z = power(p[2], k), r = rational(p[2], m);
    return {slope(p[0], i) * y * z * r, x * slope(p[1], j) * z * r, x * y * (slope(p[2], k) * r + m * z * rational(p[2], m + 1))};
  }

 private:
  static double power(double x, int n) { return n == 0 ? 1 : n == 1 ? x : x * x; }
  static double slope(double x, int n) { return n == 0 ? 0 : n == 1 ? 1 : 2 * x; }
  /// At the apex the numerator is 0 and so is the function; its derivatives have the limit 0 along the axis.
  static double rational(double z, int m) { return m == 0 ? 1 : z == 1 ? 0 : std::pow(1 - z, -m); }
};

bool within(ElementType type, int i, int j, int k) {
  const auto superlinear = [](int n) { return n > 1 ? n : 0; };
  switch (type) {
    case ElementType::prism15:
      return i + j <= 2 && (k < 2 || i + j <= 1);
    case ElementType::prism18:
      return i + j <= 2;
    case ElementType::hexahedron20:
      return superlinear(i) + superlinear(j) + superlinear(k) <= 2;
    case ElementType::hexahedron27:
      return true;
    default:
      return i + j + k <= 2;
  }
}

std::vector<Monomial> monomials(ElementType type) {
  std::vector<Monomial> result;
  for (int i = 0; i <= 2; ++i) {
    for (int j = 0; j <= 2; ++j) {
      for (int k = 0; k <= 2; ++k) {
        if (within(type, i, j, k)) result.push_back({i, j, k});
      }
    }
  }
  const bool base_centre = type == ElementType::pyramid14;
  if (base_centre || type == ElementType::pyramid13) result.insert(result.end(), {{1, 1, 0, 1}, {2, 1, 0, 1}, {1, 2, 0, 1}});
  if (base_centre) result.push_back({2, 2, 0, 2});
  return result;
}

std::vector<Vec3> reference_corners(Family kind) {
  switch (kind) {
    case Family::tetrahedron:
      return {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0, 0, 1}};
    case Family::pyramid:
      return {{-1, -1, 0}, {1, -1, 0}, {1, 1, 0}, {-1, 1, 0}, {0, 0, 1}};
    case Family::prism:
      return {{0, 0, -1}, {1, 0, -1}, {0, 1, -1}, {0, 0, 1}, {1, 0, 1}, {0, 1, 1}};
    case Family::hexahedron:
      break;
  }
  return {{-1, -1, -1}, {1, -1, -1}, {1, 1, -1}, {-1, 1, -1}, {-1, -1, 1}, {1, -1, 1}, {1, 1, 1}, {-1, 1, 1}};
}

std::vector<Vec3> reference_nodes(const ElementShape& form) {
  std::vector<Vec3> nodes = reference_corners(family(form));
  for (const auto& edge : form.edges) nodes.push_back(0.5 * (nodes[edge[0]] + nodes[edge[1]]));
  nodes.resize(form.nodes);  // one in the middle of a hexahedron stays at 0
  for (std::size_t f = 0; f < form.face_centres.size(); ++f) {
    if (form.face_centres[f] == ElementShape::no_node) continue;
    Vec3& centre = nodes[form.face_centres[f]];
    for (std::size_t c = 0; c < 8; c += 2) centre = centre + 0.25 * nodes[form.faces[f][c]];
  }
  return nodes;
}

/// From a point of the cube [-1, 1]^3 to one of the reference element; the volume there relative to the cube's.
std::pair<Vec3, double> collapse(Family kind, const Vec3& cube) {
  const Vec3 unit{(1 + cube[0]) / 2, (1 + cube[1]) / 2, (1 + cube[2]) / 2};
  const double b = 1 - unit[1], c = 1 - unit[2];
  switch (kind) {
    case Family::tetrahedron:
      return {{unit[0] * b * c, unit[1] * c, unit[2]}, b * c * c / 8};
    case Family::pyramid:
      return {{cube[0] * c, cube[1] * c, unit[2]}, c * c / 2};
    case Family::prism:
      return {{unit[0] * b, unit[1], cube[2]}, b / 4};
    case Family::hexahedron:
      break;
  }
  return {cube, 1};
}

/// A square matrix, row by row.
using SquareMatrix = std::vector<std::vector<double>>;

/// By Gauss-Jordan elimination with row pivots.
SquareMatrix inverse(SquareMatrix matrix) {
  const std::size_t n = matrix.size();
  SquareMatrix result(n, std::vector<double>(n));
  for (std::size_t i = 0; i < n; ++i) result[i][i] = 1;
  for (std::size_t pivot = 0; pivot < n; ++pivot) {
    std::size_t largest = pivot;
    for (std::size_t row = pivot + 1; row < n; ++row) {
      if (std::abs(matrix[row][pivot]) > std::abs(matrix[largest][pivot])) largest = row;
    }
    std::swap(matrix[pivot], matrix[largest]);
    std::swap(result[pivot], result[largest]);
    const double divisor = matrix[pivot][pivot];
    for (std::size_t column = 0; column < n; ++column) {
      matrix[pivot][column] /= divisor;
      result[pivot][column] /= divisor;
    }
    for (std::size_t row = 0; row < n; ++row) {
      const double factor = matrix[row][pivot];
      if (row == pivot || factor == 0) continue;
      for (std::size_t column = 0; column < n; ++column) {
        matrix[row][column] -= factor * matrix[pivot][column];
        result[row][column] -= factor * result[pivot][column];
      }
    }
  }
  return result;
}

/// Coefficients of the monomials, a column per shape function.
SquareMatrix coefficients(const std::vector<Monomial>& basis, const std::vector<Vec3>& nodes) {
  SquareMatrix values(nodes.size(), std::vector<double>(basis.size()));
  for (std::size_t node = 0; node < nodes.size(); ++node) {
    for (std::size_t term = 0; term < basis.size(); ++term) values[node][term] = basis[term].value(nodes[node]);
  }
  return inverse(std::move(values));
}

QuadraticMap::Gradients gradients_at(const Vec3& point, const std::vector<Monomial>& basis, const SquareMatrix& shapes) {
  QuadraticMap::Gradients result(basis.size());
  for (std::size_t term = 0; term < basis.size(); ++term) {
    const Vec3 slope = basis[term].gradient(point);
    for (std::size_t node = 0; node < basis.size(); ++node) result[node] = result[node] + shapes[term][node] * slope;
  }
  return result;
}

}  // namespace

QuadraticMap::QuadraticMap(ElementType type) {
  const ElementShape& form = shape(type);
  const std::vector<Monomial> basis = monomials(type);
  const std::vector<Vec3> nodes = reference_nodes(form);
  const SquareMatrix shapes = coefficients(basis, nodes);

  std::vector<std::array<Vec3, 3>> frames;
  for (const auto& corner : form.corner_edges) {
    const Vec3& at = nodes[corner[0]];
    frames.push_back({nodes[corner[1]] - at, nodes[corner[2]] - at, nodes[corner[3]] - at});
  }
  for (std::size_t node = 0; node < form.nodes; ++node) {
    Sample sample{gradients_at(nodes[node], basis, shapes), frames};
    if (node < form.corner_edges.size()) sample.frames = {frames[node]};
    samples_.push_back(std::move(sample));
  }

  const double outer = std::sqrt(0.6);
  const double places[] = {-outer, 0, outer}, weights[] = {5.0 / 9, 8.0 / 9, 5.0 / 9};
  for (int i = 0; i < 27; ++i) {
    const int a = i / 9, b = i / 3 % 3, c = i % 3;
    const auto [point, size] = collapse(family(form), {places[a], places[b], places[c]});
    quadrature_.push_back({gradients_at(point, basis, shapes), weights[a] * weights[b] * weights[c] * size});
  }
}

const QuadraticMap& QuadraticMap::of(ElementType type) {
  static const std::vector<QuadraticMap> all = [] {
    std::vector<QuadraticMap> maps;
    for (std::size_t i = static_cast<std::size_t>(ElementType::tetrahedron10); i < element_types; ++i) {
      maps.push_back(QuadraticMap(static_cast<ElementType>(i)));
    }
    return maps;
  }();
  return all[static_cast<std::size_t>(type) - static_cast<std::size_t>(ElementType::tetrahedron10)];
}

std::array<Vec3, 3> jacobian(std::span<const Vec3> points, std::span<const PointId> nodes,
                             const QuadraticMap::Gradients& gradients) {
  std::array<Vec3, 3> columns{};
  for (std::size_t node = 0; node < nodes.size(); ++node) {
    for (std::size_t k = 0; k < 3; ++k) columns[k] = columns[k] + gradients[node][k] * points[nodes[node]];
  }
  return columns;
}

}  // namespace deform
