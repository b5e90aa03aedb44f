// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include "core/base/checks.h"
#include "core/base/error.h"
#include "core/quality/moving_cells.h"
#include "core/quality/taylor_model.h"

namespace deform::quality {

namespace {

// Beside the operators below, which would hide them.
using quality::operator+;
using quality::operator-;
using quality::operator*;

constexpr double cell_tolerance = 1e-13;  // of areas times the size of the cell: several times the rounding of long sums
constexpr double cell_on_the_way = cell_tolerance / 2;  // so that what is not inverted at its start is not so right after it
constexpr double resolution = 1e-12;                    // of s
constexpr double least_step = 1e-30;

/// A place that moves straight: start + s slope.
struct Straight {
  Vec3 start{}, slope{};
};

Straight operator+(const Straight& a, const Straight& b) { return {a.start + b.start, a.slope + b.slope}; }
Straight operator-(const Straight& a, const Straight& b) { return {a.start - b.start, a.slope - b.slope}; }
Straight operator*(double s, const Straight& a) { return {s * a.start, s * a.slope}; }

/// A place that rests.
struct Fixed {
  Vec3 start{};
};

Fixed operator+(const Fixed& a, const Fixed& b) { return {a.start + b.start}; }
Fixed operator-(const Fixed& a, const Fixed& b) { return {a.start - b.start}; }
Fixed operator*(double s, const Fixed& a) { return {s * a.start}; }

/// A vector of degree 2 in u, 0 at one s: the product of two that move straight.
struct Curve {
  Vec3 constant{}, linear{}, square{};
};

Curve operator+(const Curve& a, const Curve& b) { return {a.constant + b.constant, a.linear + b.linear, a.square + b.square}; }
Curve operator*(double s, const Curve& a) { return {s * a.constant, s * a.linear, s * a.square}; }

/// Where it is at one s.
struct Moment {
  using Number = double;
  using Product = Vec3;
  double s = 0;
  Vec3 operator()(const Straight& place) const { return place.start + s * place.slope; }
  Vec3 operator()(const Fixed& place) const { return place.start; }
  Vec3 operator()(const Vec3& product) const { return product; }
  template <typename Place>
  Vec3 product(const Place& a, const Place& b) const {
    return cross((*this)(a), (*this)(b));
  }
  static double size(const Vec3& product) { return length(product); }
  template <typename Place>
  Vec3 times(double factor, const Place& place) const {
    return factor * (*this)(place);
  }
};

/// Where it is while s goes through an interval.
struct Span {
  using Number = TaylorModel;
  using Product = Curve;
  double middle, radius;
  Triple<TaylorModel> operator()(const Straight& place) const {
    Triple<TaylorModel> result;
    for (std::size_t k = 0; k < 3; ++k) {
      result[k] = {place.start[k] + middle * place.slope[k], radius * place.slope[k], 0};
    }
    return result;
  }
  Triple<TaylorModel> operator()(const Curve& curve) const {
    Triple<TaylorModel> result;
    for (std::size_t k = 0; k < 3; ++k) result[k] = {curve.constant[k], curve.linear[k], curve.square[k]};
    return result;
  }
  Curve product(const Straight& a, const Straight& b) const {
    const Vec3 at = a.start + middle * a.slope, bt = b.start + middle * b.slope, da = radius * a.slope, db = radius * b.slope;
    return {cross(at, bt), cross(at, db) + cross(da, bt), cross(da, db)};
  }
  static TaylorModel size(const Curve& product) {
    return square_root(squared_length(product.constant, product.linear, product.square));
  }
  Triple<TaylorModel> times(const TaylorModel& factor, const Straight& place) const {
    Triple<TaylorModel> result;
    for (std::size_t k = 0; k < 3; ++k) {
      result[k] = times_linear(factor, place.start[k] + middle * place.slope[k], radius * place.slope[k]);
    }
    return result;
  }
};

struct Side {
  std::uint32_t face;
  double sign;  ///< -1: the face's normal points into the cell
};

/// The corners of a face and their mean.
template <typename Place>
struct Outline {
  std::span<const Place> corners;  ///< in those of the Body
  Place mean;
  double sign;
};

/// A cell that rests or is on its way, relative to one of its points: what all move alike does not blur the bounds.
template <typename Place>
struct Body {
  std::vector<Place> corners;  ///< of all faces
  std::vector<Outline<Place>> faces;
  Place mean;  ///< of the faces' means
};

/// Area vector of a face out of the cell, the centre of the face relative to the mean of its corners: the fan of triangles around
/// that mean, as PolyhedralQuality has it.
template <typename Place, typename When, typename T = typename When::Number>
void measure(const Outline<Place>& face, const When& when, Triple<T>& area, Triple<T>& offset) {
  const auto& corners = face.corners;
  offset = {T(0.0), T(0.0), T(0.0)};
  if (corners.size() == 3) {
    area = when(0.5 * face.sign * when.product(corners[1] - corners[0], corners[2] - corners[0]));
    return;
  }
  typename When::Product sum{};
  T sizes(0.0);
  for (std::size_t c = 0; c < corners.size(); ++c) {
    const Place &p = corners[c], &next = corners[c + 1 == corners.size() ? 0 : c + 1];
    const auto normal = when.product(next - p, face.mean - p);
    const T size = when.size(normal);
    sum = sum + normal;
    sizes = sizes + size;
    offset = offset + when.times(size, (p - face.mean) + (next - face.mean));
  }
  area = when(0.5 * face.sign * sum);
  offset = inverse(3.0 * sizes) * offset;
}

/// Calls use(normalized, margin) for the volume and then the pyramid of every face: margin > 0 proves that it is positive, beyond
/// `share` of its size. Ends when use returns false.
template <typename Place, typename When, typename Use>
void measure(const Body<Place>& body, const When& when, double share, const Use& use) {
  using T = typename When::Number;
  const std::size_t n = body.faces.size();
  if (n == 0) return;
  thread_local std::vector<Triple<T>> area, way;  // from the mean of the faces' centres to them
  area.resize(n);
  way.resize(n);
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
    const double size = longest(way[f]);
    extent = std::max(extent, size);
    sizes += longest(area[f]) * size;
  }
  if (!use(lower_bound(volume) / sizes, lower_bound(volume) - share * sizes)) return;
  centre = inverse(volume) * (0.75 * centre);
  for (std::size_t f = 0; f < n; ++f) {
    const Triple<T> to_face = way[f] - centre;
    const double pyramid = lower_bound(dot(area[f], to_face)), size = longest(area[f]);
    if (!use(pyramid / (size * longest(to_face)), pyramid - share * size * extent)) return;
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
    const Body<Fixed>& body = resting(points, c, handed(c));
    State state{body.faces.empty() ? 0.0 : 1.0, body.faces.empty()};
    bool is_volume = true;
    measure(body, Moment{}, cell_tolerance, [&](double normalized, double margin) {
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
    if (sound(resting(points, c, 1))) return Orientation::positive;
    return sound(resting(points, c, -1)) ? Orientation::mirrored : Orientation::neither;
  }

  /// Faces know their sides: all neighbours are of one kind.
  std::vector<CellLink> links() const override {
    std::vector<CellLink> links;
    for (std::size_t f = 0; f < cells_.internal_faces(); ++f) links.push_back({cells_.owner[f], cells_.neighbour[f], true});
    return links;
  }

  double first_inversion(PointSpan from, PointSpan to, std::size_t c, double bound) const override {
    const Body<Straight>& body = moving(from, to, c);
    const auto rests = [](const Straight& place) { return place.slope == Vec3{}; };
    return std::all_of(body.corners.begin(), body.corners.end(), rests) ? unbounded : search(body, 0, 1, bound);
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

  double handed(std::size_t c) const { return left_handed(c) ? -1 : 1; }

  /// Valid until the next call by the same thread.
  const Body<Fixed>& resting(PointSpan points, std::size_t c, double sign) const {
    thread_local Body<Fixed> body;
    fill(body, c, sign, [&](PointId p, PointId base) { return Fixed{points[p] - points[base]}; });
    return body;
  }

  /// Valid until the next call by the same thread.
  const Body<Straight>& moving(PointSpan from, PointSpan to, std::size_t c) const {
    thread_local Body<Straight> body;
    fill(body, c, handed(c), [&](PointId p, PointId base) {
      const Vec3 start = from[p] - from[base];
      return Straight{start, (to[p] - to[base]) - start};
    });
    return body;
  }

  template <typename Place, typename At>
  void fill(Body<Place>& body, std::size_t c, double sign, const At& at) const {
    const auto all = sides(c);
    body.faces.clear();
    body.corners.clear();
    body.mean = {};
    std::size_t corners = 0;
    for (const Side& side : all) corners += cells_.face(side.face).size();
    body.corners.reserve(corners);  // so that they stay where they are
    const PointId base = all.empty() || cells_.face(all[0].face).empty() ? 0 : cells_.face(all[0].face)[0];
    for (const Side& side : all) {
      Outline<Place>& face = body.faces.emplace_back(Outline<Place>{{}, {}, sign * side.sign});
      const std::size_t first = body.corners.size();
      for (const PointId p : cells_.face(side.face)) {
        body.corners.push_back(at(p, base));
        face.mean = face.mean + body.corners.back();
      }
      face.corners = std::span<const Place>(body.corners).subspan(first);
      face.mean = (1.0 / static_cast<double>(std::max<std::size_t>(1, face.corners.size()))) * face.mean;
      body.mean = body.mean + face.mean;
    }
    body.mean = (1.0 / static_cast<double>(std::max<std::size_t>(1, all.size()))) * body.mean;
  }

  static bool sound(const Body<Fixed>& body) {
    bool sound = !body.faces.empty();
    measure(body, Moment{}, cell_tolerance, [&](double, double margin) { return sound = margin > 0; });
    return sound;
  }

  static bool proven(const Body<Straight>& body, double low, double high) {
    bool sound = true;
    const auto use = [&](double, double margin) { return sound = margin > 0; };
    measure(body, Moment{high}, cell_on_the_way, use);  // cheap, and where it fails there is nothing to prove
    if (sound) measure(body, Span{0.5 * (low + high), 0.5 * (high - low)}, cell_on_the_way, use);
    return sound;
  }

  static double search(const Body<Straight>& body, double low, double high, double bound) {
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
