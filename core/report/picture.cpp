// SPDX-License-Identifier: Apache-2.0
#include "core/report/picture.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numeric>
#include <unordered_map>

#include "core/base/error.h"
#include "core/quality/polygon.h"

namespace deform {

namespace {

using namespace quality;

using Of = PictureField::Of;
constexpr std::uint32_t none = std::numeric_limits<std::uint32_t>::max();

struct Triangle {
  std::array<std::uint32_t, 3> corners;
  std::uint8_t edges;
  FaceId face;
};

class PictureMaker {
 public:
  PictureMaker(const PictureSource& source, const RunContext& context) : source_(source), context_(context) {
    const std::size_t n = source.mesh.point_count();
    if (!source.before.empty() && source.before.size() != n) refuse("before", source.before.size(), n);
    for (const PictureField& field : source.fields) {
      const std::size_t expected = field.of == Of::faces ? source.mesh.face_count() : n;
      if (field.values.size() != expected) refuse(field.label, field.values.size(), expected);
    }
    for (const FaceId f : source.shown) {
      if (f >= source.mesh.face_count()) refuse("shown", f, source.mesh.face_count());
    }
  }

  Picture run() {
    cut();
    picture_.all_triangles = triangles_.size();
    if (triangles_.size() > source_.most_triangles) thin();
    keep_used_points();
    fit();
    name_parts();
    for (const PictureField& field : source_.fields) add_field(field);
    return std::move(picture_);
  }

 private:
  [[noreturn]] static void refuse(const std::string& what, std::size_t size, std::size_t expected) {
    throw Error(ErrorCode::invalid_argument,
                "picture: " + what + " has " + std::to_string(size) + " values, expected " + std::to_string(expected));
  }

  /// Triangulates the faces; the middle points of polygons follow the points of the mesh.
  void cut() {
    const Mesh& mesh = source_.mesh;
    points_ = mesh.points;
    before_.assign(source_.before.begin(), source_.before.end());
    std::size_t first = 0;
    for (FaceId f = 0; f < mesh.face_count(); ++f) {
      const auto corners = std::span(mesh.face_points).subspan(first, mesh.face_sizes[f]);
      first += corners.size();
      if (corners.size() == 3) triangles_.push_back({{corners[0], corners[1], corners[2]}, 7, f});
      if (corners.size() <= 3) continue;
      const auto middle = static_cast<std::uint32_t>(points_.size());
      points_.push_back(mean_of(mesh.points, corners));
      if (!before_.empty()) before_.push_back(mean_of(source_.before, corners));
      middle_faces_.push_back(f);
      for (std::size_t c = 0; c < corners.size(); ++c) {
        triangles_.push_back({{corners[c], corners[c + 1 == corners.size() ? 0 : c + 1], middle}, 4, f});
      }
    }
  }

  void thin() {
    const Box box = bounding_box(points_);
    const double longest = box.side(box.longest_axis());
    std::vector<Triangle> all = std::move(triangles_);
    for (std::size_t grid = 2048; grid >= 1; grid /= 2) {
      context_.check();
      picture_.grid = grid;
      const double cell = longest > 0 ? longest / static_cast<double>(grid) : 1;
      triangles_ = merged(all, box.min, cell);
      if (triangles_.size() <= source_.most_triangles) return;
    }
    triangles_.resize(source_.most_triangles);
  }

  std::vector<Triangle> merged(const std::vector<Triangle>& all, const Vec3& origin, double cell) const {
    std::unordered_map<std::uint64_t, std::uint32_t> first;
    std::vector<std::uint32_t> stands_for(points_.size());
    for (std::size_t i = 0; i < points_.size(); ++i) {
      std::uint64_t key = 0;
      for (int k = 0; k < 3; ++k) {
        key = key << 12 | std::min<std::uint64_t>(4095, static_cast<std::uint64_t>((points_[i][k] - origin[k]) / cell));
      }
      stands_for[i] = first.try_emplace(key, static_cast<std::uint32_t>(i)).first->second;
    }
    std::vector<Triangle> kept;
    for (Triangle t : all) {
      for (auto& corner : t.corners) corner = stands_for[corner];
      if (t.corners[0] == t.corners[1] || t.corners[1] == t.corners[2] || t.corners[2] == t.corners[0]) continue;
      t.edges = 7;  // the edges of the thinned surface: those of the mesh are gone
      kept.push_back(t);
    }
    std::vector<std::array<std::uint32_t, 3>> keys;
    keys.reserve(kept.size());
    for (const Triangle& t : kept) {
      keys.push_back(t.corners);
      std::sort(keys.back().begin(), keys.back().end());
    }
    std::vector<std::uint32_t> order(kept.size());
    std::iota(order.begin(), order.end(), 0u);
    std::sort(order.begin(), order.end(),
              [&](std::uint32_t a, std::uint32_t b) { return keys[a] != keys[b] ? keys[a] < keys[b] : a < b; });
    const auto last =
        std::unique(order.begin(), order.end(), [&](std::uint32_t a, std::uint32_t b) { return keys[a] == keys[b]; });
    order.erase(last, order.end());
    std::sort(order.begin(), order.end());
    std::vector<Triangle> result;
    for (const std::uint32_t t : order) result.push_back(kept[t]);
    return result;
  }

  void keep_used_points() {
    std::vector<std::uint32_t> number(points_.size(), none);
    for (const Triangle& t : triangles_) {
      for (const std::uint32_t p : t.corners) {
        if (number[p] == none) {
          number[p] = static_cast<std::uint32_t>(used_.size());
          used_.push_back(p);
        }
        picture_.corners.push_back(number[p]);
      }
      picture_.edges.push_back(t.edges);
    }
  }

  void fit() {
    if (used_.empty()) return;
    const Box box = bounding_box(points_, used_);
    picture_.centre = 0.5 * (box.min + box.max);
    picture_.scale = box.diagonal() > 0 ? box.diagonal() / 2 : 1;
    const auto append = [&](std::vector<float>& out, const Vec3& p) {
      for (int k = 0; k < 3; ++k) out.push_back(static_cast<float>((p[k] - picture_.centre[k]) / picture_.scale));
    };
    for (const std::uint32_t p : used_) append(picture_.points, points_[p]);
    if (before_.empty()) return;
    for (const std::uint32_t p : used_) append(picture_.before, before_[p]);
  }

  void name_parts() {
    constexpr std::size_t most = 65534;  // groups behind them count as none
    const auto& groups = source_.mesh.groups;
    const std::size_t named = std::min(groups.size(), most);
    std::vector<std::size_t> first(source_.mesh.face_count(), named);
    for (std::size_t g = named; g-- > 0;) {
      for (const FaceId f : groups[g].faces) first[f] = g;
    }
    std::vector<char> drawn(named + 1), shown(named + 1, source_.shown.empty());
    for (const Triangle& t : triangles_) drawn[first[t.face]] = 1;
    for (const FaceId f : source_.shown) shown[first[f]] = 1;
    std::vector<std::uint16_t> number(named + 1);
    for (std::size_t g = 0; g <= named; ++g) {
      if (!drawn[g]) continue;
      number[g] = static_cast<std::uint16_t>(picture_.parts.size());
      picture_.parts.push_back({g < named ? groups[g].name : "", shown[g] != 0});
    }
    for (const Triangle& t : triangles_) picture_.part.push_back(number[first[t.face]]);
  }

  void add_field(const PictureField& source) {
    Picture::Field field{source.label, source.of, source.better, {}, 0, 0, false};
    if (source.of == Of::faces) {
      for (const Triangle& t : triangles_) field.values.push_back(static_cast<float>(source.values[t.face]));
    } else {
      for (const std::uint32_t p : used_) field.values.push_back(static_cast<float>(point_value(source.values, p)));
    }
    set_range(field);
    picture_.fields.push_back(std::move(field));
  }

  /// The value of a point; for the middle of a face the mean of the corners that have a value.
  double point_value(const std::vector<double>& values, std::uint32_t point) {
    const std::size_t n = source_.mesh.point_count();
    if (point < n) return values[point];
    if (offsets_.empty()) offsets_ = source_.mesh.face_offsets();
    const FaceId face = middle_faces_[point - n];
    double sum = 0;
    std::size_t count = 0;
    for (std::uint64_t c = offsets_[face]; c < offsets_[face + 1]; ++c) {
      const double value = values[source_.mesh.face_points[c]];
      if (std::isnan(value)) continue;
      sum += value;
      ++count;
    }
    return count > 0 ? sum / static_cast<double>(count) : std::numeric_limits<double>::quiet_NaN();
  }

  static void set_range(Picture::Field& field) {
    std::vector<float> sorted;
    std::copy_if(field.values.begin(), field.values.end(), std::back_inserter(sorted), [](float v) { return std::isfinite(v); });
    if (sorted.empty()) return;
    std::sort(sorted.begin(), sorted.end());
    field.low = static_cast<double>(sorted.front());
    field.high = static_cast<double>(sorted.back());
    if (field.of != Of::points) return;
    const float hundredth = sorted[(sorted.size() - 1) * 99 / 100];  // one spike would leave no colour to the rest
    if (field.high > 2 * static_cast<double>(hundredth) && static_cast<double>(hundredth) > field.low) {
      field.high = static_cast<double>(hundredth);
      field.clipped = true;
    }
  }

  const PictureSource& source_;
  const RunContext& context_;
  Picture picture_;
  std::vector<Triangle> triangles_;
  Points points_, before_;
  std::vector<FaceId> middle_faces_;
  std::vector<std::uint32_t> used_;  ///< points that are drawn
  std::vector<std::uint64_t> offsets_;
};

}  // namespace

Picture make_picture(const PictureSource& source, const RunContext& context) { return PictureMaker(source, context).run(); }

}  // namespace deform
