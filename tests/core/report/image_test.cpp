// SPDX-License-Identifier: GPL-3.0-or-later
// Pictures: what is drawn where, against distances computed pixel by pixel, and PNG read back by its definition.
#include "core/report/image.h"

#include <gtest/gtest.h>
#include <zlib.h>

#include <array>
#include <cmath>
#include <cstdio>
#include <limits>
#include <string>

#include "core/base/vectors.h"
#include "tests/core/quality/surface_meshes.h"
#include "tests/support/expect_error.h"

namespace deform::image_test {
namespace {

using Pixel = std::array<int, 4>;

Pixel at(const Image& image, std::size_t x, std::size_t y) {
  Pixel pixel{};
  for (std::size_t c = 0; c < 4; ++c) pixel[c] = image.pixels.at(4 * (x + image.width * y) + c);
  return pixel;
}

/// From above: one unit of the model is ten pixels, (0, 0) in the middle.
const View above{{{{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}}, {0, 0, 0}, 10};

struct Scene {
  Mesh mesh;
  std::vector<double> values;
  std::vector<char> hidden, marked;

  /// A square with sides along the axes.
  void add(const Vec3& middle, double half, double value) {
    const auto first = static_cast<PointId>(mesh.points.size());
    for (const auto& [x, y] : {std::pair{-half, -half}, {half, -half}, {half, half}, {-half, half}}) {
      mesh.points.push_back(middle + Vec3{x, y, 0});
      values.push_back(value);
    }
    test::add_face(mesh, {first, first + 1, first + 2, first + 3});
  }
  /// A square around the origin.
  void add_across(const Vec3& normal, double value) {
    const Vec3 along = cross(normal, {0, 1, 0}), up = cross(normal, along);
    const auto first = static_cast<PointId>(mesh.points.size());
    for (const auto& [x, y] : {std::pair{-1, -1}, {1, -1}, {1, 1}, {-1, 1}}) {
      mesh.points.push_back(x / norm(along) * along + y / norm(up) * up);
      values.push_back(value);
    }
    test::add_face(mesh, {first, first + 1, first + 2, first + 3});
  }
  Image drawn(const View& view = above) const {
    return draw({mesh.points, mesh.face_sizes, mesh.face_points, values, hidden, marked}, view, 100, 80);
  }
};

TEST(Image, HasFacesWhereTheyAre) {
  Scene scene;
  scene.add({1, -2, 0}, 1, 1);
  const Image image = scene.drawn();
  ASSERT_EQ(image.width, 100u);
  ASSERT_EQ(image.height, 80u);
  for (std::size_t y = 0; y < 80; ++y) {
    for (std::size_t x = 0; x < 100; ++x) {
      const double px = (static_cast<double>(x) + 0.5 - 50) / 10, py = (40 - static_cast<double>(y) - 0.5) / 10;
      const bool inside = std::abs(px - 1) < 1 && std::abs(py + 2) < 1;
      EXPECT_EQ(at(image, x, y)[3], inside ? 255 : 0) << x << ", " << y;
    }
  }
}

TEST(Image, ShowsWhatIsNearest) {
  Scene scene;
  scene.add({0, 0, 1}, 1, 0);   // in front, light
  scene.add({0, 0, -1}, 2, 1);  // behind, dark
  const auto brightness = [](const Pixel& p) { return p[0] + p[1] + p[2]; };
  const Image image = scene.drawn();
  EXPECT_GT(brightness(at(image, 50, 40)), brightness(at(image, 35, 40)) + 100);
  View below = above;
  below.axes[0][0] = -1;
  below.axes[2][2] = -1;
  EXPECT_EQ(at(scene.drawn(below), 50, 40), at(scene.drawn(below), 35, 40)) << "from the other side the large one is in front";
}

TEST(Image, LeavesOutAndMarksFaces) {
  Scene scene;
  scene.add({-2, 0, 0}, 1, 0.5);
  scene.add({2, 0, 0}, 1, 0.5);
  scene.hidden = {1, 0};
  scene.marked = {0, 1};
  const Image image = scene.drawn();
  EXPECT_EQ(at(image, 30, 40)[3], 0);
  const Pixel marked = at(image, 70, 40);
  EXPECT_GT(marked[0], 3 * marked[1]) << "red";
  scene.marked = {};
  EXPECT_LT(at(scene.drawn(), 70, 40)[0], at(scene.drawn(), 70, 40)[2]) << "blue";
}

TEST(Image, HasTheEndsOfTheScaleBeyondItAndGreyWithoutAValue) {
  const auto colour = [](double value) {
    Scene scene;
    scene.add({0, 0, 0}, 1, value);
    return at(scene.drawn(), 50, 40);
  };
  EXPECT_EQ(colour(-3), colour(0));
  EXPECT_EQ(colour(7), colour(1));
  EXPECT_NE(colour(0), colour(1));
  EXPECT_NE(colour(0.3), colour(0.4));
  const Pixel grey = colour(std::numeric_limits<double>::quiet_NaN());
  EXPECT_LT(std::abs(grey[0] - grey[2]), 20);
  EXPECT_NE(grey, colour(0));
}

TEST(Image, HasTheColourOfTheScaleWhereFacesLookAtTheLamp) {
  const std::string gradient = scale_gradient();
  Pixel full{0, 0, 0, 255};
  ASSERT_EQ(std::sscanf(gradient.c_str(), "linear-gradient(90deg,rgb(%d,%d,%d)", &full[0], &full[1], &full[2]), 3);
  const auto seen = [](const Vec3& normal) {
    Scene scene;
    scene.add_across(normal, 0);
    return at(scene.drawn(), 50, 40);
  };
  const Vec3 lamp{0.25, 0.35, 0.9};
  EXPECT_EQ(seen(lamp), full);
  EXPECT_EQ(seen(-1 * lamp), full) << "faces have no back";
  const Pixel dark = seen({-0.9, 0, 0.25}), between = seen({-0.65, 0.35, 1.15});  // at 90 and 45 degrees or so to the lamp
  for (std::size_t c = 0; c < 3; ++c) {
    EXPECT_NEAR(dark[c], 0.45 * full[c], 1);
    EXPECT_GT(between[c], dark[c] + 20);
    EXPECT_LT(between[c], full[c] - 20);
  }
}

TEST(Image, LeavesOutFacesThatAreNowhere) {
  Scene scene;
  scene.add({0, 0, 0}, 1, 0);
  scene.mesh.points[2][1] = std::numeric_limits<double>::infinity();
  for (const std::uint8_t part : scene.drawn().pixels) EXPECT_EQ(part, 0);
}

TEST(Image, RefusesSizesThatDoNotFit) {
  const auto refused = [](const std::vector<const char*>& parts, void (*spoil)(Scene&)) {
    Scene scene;
    scene.add({0, 0, 0}, 1, 0);
    spoil(scene);
    test::expect_error(ErrorCode::invalid_argument, parts, [&] { scene.drawn(); });
  };
  refused({"corners", "4", "5"}, [](Scene& s) { s.mesh.face_sizes[0] = 5; });
  refused({"values", "3", "4"}, [](Scene& s) { s.values.pop_back(); });
  refused({"hidden", "2", "1"}, [](Scene& s) { s.hidden = {0, 0}; });
  refused({"marked", "2", "1"}, [](Scene& s) { s.marked = {0, 0}; });
  refused({"corners", "point 9", "4 points"}, [](Scene& s) { s.mesh.face_points[1] = 9; });
}

TEST(View, SeesAllPointsAndNotMuchMore) {
  const Mesh mesh = test::sphere(3, 2);
  for (const double ratio : {0.5, 1.5, 4.0}) {
    const View view = view_of(mesh.points, ratio);
    double across = 0, up = 0;
    for (const Vec3& p : mesh.points) {
      across = std::max(across, std::abs(dot(p - view.centre, view.axes[0])) * 2);
      up = std::max(up, std::abs(dot(p - view.centre, view.axes[1])) * 2);
    }
    const double used = std::max(across / view.width, up * ratio / view.width);
    EXPECT_LE(used, 1);
    EXPECT_GT(used, 0.9);
    for (std::size_t i = 0; i < 3; ++i) {
      for (std::size_t j = 0; j < 3; ++j) EXPECT_NEAR(dot(view.axes[i], view.axes[j]), i == j, 1e-15);
    }
    EXPECT_GT(dot(cross(view.axes[0], view.axes[1]), view.axes[2]), 0.99) << "not a mirror image";
  }
  EXPECT_EQ(view_of(std::vector<Vec3>{{0, 0, 5}, {1, 2, 5}}, 1).axes[2], (Vec3{0, 0, 1})) << "2D meshes from above";
  test::expect_error(ErrorCode::invalid_argument, {"no points"}, [] { view_of({}, 1); });
}

std::uint32_t number_at(const std::string& bytes, std::size_t at) {
  std::uint32_t number = 0;
  for (std::size_t k = 0; k < 4; ++k) number = number << 8 | static_cast<std::uint8_t>(bytes.at(at + k));
  return number;
}

TEST(Png, HoldsThePixels) {
  Scene scene;
  scene.add({1, 1, 0}, 2, 0.3);
  const Image image = scene.drawn();
  const std::string png = png_bytes(image);
  ASSERT_EQ(png.substr(0, 8), "\x89PNG\r\n\x1a\n");
  std::string data;
  std::vector<std::string> types;
  for (std::size_t place = 8; place < png.size();) {
    const std::uint32_t size = number_at(png, place);
    const std::string body = png.substr(place + 4, 4 + size);
    EXPECT_EQ(number_at(png, place + 8 + size), crc32(0, reinterpret_cast<const Bytef*>(body.data()), 4 + size));
    types.push_back(body.substr(0, 4));
    if (types.back() == "IHDR") {
      EXPECT_EQ(number_at(body, 4), 100u);
      EXPECT_EQ(number_at(body, 8), 80u);
      EXPECT_EQ(body.substr(12), std::string("\x08\x06\0\0\0", 5));
    }
    if (types.back() == "IDAT") data += body.substr(4);
    place += 12 + size;
  }
  EXPECT_EQ(types, (std::vector<std::string>{"IHDR", "IDAT", "IEND"}));
  std::string rows(80 * 401, '\0');
  uLongf size = rows.size();
  ASSERT_EQ(uncompress(reinterpret_cast<Bytef*>(rows.data()), &size, reinterpret_cast<const Bytef*>(data.data()), data.size()),
            Z_OK);
  ASSERT_EQ(size, rows.size());
  for (std::size_t y = 0; y < 80; ++y) {
    ASSERT_EQ(rows[401 * y], 1) << "filter: the difference from the left";
    for (std::size_t i = 0; i < 400; ++i) {
      const int left = i < 4 ? 0 : image.pixels[400 * y + i - 4];
      EXPECT_EQ((left + static_cast<std::uint8_t>(rows[401 * y + 1 + i])) % 256, image.pixels[400 * y + i]);
    }
  }
}

}  // namespace
}  // namespace deform::image_test
