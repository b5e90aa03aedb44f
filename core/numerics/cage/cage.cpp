// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/numerics/cage/cage.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <string>
#include <utility>

#include "core/base/error.h"
#include "core/base/vectors.h"

namespace deform {

namespace {

[[noreturn]] void refuse(const std::string& message) { throw Error(ErrorCode::invalid_argument, message); }

std::string indexed(const char* list, std::size_t index) { return std::string(list) + "[" + std::to_string(index) + "]"; }

std::string edge_text(std::uint32_t a, std::uint32_t b) {
  return "the edge between vertices " + std::to_string(std::min(a, b)) + " and " + std::to_string(std::max(a, b));
}

/// "triangles[3], triangles[5] and triangles[9]", or the first few of very many.
std::string triangles_text(const std::vector<std::uint32_t>& triangles) {
  constexpr std::size_t most = 4;
  const std::size_t shown = std::min(triangles.size(), most);
  std::string text;
  for (std::size_t i = 0; i < shown; ++i) {
    text += (i == 0 ? "" : i + 1 == triangles.size() ? " and " : ", ") + indexed("triangles", triangles[i]);
  }
  return triangles.size() > shown ? text + " and " + std::to_string(triangles.size() - shown) + " more" : text;
}

}  // namespace

Cage::Cage(std::vector<Vec3> vertices, std::vector<Triangle> triangles)
    : vertices_(std::move(vertices)), triangles_(std::move(triangles)) {
  check_vertices();
  const Box box = bounding_box(vertices_);
  diagonal_ = norm(box.max - box.min);
  if (!std::isfinite(diagonal_) || !(diagonal_ > 0)) refuse("vertices: they have no extent, or too large a one");
  middle_ = 0.5 * box.min + 0.5 * box.max;
  int exponent = 0;
  std::frexp(diagonal_, &exponent);
  scale_ = std::ldexp(1.0, exponent);
  for (const Vec3& x : vertices_) places_.push_back(place(x));
  find_edges();
  check_fans();
  double volume = 0;
  for (const auto& [a, b, c] : triangles_) volume += dot(places_[a], cross(places_[b], places_[c])) / 6;
  if (std::abs(volume) < least_altitude * least_altitude * least_altitude) refuse("triangles: they enclose no volume");
  if (volume < 0) {
    for (Triangle& triangle : triangles_) std::swap(triangle[1], triangle[2]);
  }
  find_faces();
}

Vec3 Cage::place(const Vec3& x) const { return (x - middle_) / scale_; }

void Cage::check_vertices() const {
  const std::size_t count = vertices_.size();
  if (count < 4 || count > most_vertices) {
    refuse("vertices: there are " + std::to_string(count) + ", a cage takes 4 to " + std::to_string(most_vertices));
  }
  for (std::size_t i = 0; i < count; ++i) {
    if (!is_finite(vertices_[i])) refuse(indexed("vertices", i) + ": must be finite");
  }
  // A closed manifold has fewer than twice as many triangles as vertices, and four more for each of its handles.
  if (triangles_.size() > 4 * most_vertices) {
    refuse("triangles: there are " + std::to_string(triangles_.size()) + ", a cage takes at most " +
           std::to_string(4 * most_vertices));
  }
  std::vector<char> used(count, 0);
  for (std::size_t t = 0; t < triangles_.size(); ++t) {
    for (std::size_t k = 0; k < 3; ++k) {
      const std::uint32_t id = triangles_[t][k];
      if (id >= count) {
        refuse(indexed("triangles", t) + ": vertex " + std::to_string(id) + " is out of range, there are " +
               std::to_string(count));
      }
      if (id == triangles_[t][(k + 1) % 3]) refuse(indexed("triangles", t) + ": has vertex " + std::to_string(id) + " twice");
      used[id] = 1;
    }
  }
  const auto unused = std::find(used.begin(), used.end(), 0);
  if (unused != used.end()) {
    refuse(indexed("vertices", static_cast<std::size_t>(unused - used.begin())) + ": no triangle has it");
  }
}

void Cage::find_edges() {
  struct Uses {
    std::uint32_t number = 0;
    std::vector<std::uint32_t> up, down;  ///< triangles that run along it to the larger id, and back
  };
  std::map<std::pair<std::uint32_t, std::uint32_t>, Uses> found;
  for (std::uint32_t t = 0; t < triangles_.size(); ++t) {
    for (std::size_t k = 0; k < 3; ++k) {
      const std::uint32_t a = triangles_[t][k], b = triangles_[t][(k + 1) % 3];
      Uses& uses = found[{std::min(a, b), std::max(a, b)}];
      (a < b ? uses.up : uses.down).push_back(t);
    }
  }
  for (auto& [ends, uses] : found) {
    std::vector<std::uint32_t> all = uses.up;
    all.insert(all.end(), uses.down.begin(), uses.down.end());
    std::sort(all.begin(), all.end());
    if (all.size() == 1) {
      refuse(triangles_text(all) + ": the cage is open at " + edge_text(ends.first, ends.second) +
             ", which has no other triangle; every edge of a closed cage has two");
    }
    if (all.size() > 2) {
      refuse(triangles_text(all) + ": they share " + edge_text(ends.first, ends.second) +
             "; every edge of a cage has two triangles");
    }
    if (uses.up.size() != 1) {
      refuse(triangles_text(all) + ": both run along " + edge_text(ends.first, ends.second) +
             " in the same direction, so that one of them faces inwards; turn it round");
    }
    uses.number = static_cast<std::uint32_t>(edges_.size());
    const Vec3 along = places_[ends.second] - places_[ends.first];
    const double length = norm(along);
    if (!(length > least_altitude)) refuse("triangles: " + edge_text(ends.first, ends.second) + " has no length");
    edges_.push_back({{ends.first, ends.second}, along / length, length});
  }
  faces_.resize(triangles_.size());
  for (std::size_t t = 0; t < triangles_.size(); ++t) {
    for (std::size_t k = 0; k < 3; ++k) {
      const std::uint32_t a = triangles_[t][(k + 1) % 3], b = triangles_[t][(k + 2) % 3];
      faces_[t].sides[k] = found.at({std::min(a, b), std::max(a, b)}).number;
    }
  }
}

/// The triangles of a vertex are one fan where following them from side to side comes back after as many as there are.
void Cage::check_fans() const {
  std::map<std::pair<std::uint32_t, std::uint32_t>, std::uint32_t> next;  // vertex, corner before it in a triangle: corner behind
  std::vector<std::size_t> counts(vertices_.size(), 0);
  for (const Triangle& triangle : triangles_) {
    for (std::size_t k = 0; k < 3; ++k) {
      next[{triangle[k], triangle[(k + 2) % 3]}] = triangle[(k + 1) % 3];
      ++counts[triangle[k]];
    }
  }
  for (auto at = next.begin(); at != next.end();) {
    const std::uint32_t vertex = at->first.first, start = at->first.second;
    std::size_t steps = 0;
    std::uint32_t corner = start;
    do {
      corner = next.at({vertex, corner});
      ++steps;
    } while (corner != start && steps <= counts[vertex]);
    if (steps != counts[vertex]) {
      refuse(indexed("vertices", vertex) + ": its triangles meet at this vertex only; split it in two");
    }
    while (at != next.end() && at->first.first == vertex) ++at;
  }
}

void Cage::find_faces() {
  for (std::size_t t = 0; t < triangles_.size(); ++t) {
    Face& face = faces_[t];
    const Triangle before = face.corners = triangles_[t];
    // Sides were found before triangles were turned round.
    std::array<std::uint32_t, 3> sides = face.sides;
    for (std::size_t k = 0; k < 3; ++k) {
      const auto opposite = std::find_if(sides.begin(), sides.end(), [&](std::uint32_t side) {
        return edges_[side].ends[0] != before[k] && edges_[side].ends[1] != before[k];
      });
      face.sides[k] = *opposite;
    }
    const std::size_t longest = static_cast<std::size_t>(
        std::max_element(face.sides.begin(), face.sides.end(),
                         [&](std::uint32_t a, std::uint32_t b) { return edges_[a].length < edges_[b].length; }) -
        face.sides.begin());
    const Vec3& apex = places_[face.corners[longest]];
    const Vec3 across = cross(places_[face.corners[(longest + 1) % 3]] - apex, places_[face.corners[(longest + 2) % 3]] - apex);
    const double twice = norm(across);
    if (!(twice > least_altitude * edges_[face.sides[longest]].length)) {
      refuse(indexed("triangles", t) + ": is degenerate, its corners lie on a line");
    }
    face.normal = across / twice;
    for (std::size_t k = 0; k < 3; ++k) {
      const Edge& edge = edges_[face.sides[k]];
      const double sign = edge.ends[0] == face.corners[(k + 1) % 3] ? 1 : -1;
      const Vec3 inwards = cross(face.normal, sign * edge.along);
      face.inwards[k] = inwards / norm(inwards);
      face.altitudes[k] = twice / edge.length;
    }
  }
}

std::size_t Cage::bytes() const { return bytes_for(vertices_.size(), triangles_.size()); }

std::size_t Cage::bytes_for(std::size_t vertices, std::size_t triangles) {
  return vertices * 2 * sizeof(Vec3) + triangles * (sizeof(Triangle) + sizeof(Face) + 3 * sizeof(Edge) / 2) + sizeof(Cage);
}

FaceView view_of(const Cage::Face& face, std::span<const Vec3> to, std::span<const double> distances) {
  // From the nearest corner: what is rounded is the smaller then.
  std::size_t nearest = 0;
  for (std::size_t k = 1; k < 3; ++k) {
    if (distances[face.corners[k]] < distances[face.corners[nearest]]) nearest = k;
  }
  FaceView view;
  view.height = dot(face.normal, to[face.corners[nearest]]);
  for (std::size_t k = 0; k < 3; ++k) {
    const std::uint32_t a = face.corners[(k + 1) % 3], b = face.corners[(k + 2) % 3];
    view.from_sides[k] = -dot(face.inwards[k], to[distances[a] <= distances[b] ? a : b]);
  }
  return view;
}

}  // namespace deform
