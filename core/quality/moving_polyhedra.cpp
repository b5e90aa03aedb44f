// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include "core/base/checks.h"
#include "core/base/error.h"
#include "core/quality/centred.h"
#include "core/quality/moving_cells.h"

namespace deform::quality {

namespace {

// Beside the operators below, which would hide them.
using quality::operator+;
using quality::operator-;
using quality::operator*;

constexpr double tolerance = 1e-13;           // of areas times the size of the cell: several times the rounding of long sums
constexpr double on_the_way = tolerance / 2;  // so that what is not inverted at its start is not so right after it
constexpr double resolution = 1e-12;          // of s
constexpr double least_step = 1e-30;

/// A place that moves straight: start + s slope.
struct Straight {
  Vec3 start{}, slope{};
};

Straight operator+(const Straight& a, const Straight& b) { return {a.start + b.start, a.slope + b.slope}; }
Straight operator-(const Straight& a, const Straight& b) { return {a.start - b.start, a.slope - b.slope}; }
Straight operator*(double s, const Straight& a) { return {s * a.start, s * a.slope}; }

/// A vector of degree 2 in u, 0 at one s: products of two that move straight need no bounds on the way to their sum.
struct Curve {
  Vec3 constant{}, linear{}, square{};
};

Curve operator+(const Curve& a, const Curve& b) { return {a.constant + b.constant, a.linear + b.linear, a.square + b.square}; }
Curve operator*(double s, const Curve& a) { return {s * a.constant, s * a.linear, s * a.square}; }

/// Where it is at one s.
struct Moment {
  using Number = double;
  double s;
  Vec3 operator()(const Straight& place) const { return place.start + s * place.slope; }
  Vec3 operator()(const Curve& curve) const { return curve.constant; }
  Curve product(const Straight& a, const Straight& b) const { return {cross((*this)(a), (*this)(b)), {}, {}}; }
};

/// Where it is while s goes through an interval.
struct Span {
  using Number = Centred;
  double middle, radius;
  Triple<Centred> operator()(const Straight& place) const {
    Triple<Centred> result;
    for (std::size_t k = 0; k < 3; ++k) result[k] = Centred::linear(place.start[k], place.slope[k], middle, radius);
    return result;
  }
  Triple<Centred> operator()(const Curve& curve) const {
    Triple<Centred> result;
    for (std::size_t k = 0; k < 3; ++k) {
      const double c = curve.constant[k], b = curve.linear[k], a = curve.square[k], slope = std::abs(b), bend = 2 * std::abs(a);
      result[k] = {c, {c + std::min(a, 0.0) - slope, c + std::max(a, 0.0) + slope}, {b - bend, b + bend}};
    }
    return result;
  }
  Curve product(const Straight& a, const Straight& b) const {
    const Vec3 at = a.start + middle * a.slope, bt = b.start + middle * b.slope, da = radius * a.slope, db = radius * b.slope;
    return {cross(at, bt), cross(at, db) + cross(da, bt), cross(da, db)};
  }
};

struct Side {
  std::uint32_t face;
  double sign;  ///< -1: the face's normal points into the cell
};

/// The corners of a face and their mean.
struct Outline {
  std::span<const Straight> corners;  ///< in those of the Body
  Straight mean;
  double sign;
};

/// A cell on its way, relative to one of its points: what all move alike does not blur the bounds.
struct Body {
  std::vector<Straight> corners;  ///< of all faces; never moved
  std::vector<Outline> faces;
  Straight mean;  ///< of the faces' means
};

/// Area vector of a face out of the cell, the centre of the face relative to the mean of its corners: the fan of triangles around
/// that mean, as PolyhedralQuality has it.
template <typename When, typename T = typename When::Number>
void measure(const Outline& face, const When& when, Triple<T>& area, Triple<T>& offset) {
  const auto& corners = face.corners;
  offset = {T(0.0), T(0.0), T(0.0)};
  if (corners.size() == 3) {
    area = when(0.5 * face.sign * when.product(corners[1] - corners[0], corners[2] - corners[0]));
    return;
  }
  Curve sum;
  T sizes(0.0);
  for (std::size_t c = 0; c < corners.size(); ++c) {
    const Straight &p = corners[c], &next = corners[(c + 1) % corners.size()];
    const Curve normal = when.product(next - p, face.mean - p);
    const T size = length(when(normal));
    sum = sum + normal;
    sizes = sizes + size;
    offset = offset + size * when((p - face.mean) + (next - face.mean));
  }
  area = when(0.5 * face.sign * sum);
  offset = inverse(3.0 * sizes) * offset;
}

/// Calls use(normalized, margin) for the volume and then the pyramid of every face: margin > 0 proves that it is positive, beyond
/// `share` of its size. Ends when use returns false.
template <typename When, typename Use>
void measure(const Body& body, const When& when, double share, const Use& use) {
  using T = typename When::Number;
  const std::size_t n = body.faces.size();
  if (n == 0) return;
  std::vector<Triple<T>> area(n), way(n);  // from the mean of the faces' centres to them
  Triple<T> mean{T(0.0), T(0.0), T(0.0)};
  for (std::size_t f = 0; f < n; ++f) {
    measure(body.faces[f], when, area[f], way[f]);
    mean = mean + way[f];
  }
  mean = (1.0 / static_cast<double>(n)) * mean;
  T volume(0.0);
  Triple<T> centre{T(0.0), T(0.0), T(0.0)};
  double extent = 0, sizes = 0;
  for (std::size_t f = 0; f < n; ++f) {
    way[f] = when(body.faces[f].mean - body.mean) + (way[f] - mean);
    const T pyramid = dot(area[f], way[f]);
    volume = volume + pyramid;
    centre = centre + pyramid * way[f];
    const double size = upper_bound(length(way[f]));
    extent = std::max(extent, size);
    sizes += upper_bound(length(area[f])) * size;
  }
  if (!use(lower_bound(volume) / sizes, lower_bound(volume) - share * sizes)) return;
  centre = inverse(volume) * (0.75 * centre);
  for (std::size_t f = 0; f < n; ++f) {
    const Triple<T> to_face = way[f] - centre;
    const double pyramid = lower_bound(dot(area[f], to_face)), size = upper_bound(length(area[f]));
    if (!use(pyramid / (size * upper_bound(length(to_face))), pyramid - share * size * extent)) return;
  }
}

class MovingPolyhedra : public MovingCells {
 public:
  MovingPolyhedra(const PolyhedralCells& cells, std::size_t points) : cells_(cells) {
    offsets_.assign(cells.cell_count + 1, 0);
    for (std::size_t f = 0; f < cells.face_count(); ++f) check(f, points);
    const auto for_each_side = [&](const auto& use) {
      for (std::size_t f = 0; f < cells.face_count(); ++f) {
        use(cells.owner[f], Side{static_cast<std::uint32_t>(f), 1});
        if (f < cells.internal_faces()) use(cells.neighbour[f], Side{static_cast<std::uint32_t>(f), -1});
      }
    };
    for_each_side([&](std::uint32_t cell, const Side&) { ++offsets_[cell + 1]; });
    for (std::size_t c = 0; c < cells.cell_count; ++c) offsets_[c + 1] += offsets_[c];
    sides_.resize(offsets_.back());
    std::vector<std::uint64_t> next(offsets_.begin(), offsets_.end() - 1);
    for_each_side([&](std::uint32_t cell, const Side& side) { sides_[next[cell]++] = side; });
  }

  std::size_t size() const override { return cells_.cell_count; }

  State state(PointSpan points, std::size_t c) const override {
    const Body body = body_of(points, points, c);
    State state{body.faces.empty() ? 0.0 : 1.0, body.faces.empty()};
    bool is_volume = true;
    measure(body, Moment{0}, tolerance, [&](double normalized, double margin) {
      if (std::isnan(normalized)) normalized = 0;
      state.inverted = state.inverted || !(margin > 0);
      if (!is_volume || state.inverted) state.determinant = std::min(state.determinant, normalized);
      if (!is_volume) return true;
      is_volume = false;
      state.without_volume = state.inverted;
      return !state.inverted;  // without a volume there is no centre
    });
    state.without_volume = state.without_volume || body.faces.empty();
    state.wrong_pyramid = state.inverted && !state.without_volume;
    return state;
  }

  Orientation orientation(PointSpan points, std::size_t c) const override {
    if (sound(body_of(points, points, c, 1))) return Orientation::positive;
    return sound(body_of(points, points, c, -1)) ? Orientation::mirrored : Orientation::neither;
  }

  /// Faces know their sides: all neighbours are of one kind.
  std::vector<CellLink> links() const override {
    std::vector<CellLink> links;
    for (std::size_t f = 0; f < cells_.internal_faces(); ++f) links.push_back({cells_.owner[f], cells_.neighbour[f], true});
    return links;
  }

  double first_inversion(PointSpan from, PointSpan to, std::size_t c, double bound) const override {
    const Body body = body_of(from, to, c);
    const auto rests = [](const Straight& place) { return place.slope == Vec3{}; };
    const bool rigid = std::all_of(body.faces.begin(), body.faces.end(), [&](const Outline& face) {
      return std::all_of(face.corners.begin(), face.corners.end(), rests);
    });
    return rigid ? unbounded : search(body, 0, 1, bound);
  }

  CellTolerance motion_tolerance(PointSpan rest, std::size_t c, double determinant) const override {
    std::vector<SignedFace> faces;
    for (const Side& side : sides(c)) faces.push_back({cells_.face(side.face), left_handed(c) ? -side.sign : side.sign});
    return polyhedron_tolerance(rest, faces, determinant);
  }
  int distortion() const override { return 1; }
  NodeLists nodes() const override { return {node_offsets_, node_ids_}; }

  void list_nodes() override {
    node_offsets_ = {0};
    node_offsets_.reserve(size() + 1);
    std::vector<PointId> of_cell;
    for (std::size_t c = 0; c < size(); ++c) {
      of_cell.clear();
      for (const Side& side : sides(c)) {
        const auto corners = cells_.face(side.face);
        of_cell.insert(of_cell.end(), corners.begin(), corners.end());
      }
      std::sort(of_cell.begin(), of_cell.end());
      node_ids_.insert(node_ids_.end(), of_cell.begin(), std::unique(of_cell.begin(), of_cell.end()));
      node_offsets_.push_back(node_ids_.size());
    }
    node_ids_.shrink_to_fit();
  }

 private:
  std::span<const Side> sides(std::size_t c) const {
    return std::span(sides_).subspan(static_cast<std::size_t>(offsets_[c]),
                                     static_cast<std::size_t>(offsets_[c + 1] - offsets_[c]));
  }

  void check(std::size_t f, std::size_t points) const {
    const FieldEntry face{"faces", f};
    check_ids(cells_.face(f), points, face, "point");
    check_ids({&cells_.owner[f], 1}, cells_.cell_count, face, "cell");
    if (f < cells_.internal_faces()) check_ids({&cells_.neighbour[f], 1}, cells_.cell_count, face, "cell");
  }

  Body body_of(PointSpan from, PointSpan to, std::size_t c) const { return body_of(from, to, c, left_handed(c) ? -1 : 1); }

  Body body_of(PointSpan from, PointSpan to, std::size_t c, double sign) const {
    Body body;
    const auto all = sides(c);
    body.faces.reserve(all.size());
    std::size_t corners = 0;
    for (const Side& side : all) corners += cells_.face(side.face).size();
    body.corners.reserve(corners);
    const PointId base = all.empty() || cells_.face(all[0].face).empty() ? 0 : cells_.face(all[0].face)[0];
    for (const Side& side : all) {
      Outline& face = body.faces.emplace_back(Outline{{}, {}, sign * side.sign});
      const std::size_t first = body.corners.size();
      for (const PointId p : cells_.face(side.face)) {
        const Vec3 start = from[p] - from[base];
        body.corners.push_back({start, (to[p] - to[base]) - start});
        face.mean = face.mean + body.corners.back();
      }
      face.corners = std::span<const Straight>(body.corners).subspan(first);
      face.mean = (1.0 / static_cast<double>(std::max<std::size_t>(1, face.corners.size()))) * face.mean;
      body.mean = body.mean + face.mean;
    }
    body.mean = (1.0 / static_cast<double>(std::max<std::size_t>(1, all.size()))) * body.mean;
    return body;
  }

  static bool sound(const Body& body) {
    bool sound = !body.faces.empty();
    measure(body, Moment{0}, tolerance, [&](double, double margin) { return sound = margin > 0; });
    return sound;
  }

  static bool proven(const Body& body, double low, double high) {
    bool sound = true;
    const auto use = [&](double, double margin) { return sound = margin > 0; };
    measure(body, Moment{high}, on_the_way, use);  // cheap, and where it fails there is nothing to prove
    if (sound) measure(body, Span{0.5 * (low + high), 0.5 * (high - low)}, on_the_way, use);
    return sound;
  }

  static double search(const Body& body, double low, double high, double bound) {
    if (low > bound || proven(body, low, high)) return unbounded;
    if (high - low <= std::max(resolution * high, least_step)) return low;
    const double middle = 0.5 * (low + high), first = search(body, low, middle, bound);
    return first <= middle ? first : search(body, middle, high, bound);
  }

  const PolyhedralCells& cells_;
  std::vector<std::uint64_t> offsets_;  ///< cells + 1
  std::vector<Side> sides_;             ///< of cell i: offsets_[i] .. offsets_[i+1]
  std::vector<std::uint64_t> node_offsets_;
  std::vector<PointId> node_ids_;
};

}  // namespace

std::unique_ptr<MovingCells> moving_polyhedra(const PolyhedralCells& cells, std::size_t points) {
  return std::make_unique<MovingPolyhedra>(cells, points);
}

}  // namespace deform::quality
