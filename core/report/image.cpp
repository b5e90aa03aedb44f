// SPDX-License-Identifier: Apache-2.0
#include "core/report/image.h"

#include <zlib.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "core/base/error.h"
#include "core/base/vectors.h"

namespace deform {

namespace {

using Colour = std::array<double, 3>;

constexpr std::size_t finer = 2;  // pixels are means of so many along each axis
constexpr std::array<Colour, 4> scale_colours{{{222, 226, 229}, {113, 178, 196}, {38, 97, 135}, {68, 1, 84}}};
constexpr Colour grey{150, 156, 162}, error_colour{214, 40, 40};

Colour colour_at(double value) {
  if (std::isnan(value)) return grey;
  const double place = std::clamp(value, 0.0, 1.0) * (scale_colours.size() - 1);
  const auto k = std::min(static_cast<std::size_t>(place), scale_colours.size() - 2);
  Colour colour{};
  for (std::size_t c = 0; c < 3; ++c) {
    colour[c] = scale_colours[k][c] + (place - static_cast<double>(k)) * (scale_colours[k + 1][c] - scale_colours[k][c]);
  }
  return colour;
}

void append_number(std::string& out, std::uint32_t number) {
  for (int k = 3; k >= 0; --k) out += static_cast<char>(number >> (8 * k));
}

void append_chunk(std::string& out, const std::string& type, const std::string& data) {
  append_number(out, static_cast<std::uint32_t>(data.size()));
  const std::string body = type + data;
  out += body;
  append_number(
      out, static_cast<std::uint32_t>(crc32(0, reinterpret_cast<const Bytef*>(body.data()), static_cast<uInt>(body.size()))));
}

/// Every row as its difference from the pixel on the left.
std::string filtered(const Image& image) {
  constexpr char left_difference = 1;
  std::string rows;
  rows.reserve(image.height * (4 * image.width + 1));
  for (std::size_t y = 0; y < image.height; ++y) {
    rows += left_difference;
    const std::uint8_t* row = image.pixels.data() + 4 * image.width * y;
    for (std::size_t i = 0; i < 4 * image.width; ++i) rows += static_cast<char>(row[i] - (i < 4 ? 0 : row[i - 4]));
  }
  return rows;
}

std::string compressed(const std::string& data) {
  uLongf size = compressBound(static_cast<uLong>(data.size()));
  std::string out(size, '\0');
  const int result = compress2(reinterpret_cast<Bytef*>(out.data()), &size, reinterpret_cast<const Bytef*>(data.data()),
                               static_cast<uLong>(data.size()), Z_BEST_COMPRESSION);
  if (result != Z_OK) throw Error(ErrorCode::internal, "png: zlib error " + std::to_string(result));
  out.resize(size);
  return out;
}

/// A picture and its depths, finer than what comes of it.
class Canvas {
 public:
  Canvas(const View& view, std::size_t width, std::size_t height)
      : view_(view),
        width_(finer * width),
        height_(finer * height),
        scale_(static_cast<double>(width_) / view.width),
        colours_(width_ * height_),
        depths_(width_ * height_, -std::numeric_limits<double>::infinity()) {}

  void triangle(const Vec3& a, const Vec3& b, const Vec3& c, const Colour& colour) {
    const Vec3 p = placed(a), q = placed(b), r = placed(c);
    const double twice = (q[0] - p[0]) * (r[1] - p[1]) - (q[1] - p[1]) * (r[0] - p[0]);
    if (twice == 0 || !std::isfinite(twice)) return;
    const auto [left, right] = pixels({p[0], q[0], r[0]}, width_);
    const auto [top, bottom] = pixels({p[1], q[1], r[1]}, height_);
    for (std::size_t y = top; y < bottom; ++y) {
      const double py = static_cast<double>(y) + 0.5;
      for (std::size_t x = left; x < right; ++x) {
        const double px = static_cast<double>(x) + 0.5;
        const double u = ((q[0] - px) * (r[1] - py) - (q[1] - py) * (r[0] - px)) / twice;
        const double v = ((r[0] - px) * (p[1] - py) - (r[1] - py) * (p[0] - px)) / twice;
        if (u < 0 || v < 0 || u + v > 1) continue;
        const double depth = u * p[2] + v * q[2] + (1 - u - v) * r[2];
        double& nearest = depths_[x + width_ * y];
        if (!(depth > nearest)) continue;
        nearest = depth;
        colours_[x + width_ * y] = colour;
      }
    }
  }

  /// How much of a face's colour is seen when this is its normal.
  double light(const Vec3& normal) const {
    const Vec3 lamp = 0.25 * view_.axes[0] + 0.35 * view_.axes[1] + 0.9 * view_.axes[2];
    const double size = norm(normal);
    return size > 0 ? 0.45 + 0.55 * std::abs(dot(normal, lamp)) / (size * norm(lamp)) : 1;
  }

  Image image() const {
    Image image{width_ / finer, height_ / finer, {}};
    for (std::size_t y = 0; y < image.height; ++y) {
      for (std::size_t x = 0; x < image.width; ++x) append_pixel(image.pixels, x, y);
    }
    return image;
  }

 private:
  Vec3 placed(const Vec3& point) const {
    const Vec3 away = point - view_.centre;
    return {0.5 * static_cast<double>(width_) + scale_ * dot(away, view_.axes[0]),
            0.5 * static_cast<double>(height_) - scale_ * dot(away, view_.axes[1]), dot(away, view_.axes[2])};
  }

  /// The pixels whose middles can be between these coordinates.
  static std::pair<std::size_t, std::size_t> pixels(std::array<double, 3> at, std::size_t size) {
    const auto [low, high] = std::minmax_element(at.begin(), at.end());
    const double last = static_cast<double>(size);
    return {static_cast<std::size_t>(std::clamp(std::floor(*low), 0.0, last)),
            static_cast<std::size_t>(std::clamp(std::ceil(*high), 0.0, last))};
  }

  void append_pixel(std::vector<std::uint8_t>& pixels, std::size_t x, std::size_t y) const {
    Colour sum{};
    std::size_t covered = 0;
    for (std::size_t j = 0; j < finer; ++j) {
      for (std::size_t i = 0; i < finer; ++i) {
        const std::size_t at = finer * x + i + width_ * (finer * y + j);
        if (std::isinf(depths_[at])) continue;
        ++covered;
        for (std::size_t c = 0; c < 3; ++c) sum[c] += colours_[at][c];
      }
    }
    for (const double part : sum) {
      pixels.push_back(covered == 0 ? 0 : static_cast<std::uint8_t>(std::lround(part / static_cast<double>(covered))));
    }
    pixels.push_back(static_cast<std::uint8_t>(255 * covered / (finer * finer)));
  }

  const View& view_;
  std::size_t width_, height_;
  double scale_;
  std::vector<Colour> colours_;
  std::vector<double> depths_;  // minus infinity where there is nothing
};

[[noreturn]] void refuse_size(const char* what, std::size_t size, std::size_t expected) {
  throw Error(ErrorCode::invalid_argument,
              std::string("image: ") + what + " has " + std::to_string(size) + " entries, expected " + std::to_string(expected));
}

void check(const ImageSource& source) {
  std::size_t all = 0;
  for (const std::uint32_t size : source.sizes) all += size;
  if (source.corners.size() != all) refuse_size("corners", source.corners.size(), all);
  if (source.values.size() != source.points.size()) refuse_size("values", source.values.size(), source.points.size());
  const std::size_t f = source.sizes.size();
  if (!source.hidden.empty() && source.hidden.size() != f) refuse_size("hidden", source.hidden.size(), f);
  if (!source.marked.empty() && source.marked.size() != f) refuse_size("marked", source.marked.size(), f);
  for (const PointId p : source.corners) {
    if (p >= source.points.size()) {
      throw Error(ErrorCode::invalid_argument, "image: corners: point " + std::to_string(p) + " is out of range, there are " +
                                                   std::to_string(source.points.size()) + " points");
    }
  }
}

/// One face on the canvas.
class FacePainter {
 public:
  FacePainter(const ImageSource& source, Canvas& canvas) : source_(source), canvas_(canvas) {}

  void paint(std::size_t face, std::span<const PointId> corners) {
    Vec3 middle{};
    double value = 0;
    for (const PointId p : corners) {
      middle = middle + source_.points[p] / static_cast<double>(corners.size());
      value += source_.values[p] / static_cast<double>(corners.size());
    }
    const bool marked = !source_.marked.empty() && source_.marked[face];
    const Colour colour = marked ? error_colour : colour_at(value);
    for (std::size_t c = 0; c < corners.size(); ++c) {
      const Vec3 &a = source_.points[corners[c]], &b = source_.points[corners[c + 1 == corners.size() ? 0 : c + 1]];
      const Vec3& d = corners.size() == 3 ? source_.points[corners[2]] : middle;
      Colour lit = colour;
      const double light = canvas_.light(cross(b - a, d - a));
      for (double& part : lit) part *= light;
      canvas_.triangle(a, b, d, lit);
      if (corners.size() == 3) return;
    }
  }

 private:
  const ImageSource& source_;
  Canvas& canvas_;
};

}  // namespace

std::string png_bytes(const Image& image) {
  std::string out = "\x89PNG\r\n\x1a\n", header;
  append_number(header, static_cast<std::uint32_t>(image.width));
  append_number(header, static_cast<std::uint32_t>(image.height));
  header += {8, 6, 0, 0, 0};  // bits, red, green, blue and opacity, methods, not interlaced
  append_chunk(out, "IHDR", header);
  append_chunk(out, "IDAT", compressed(filtered(image)));
  append_chunk(out, "IEND", "");
  return out;
}

View view_of(std::span<const Vec3> points, double width_over_height) {
  if (points.empty()) throw Error(ErrorCode::invalid_argument, "view: there are no points");
  const Box box = bounding_box(points);
  constexpr double yaw = -0.9, pitch = 0.45, margin = 1.06;
  const double cy = std::cos(yaw), sy = std::sin(yaw), cp = std::cos(pitch), sp = std::sin(pitch);
  View view{{{{-sy, cy, 0}, {-cy * sp, -sy * sp, cp}, {cy * cp, sy * cp, sp}}}, {}, 1};
  if (box.min[2] == box.max[2]) view.axes = {{{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}};
  Vec3 low{}, high{};
  for (std::size_t k = 0; k < 3; ++k) {
    low[k] = std::numeric_limits<double>::infinity();
    high[k] = -low[k];
    for (const Vec3& p : points) {
      low[k] = std::min(low[k], dot(p, view.axes[k]));
      high[k] = std::max(high[k], dot(p, view.axes[k]));
    }
    view.centre = view.centre + 0.5 * (low[k] + high[k]) * view.axes[k];
  }
  const double across = std::max(high[0] - low[0], (high[1] - low[1]) * width_over_height);
  view.width = across > 0 ? margin * across : 1;
  return view;
}

Image draw(const ImageSource& source, const View& view, std::size_t width, std::size_t height) {
  check(source);
  Canvas canvas(view, width, height);
  FacePainter painter(source, canvas);
  std::size_t first = 0;
  for (std::size_t f = 0; f < source.sizes.size(); ++f) {
    const auto corners = source.corners.subspan(first, source.sizes[f]);
    first += corners.size();
    if (corners.size() >= 3 && (source.hidden.empty() || !source.hidden[f])) painter.paint(f, corners);
  }
  return canvas.image();
}

std::string scale_gradient() {
  std::string text = "linear-gradient(90deg";
  for (const Colour& colour : scale_colours) {
    text += ",rgb(";
    for (std::size_t c = 0; c < 3; ++c) {
      if (c > 0) text += ',';
      text.append(std::to_string(static_cast<int>(colour[c])));
    }
    text += ')';
  }
  return text + ')';
}

}  // namespace deform
