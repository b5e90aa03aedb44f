// SPDX-License-Identifier: Apache-2.0
#include "core/mesh/wall_columns.h"

#include <algorithm>
#include <array>
#include <limits>
#include <numeric>
#include <optional>
#include <utility>

#include "core/base/checks.h"
#include "core/base/error.h"
#include "core/mesh/cells.h"
#include "core/mesh/elements.h"

namespace deform {

namespace {

constexpr std::uint32_t none = std::numeric_limits<std::uint32_t>::max();

/// The number of a face of a cell: of the mesh for polyhedral cells, of the element's shape for elements.
struct Side {
  std::uint32_t cell = 0, face = 0;
};

using WallCorners = std::span<const PointId>;

/// Finds the opposite face in time proportional to the number of corners of the first face, so that the cost of any cell, however
/// odd, is linear in its size.
class Prisms {
 public:
  explicit Prisms(std::size_t points) : place_(points, none) {}

  /// The face of a cell that is opposite to another, and the corners of the cell above those of the other.
  struct Opposite {
    std::size_t face = 0;
    std::vector<std::pair<PointId, PointId>> edges;  ///< from the corners of the one face to those above them
  };

  /// That of faces[base]; std::nullopt if the cell is not a prism over it.
  std::optional<Opposite> opposite(std::span<const WallCorners> faces, std::size_t base) {
    const std::optional<std::size_t> top = candidate(faces, base);
    if (!top) return {};
    const bool prism = mark(faces[base], 0) && mark(faces[*top], faces[base].size()) && joined(faces, base, *top);
    for (const std::size_t f : {base, *top}) {
      for (const PointId p : faces[f]) place_[p] = none;
    }
    if (!prism) return {};
    Opposite result{*top, {}};
    for (std::size_t i = 0; i < above_.size(); ++i) result.edges.emplace_back(faces[base][i], faces[*top][above_[i]]);
    return result;
  }

 private:
  /// Found by its number of corners; among quads it is the one without a point of the base.
  static std::optional<std::size_t> candidate(std::span<const WallCorners> faces, std::size_t base) {
    const std::size_t n = faces[base].size();
    if (n < 3 || faces.size() != n + 2) return {};
    std::optional<std::size_t> top;
    for (std::size_t f = 0; f < faces.size(); ++f) {
      if (f == base) continue;
      if (faces[f].size() != n) {
        if (faces[f].size() != 4) return {};
        continue;
      }
      if (n == 4 &&
          std::find_first_of(faces[f].begin(), faces[f].end(), faces[base].begin(), faces[base].end()) != faces[f].end()) {
        continue;
      }
      if (top) return {};
      top = f;
    }
    return top;
  }

  /// Returns false if a corner already has a place.
  bool mark(WallCorners corners, std::size_t first) {
    for (const PointId p : corners) {
      if (place_[p] != none) return false;
      place_[p] = static_cast<std::uint32_t>(first++);
    }
    return true;
  }

  /// Whether the quads lead from every edge of the base to one of the top, all the way around.
  bool joined(std::span<const WallCorners> faces, std::size_t base, std::size_t top) {
    const std::size_t n = faces[base].size();
    above_.assign(n, none);
    seen_.assign(n, 0);
    for (std::size_t f = 0; f < faces.size(); ++f) {
      if (f != base && f != top && !join(faces[f], n)) return false;
    }
    // Every edge of the base has been seen, as there are as many quads; the corners above must follow each other either way.
    const std::size_t step = above_[1] == (above_[0] + 1) % n ? 1 : n - 1;
    for (std::size_t i = 0; i < n; ++i) {
      if (above_[(i + 1) % n] != (above_[i] + step) % n) return false;
    }
    return true;
  }

  bool join(WallCorners quad, std::size_t n) {
    std::array<std::uint32_t, 4> at{};
    std::size_t first = 0;  // corner after which the second one of the base follows
    for (std::size_t c = 0; c < 4; ++c) {
      at[c] = place_[quad[c]];
      if (at[c] == none) return false;
    }
    while (first < 4 && !(at[first] < n && at[(first + 1) % 4] < n && at[(first + 2) % 4] >= n && at[(first + 3) % 4] >= n)) {
      ++first;
    }
    if (first == 4) return false;
    const std::uint32_t i = at[first], j = at[(first + 1) % 4];
    const std::size_t edge = j == (i + 1) % n ? i : i == (j + 1) % n ? j : n;
    if (edge == n || seen_[edge]) return false;
    seen_[edge] = 1;
    return put(i, at[(first + 3) % 4] - n) && put(j, at[(first + 2) % 4] - n);
  }

  bool put(std::size_t corner, std::size_t above) {
    if (above_[corner] != none) return above_[corner] == above;
    above_[corner] = static_cast<std::uint32_t>(above);
    return true;
  }

  std::vector<std::uint32_t> place_;  // of a point: in the base 0..n-1, in the top n..2n-1
  std::vector<std::uint32_t> above_;  // per corner of the base the one of the top
  std::vector<char> seen_;            // edges of the base
};

bool all_in(WallCorners corners, const std::vector<char>& set) {
  return std::all_of(corners.begin(), corners.end(), [&](PointId p) { return set[p] != 0; });
}

/// The opposite side of a cell, with Prisms::Opposite::edges.
struct OppositeSide {
  Side side;
  std::vector<std::pair<PointId, PointId>> edges;
};

class FaceCells {
 public:
  FaceCells(const PolyhedralCells& cells, std::size_t points, const std::vector<char>&)
      : cells_(cells), prisms_(points), offsets_(cells.cell_count + 1), faces_(cells.owner.size() + cells.neighbour.size()) {
    for (const std::uint32_t cell : cells.owner) ++offsets_[cell + 1];
    for (const std::uint32_t cell : cells.neighbour) ++offsets_[cell + 1];
    std::partial_sum(offsets_.begin(), offsets_.end(), offsets_.begin());
    std::vector<std::uint64_t> next(offsets_.begin(), offsets_.end() - 1);
    for (std::size_t f = 0; f < cells.face_count(); ++f) {
      faces_[next[cells.owner[f]]++] = static_cast<FaceId>(f);
      if (f < cells.internal_faces()) faces_[next[cells.neighbour[f]]++] = static_cast<FaceId>(f);
    }
  }

  std::vector<Side> wall(const std::vector<char>& set) const {
    std::vector<Side> sides;
    for (std::size_t f = cells_.internal_faces(); f < cells_.face_count(); ++f) {
      if (all_in(cells_.face(f), set)) sides.push_back({cells_.owner[f], static_cast<FaceId>(f)});
    }
    return sides;
  }

  std::optional<OppositeSide> opposite(Side side) {
    const auto faces = faces_of(side.cell);
    if (faces.size() != cells_.face(side.face).size() + 2) return {};
    corners_.clear();
    std::size_t base = 0;
    for (std::size_t f = 0; f < faces.size(); ++f) {
      corners_.push_back(cells_.face(faces[f]));
      if (faces[f] == side.face) base = f;
    }
    auto found = prisms_.opposite(corners_, base);
    if (!found) return {};
    return OppositeSide{{side.cell, faces[found->face]}, std::move(found->edges)};
  }

  std::optional<Side> behind(Side side) const {
    if (side.face >= cells_.internal_faces()) return {};
    const std::uint32_t owner = cells_.owner[side.face];
    return Side{owner == side.cell ? cells_.neighbour[side.face] : owner, side.face};
  }

  void add_points(std::uint32_t cell, std::vector<PointId>& points) const {
    for (const FaceId f : faces_of(cell)) points.insert(points.end(), cells_.face(f).begin(), cells_.face(f).end());
  }

 private:
  std::span<const FaceId> faces_of(std::uint32_t cell) const {
    return std::span(faces_).subspan(offsets_[cell], static_cast<std::size_t>(offsets_[cell + 1] - offsets_[cell]));
  }

  const PolyhedralCells& cells_;
  Prisms prisms_;
  std::vector<std::uint64_t> offsets_;
  std::vector<FaceId> faces_;  // cell by cell
  std::vector<WallCorners> corners_;
};

class ElementCells {
 public:
  ElementCells(const Elements& elements, std::size_t points, const std::vector<char>& set)
      : elements_(elements), prisms_(points), offsets_(points + 1) {
    for_each_side(set, [&](Side, const Key& key) { ++offsets_[key[0] + 1]; });
    std::partial_sum(offsets_.begin(), offsets_.end(), offsets_.begin());
    sides_.resize(offsets_.back());
    std::vector<std::uint64_t> next(offsets_.begin(), offsets_.end() - 1);
    for_each_side(set, [&](Side side, const Key& key) { sides_[next[key[0]]++] = side; });
    for (std::size_t p = 0; p < points; ++p) {
      std::sort(sides_.begin() + at(offsets_[p]), sides_.begin() + at(offsets_[p + 1]), [&](Side a, Side b) {
        const Key left = key_of(a), right = key_of(b);
        return left != right ? left < right : a.cell != b.cell ? a.cell < b.cell : a.face < b.face;
      });
    }
  }

  std::vector<Side> wall(const std::vector<char>& set) const {
    std::vector<Side> walls;
    for_each_side(set, [&](Side side, const Key& key) {
      if (all_in(corners(side).view(), set) && same(key).size() == 1) walls.push_back(side);
    });
    return walls;
  }

  std::optional<OppositeSide> opposite(Side side) {
    const std::size_t count = shape(elements_.types[side.cell]).faces.size();
    std::array<Quad, most_faces> faces;
    std::array<WallCorners, most_faces> views;
    for (std::uint32_t f = 0; f < count; ++f) {
      faces[f] = corners({side.cell, f});
      views[f] = faces[f].view();
    }
    auto found = prisms_.opposite(std::span(views).first(count), side.face);
    if (!found) return {};
    return OppositeSide{{side.cell, static_cast<std::uint32_t>(found->face)}, std::move(found->edges)};
  }

  std::optional<Side> behind(Side side) const {
    const auto both = same(key_of(side));
    if (both.size() != 2) return {};
    return both[both[0].cell == side.cell ? 1 : 0];
  }

  void add_points(std::uint32_t cell, std::vector<PointId>& points) const {
    const auto nodes = elements_.nodes(cell);
    points.insert(points.end(), nodes.begin(), nodes.end());
  }

 private:
  static constexpr std::size_t most_faces = 6;
  using Key = std::array<PointId, 4>;  // sorted corners; triangles end with `none`

  struct Quad {
    std::array<PointId, 4> points{};
    std::size_t size = 0;
    WallCorners view() const { return WallCorners(points).first(size); }
  };

  static std::ptrdiff_t at(std::uint64_t place) { return static_cast<std::ptrdiff_t>(place); }

  Quad corners(Side side) const {
    const ElementShape& form = shape(elements_.types[side.cell]);
    const auto nodes = elements_.nodes(side.cell);
    const auto& around = form.faces[side.face];
    Quad quad;
    for (std::size_t i = 0; i < around.size(); i += form.quadratic() ? 2 : 1) quad.points[quad.size++] = nodes[around[i]];
    return quad;
  }

  Key key_of(Side side) const {
    Quad quad = corners(side);
    std::fill(quad.points.begin() + at(quad.size), quad.points.end(), none);
    std::sort(quad.points.begin(), quad.points.end());
    return quad.points;
  }

  /// Those that can be in a column or on the wall: of prisms and hexahedra all, of others those with all corners in the set.
  template <typename Use>
  void for_each_side(const std::vector<char>& set, const Use& use) const {
    for (std::uint32_t e = 0; e < elements_.size(); ++e) {
      const ElementShape& form = shape(elements_.types[e]);
      const bool stands = form.corners == 6 || form.corners == 8;
      for (std::uint32_t f = 0; f < form.faces.size(); ++f) {
        const Side side{e, f};
        if (stands || all_in(corners(side).view(), set)) use(side, key_of(side));
      }
    }
  }

  /// The sides with these corners.
  std::span<const Side> same(const Key& key) const {
    const auto first = sides_.begin() + at(offsets_[key[0]]), last = sides_.begin() + at(offsets_[key[0] + 1]);
    const auto low = std::lower_bound(first, last, key, [&](Side side, const Key& k) { return key_of(side) < k; });
    const auto high = std::upper_bound(low, last, key, [&](const Key& k, Side side) { return k < key_of(side); });
    return {low, high};
  }

  const Elements& elements_;
  Prisms prisms_;
  std::vector<std::uint64_t> offsets_;  // of the sides by their least corner
  std::vector<Side> sides_;             // those of the same least corner ordered by their keys
};

/// Adds the corners above those of the last level.
void add_level(const std::vector<std::pair<PointId, PointId>>& edges, WallColumns::Stack& stack) {
  if (stack.corners.empty()) {
    stack.sides = edges.size();
    for (const auto& edge : edges) stack.corners.push_back(edge.first);
  }
  const std::size_t below = stack.corners.size() - stack.sides;
  for (std::size_t c = 0; c < stack.sides; ++c) {
    const PointId corner = stack.corners[below + c];
    const auto edge = std::find_if(edges.begin(), edges.end(), [&](const auto& e) { return e.first == corner; });
    stack.corners.push_back(edge->second);
  }
}

template <typename Cells>
WallColumns columns_of(Cells cells, const std::vector<char>& set, int layers, const std::string& what) {
  WallColumns result;
  const std::vector<Side> wall = cells.wall(set);
  result.faces = wall.size();
  if (wall.empty()) {
    throw Error(ErrorCode::invalid_argument,
                what + ": no face on the boundary of the cells has all its corners in the region (give a patch)");
  }
  for (const Side face : wall) {
    std::vector<PointId> points;
    WallColumns::Stack stack;
    int height = 0;
    for (std::optional<Side> side = face; side && height < layers; ++height) {
      const auto opposite = cells.opposite(*side);
      if (!opposite) break;
      cells.add_points(side->cell, points);
      add_level(opposite->edges, stack);
      side = cells.behind(opposite->side);
    }
    if (height == 0) {
      ++result.bare;
      continue;
    }
    if (height < layers) ++result.shorter;
    std::sort(points.begin(), points.end());
    points.erase(std::unique(points.begin(), points.end()), points.end());
    result.points.push_back(std::move(points));
    result.stacks.push_back(std::move(stack));
  }
  if (result.points.empty()) {
    throw Error(ErrorCode::invalid_argument, what + ": no prism or hexahedron stands on any of the " +
                                                 std::to_string(result.faces) +
                                                 " faces of the region; there are no layers to keep");
  }
  return result;
}

}  // namespace

WallColumns wall_columns(const Mesh& mesh, std::span<const PointId> points, int layers, const std::string& what) {
  if (layers < 1 || layers > most_wall_layers) {
    throw Error(ErrorCode::invalid_argument,
                what + ".layers: " + std::to_string(layers) + " is out of range 1.." + std::to_string(most_wall_layers));
  }
  if (mesh.cell_count() == 0) {
    throw Error(ErrorCode::invalid_argument, what + ".layers: the mesh has no cells, only volume meshes have layers of them");
  }
  std::vector<char> set(mesh.point_count());
  check_ids(points, set.size(), what, "point");
  for (const PointId p : points) set[p] = 1;
  if (mesh.elements) return columns_of(ElementCells(*mesh.elements, set.size(), set), set, layers, what);
  return columns_of(FaceCells(*mesh.cells, set.size(), set), set, layers, what);
}

}  // namespace deform
