// SPDX-License-Identifier: GPL-3.0-or-later
// Pages: everything is in them, nothing that came from a file is markup, large surfaces are thinned.
#include "core/report/page.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <regex>
#include <set>

#include "tests/core/quality/surface_meshes.h"
#include "tests/support/expect_error.h"

namespace deform::page_test {
namespace {

using test::Faces;
using test::sheet;
using test::sphere;

/// Not a matcher: that would print the page.
bool has(std::string_view text, std::string_view part) { return text.find(part) != std::string_view::npos; }

QualityReport report_of(const Mesh& mesh) { return quality_report(surface_quality(mesh), mesh); }

class Page : public testing::Test {
 protected:
  Page() {
    for (Vec3& p : after_.points) p[2] += 0.1 * p[0];
    after_.groups = {{"<b>top</b>", {}, {0, 1, 2}}, {"rest", {}, {3, 4, 5, 6}}};
    after_report_ = report_of(after_);
  }

  std::string page() {
    PictureSource source{after_, before_.points, {}};
    source.fields = {{"quality <i>", PictureField::Of::faces, std::vector<double>(after_.face_count(), 0.5), Better::higher}};
    picture_ = make_picture(source);
    QualityPage page{"dir/<img src=x onerror=alert(1)>.obj", "be<fore", after_report_};
    page.before = &before_report_;
    page.gates = {{"a<b", 1, true}, {"c>d", 2, false}};
    page.notes = {"a note & more"};
    page.picture = &picture_;
    page.program = "deform 1";
    return html_page(page);
  }

  Mesh before_ = sphere(1, 2), after_ = before_;
  QualityReport before_report_ = report_of(before_), after_report_;
  Picture picture_;
};

TEST_F(Page, ShowsResidualsOfConstraints) {
  EXPECT_FALSE(has(page(), "Constraints"));
  QualityPage with{"after.obj", "", after_report_};
  with.constraints = {{"<bore>", 0.25, 0.125, 2, 1.5, true}, {"flange", 3e-12, 1e-12, 0.5, 0.25, false}};
  const std::string text = html_page(with);
  EXPECT_TRUE(has(
      text, "<tr><td>&lt;bore&gt;</td><td>0.25</td><td>0.125</td><td>2</td><td>1.5</td><td class=\"bad\">not exact</td></tr>"));
  EXPECT_TRUE(has(text, "<tr><td>flange</td><td>3e-12</td><td>1e-12</td><td>0.5</td><td>0.25</td><td></td></tr>"));
}

TEST_F(Page, NamesTheChecksThatFailed) {
  EXPECT_FALSE(has(page(), "Failed checks"));
  after_report_.failed = {"face pyramids: 19", "open cells: 1"};
  before_report_.failed = {"face pyramids: 17", "open cells: 1"};
  const std::string text = page();
  EXPECT_TRUE(has(text, "<h2>Failed checks</h2>\n<ul>\n<li"));
  EXPECT_TRUE(has(text, "<li class=\"bad\">face pyramids: 19</li>"));
  EXPECT_TRUE(has(text, "<li class=\"soft\">open cells: 1 (as before)</li>"));
  EXPECT_TRUE(has(html_page({"after.obj", "", after_report_}), "<li class=\"bad\">open cells: 1</li>"));
}

TEST_F(Page, EscapesWhatComesFromFiles) {
  const std::string text = page();
  for (const char* raw : {"<img", "<b>", "<i>", "be<fore", "a<b", "note & more"}) EXPECT_FALSE(has(text, raw));
  for (const char* escaped : {"&lt;img src=x onerror=alert(1)&gt;.obj", "be&lt;fore", "&lt;b&gt;top&lt;/b&gt;",
                              "data-field=\"quality &lt;i&gt;\"", "a&lt;b", "a note &amp; more"}) {
    EXPECT_TRUE(has(text, escaped));
  }
}

TEST_F(Page, CountsWhatIsThere) {
  EXPECT_TRUE(has(page(), "<p>128 faces, 66 points</p>"));
  after_report_.counts = {{"faces", 7}, {"prisms", 0}, {"wall_faces", 3}};
  EXPECT_TRUE(has(page(), "<p>7 faces, 3 wall faces</p>"));
}

TEST_F(Page, NeedsNothingElse) {
  const std::string text = page();
  EXPECT_TRUE(has(text, "default-src 'none'"));
  for (const char* outside : {"http:", "https:", "src=\"", "<link", "@import", "url(", "fetch(", "XMLHttpRequest"}) {
    EXPECT_FALSE(has(text, outside)) << outside;
  }
  EXPECT_TRUE(has(text, std::string(quality::page_script())));
  EXPECT_TRUE(has(text, std::string(quality::page_style())));
  EXPECT_TRUE(has(quality::page_script(), "webgl2"));
}

TEST_F(Page, ElementsOfTheScriptAreThere) {
  const std::string text = page(), script(quality::page_script());
  const std::regex ids(R"(getElementById\('([a-z0-9-]+)'\))");
  std::size_t found = 0;
  for (auto it = std::sregex_iterator(script.begin(), script.end(), ids); it != std::sregex_iterator(); ++it, ++found) {
    EXPECT_TRUE(has(text, "id=\"" + (*it)[1].str() + "\""));
  }
  EXPECT_GT(found, 8u);
  for (const char* data : {"data-points", "data-before", "data-corners", "data-edges", "data-part", "data-field-0"}) {
    EXPECT_TRUE(has(text, "<script type=\"text/plain\" id=\"" + std::string(data) + "\""));
  }
}

TEST_F(Page, ShowsBeforeAndAfter) {
  const std::string text = page();
  EXPECT_TRUE(has(text, "<th>before</th><th>after</th><th>change</th>"));
  EXPECT_TRUE(has(text, "class=\"bad\">failed"));
  EXPECT_TRUE(has(text, "class=\"good\">passed"));
  EXPECT_TRUE(has(text, "<path class=\"before\""));
  EXPECT_TRUE(has(text, "Faces of least quality"));
  EXPECT_EQ(page(), text) << "the same page for the same mesh";
  QualityPage alone{"x.obj", "", after_report_};
  const std::string without = html_page(alone);
  EXPECT_FALSE(has(without, "<th>before</th>"));
  EXPECT_FALSE(has(without, "id=\"canvas\" tabindex"));
}

/// All parts of a text that match, as their groups.
std::vector<std::vector<std::string>> matches(const std::string& text, const std::regex& expression) {
  std::vector<std::vector<std::string>> found;
  for (auto it = std::sregex_iterator(text.begin(), text.end(), expression); it != std::sregex_iterator(); ++it) {
    found.emplace_back();
    for (std::size_t i = 1; i < it->size(); ++i) found.back().push_back((*it)[i].str());
  }
  return found;
}

TEST(Histogram, HasBarsOverAnAxisWithNumbers) {
  QualityReport report;
  report.histograms = {{"some", "Some <measure>", -1, 3, {1, 0, 4, 3}}};
  const std::string text = html_page({"a.obj", "", report});
  EXPECT_TRUE(has(text, "<figcaption>Some &lt;measure&gt;</figcaption>"));
  using Texts = std::vector<std::vector<std::string>>;
  EXPECT_EQ(
      matches(text, std::regex(R"re(<text x="([0-9.]+)" y="182" text-anchor="([a-z]+)">([^<]*)</text>)re")),
      (Texts{{"4", "start", "-1"}, {"112", "middle", "0"}, {"220", "middle", "1"}, {"328", "middle", "2"}, {"436", "end", "3"}}));
  // The highest bar is 146 high and has half of all; bins without anything have none.
  const Texts bars = matches(
      text,
      std::regex(R"re(<rect class="after" x="([0-9.]+)" y="([0-9.]+)" width="107" height="([0-9.]+)"><title>([^<]*)</title>)re"));
  EXPECT_EQ(bars, (Texts{{"4.5", "129.5", "36.5", "-1 to 0: 1"},
                         {"220.5", "20", "146", "1 to 2: 4"},
                         {"328.5", "56.5", "109.5", "2 to 3: 3"}}));
  EXPECT_TRUE(has(text, ">50 %</text>"));
  EXPECT_FALSE(has(text, "<path class=\"before\""));
}

TEST(Histogram, HasTheOutlineOfTheOneBefore) {
  QualityReport after, before;
  after.histograms = {{"some", "Some", 0, 2, {1, 1}}};
  before.histograms = {{"some", "Some", 0, 2, {0, 10}}};
  QualityPage page{"a.obj", "b.obj", after};
  page.before = &before;
  // Shares of all: the ten in one bin are twice as high as one of two.
  const std::string text = html_page(page);
  EXPECT_TRUE(has(text, "<path class=\"before\" d=\"M4 166V166h216V20h216V166\"/>"));
  EXPECT_TRUE(has(text, ">100 %</text>"));
  EXPECT_TRUE(has(text, "y=\"93\" width=\"215\" height=\"73\""));
  // Bins that do not compare are left out.
  before.histograms[0].counts.push_back(1);
  EXPECT_FALSE(has(html_page(page), "<path class=\"before\""));
}

TEST(Histogram, ShowsLittleBesideMuch) {
  QualityReport report;
  report.histograms = {{"some", "Some", 0, 2, {1, 1000000}}, {"none", "None", 0, 1, {0, 0, 0}}};
  const std::string text = html_page({"a.obj", "", report});
  EXPECT_TRUE(has(text, "y=\"165\" width=\"215\" height=\"1\"><title>0 to 1: 1</title>"));
  EXPECT_EQ(matches(text, std::regex("(<rect class=\"after\")")).size(), 2u) << "nothing of a histogram without counts";
  EXPECT_TRUE(has(text, ">0 %</text>"));
}

TEST(Picture, Polygons) {
  Mesh mesh = sheet(2, 1, Faces::quads, [](std::uint32_t i, std::uint32_t j) { return Vec3{2.0 * i, double(j), 0}; });
  test::add_face(mesh, {0, 1, 4});
  test::add_face(mesh, {0, 1});
  PictureSource source{mesh, {}, {}};
  source.fields = {{"f", PictureField::Of::faces, {1, 2, 3, 4}}, {"p", PictureField::Of::points, {0, 1, 2, 3, 4, 5}}};
  const Picture picture = make_picture(source);
  EXPECT_EQ(picture.triangles(), 9u) << "two fans of four and a triangle";
  EXPECT_EQ(picture.all_triangles, 9u);
  EXPECT_EQ(picture.grid, 0u);
  EXPECT_EQ(picture.points.size(), 3 * 8u);
  EXPECT_EQ(picture.edges, (std::vector<std::uint8_t>{4, 4, 4, 4, 4, 4, 4, 4, 7}));
  EXPECT_EQ(picture.fields[0].values, (std::vector<float>{1, 1, 1, 1, 2, 2, 2, 2, 3}));
  ASSERT_EQ(picture.fields[1].values.size(), 8u);
  EXPECT_EQ(picture.fields[1].values[2], 2.0f) << "the middle of 0, 1, 4, 3";
  EXPECT_EQ(picture.centre, (Vec3{2, 0.5, 0}));
}

TEST(Picture, Parts) {
  Mesh mesh = sphere(1, 1);
  mesh.groups = {{"no faces", {0}, {}}, {"a", {}, {0, 1, 2, 3}}, {"b", {}, {2, 3, 4}}, {"within a", {}, {1}}};
  const std::vector<FaceId> shown{4};
  PictureSource source{mesh, {}, {}};
  Picture picture = make_picture(source);
  ASSERT_EQ(picture.parts.size(), 3u);
  EXPECT_EQ(picture.parts[0].name, "a");
  EXPECT_EQ(picture.parts[1].name, "b");
  EXPECT_EQ(picture.parts[2].name, "");
  EXPECT_TRUE(picture.parts[0].shown && picture.parts[1].shown && picture.parts[2].shown);
  EXPECT_EQ(std::vector<std::uint16_t>(picture.part.begin(), picture.part.begin() + 6),
            (std::vector<std::uint16_t>{0, 0, 0, 0, 1, 2}));
  source.shown = shown;
  picture = make_picture(source);
  EXPECT_TRUE(!picture.parts[0].shown && picture.parts[1].shown && !picture.parts[2].shown);
}

TEST(Picture, LargeSurfacesAreThinned) {
  const Mesh mesh = sphere(3, 6);  // 32768 triangles
  PictureSource source{mesh, {}, {}};
  source.fields = {{"x", PictureField::Of::points, {}}};
  for (const Vec3& p : mesh.points) source.fields[0].values.push_back(p[0]);
  source.most_triangles = 5000;
  const Picture picture = make_picture(source);
  EXPECT_LE(picture.triangles(), 5000u);
  EXPECT_GT(picture.triangles(), 500u);
  EXPECT_EQ(picture.all_triangles, 32768u);
  EXPECT_GT(picture.grid, 0u);
  double area = 0;
  std::set<std::set<std::uint32_t>> seen;
  for (std::size_t t = 0; t < picture.triangles(); ++t) {
    Vec3 p[3];
    for (int k = 0; k < 3; ++k) {
      const std::uint32_t c = picture.corners[3 * t + k];
      for (int i = 0; i < 3; ++i) p[k][i] = picture.centre[i] + picture.scale * static_cast<double>(picture.points[3 * c + i]);
      EXPECT_NEAR(static_cast<double>(picture.fields[0].values[c]), p[k][0], 1e-5) << "values stay with their points";
    }
    const std::uint32_t* c = &picture.corners[3 * t];
    EXPECT_TRUE(seen.insert({c[0], c[1], c[2]}).second) << "no triangle twice";
    const Vec3 u{p[1][0] - p[0][0], p[1][1] - p[0][1], p[1][2] - p[0][2]},
        v{p[2][0] - p[0][0], p[2][1] - p[0][1], p[2][2] - p[0][2]};
    area += 0.5 * std::hypot(u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]);
  }
  EXPECT_NEAR(area, 4 * std::numbers::pi * 9, 0.1 * 4 * std::numbers::pi * 9) << "no holes";
}

TEST(Picture, RangesLeaveSpikesOut) {
  const Mesh mesh = sphere(1, 4);
  PictureField field{"c", PictureField::Of::points, std::vector<double>(mesh.point_count(), 1)};
  field.values[3] = 0.5;
  field.values[5] = 1e6;
  field.values[7] = std::numeric_limits<double>::quiet_NaN();
  PictureSource source{mesh, {}, {field}};
  const Picture picture = make_picture(source);
  EXPECT_EQ(picture.fields[0].low, 0.5);
  EXPECT_EQ(picture.fields[0].high, 1);
  EXPECT_TRUE(picture.fields[0].clipped);
  source.fields[0].values.pop_back();
  test::expect_error(ErrorCode::invalid_argument, {"c has"}, [&] { make_picture(source); });
}

}  // namespace
}  // namespace deform::page_test
