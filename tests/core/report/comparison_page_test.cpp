// SPDX-License-Identifier: GPL-3.0-or-later
// The page of a comparison: refusals are rows, texts are no markup, nothing refers elsewhere.
#include "core/report/comparison_page.h"

#include <gtest/gtest.h>

#include <string_view>

namespace deform::comparison_page_test {
namespace {

using Mark = ComparisonPage::Mark;

bool has(std::string_view text, std::string_view part) { return text.find(part) != std::string_view::npos; }

ComparisonPage example() {
  ComparisonPage page;
  page.setup = "<img src=x>.yaml";
  page.about = {"5 <points>"};
  page.methods = {{"time", "<b>memory"},
                  {{"rbf & co", {{"2 s"}, {"1 <GiB", Mark::good}}}, {"shell", {}, {"no <faces>", "and more"}}}};
  page.designs = {{"wide <",
                   "a = 1 & b = 2",
                   {{"Displacement", "0", "<1", {{"rbf \"x\"", "bad <", Mark::bad, "PNG"}}}},
                   {{"verdict"}, {{"rbf", {{"good", Mark::bad}}}}},
                   {"rbf: <reason>"}}};
  page.notes = {"measured <so>"};
  page.program = "deform 1";
  return page;
}

TEST(ComparisonPage, HasARowPerMethodRefusedOrNot) {
  const std::string text = html_page(example());
  EXPECT_TRUE(has(text, "<tr><td>rbf &amp; co</td><td>2 s</td><td class=\"good\">1 &lt;GiB</td></tr>"));
  EXPECT_TRUE(has(text,
                  "<tr><td>shell</td><td class=\"refused\" colspan=\"2\"><b class=\"bad\">refused</b><br>no &lt;faces&gt;<br>and "
                  "more</td></tr>"));
  EXPECT_TRUE(has(text, "<tr><td>rbf</td><td class=\"bad\">good</td></tr>"));
  EXPECT_TRUE(has(text, "<th>method</th><th>time</th><th>&lt;b&gt;memory</th>"));
}

TEST(ComparisonPage, HasPicturesInIt) {
  const std::string text = html_page(example());
  EXPECT_TRUE(has(text, "<img alt=\"Displacement, rbf &quot;x&quot;\" src=\"data:image/png;base64,UE5H\">"));
  EXPECT_TRUE(has(text, "<span class=\"bad\">bad &lt;</span>"));
  EXPECT_TRUE(has(text, "0<i style=\"background:linear-gradient("));
  EXPECT_TRUE(has(text, "</i>&lt;1</p>"));
}

TEST(ComparisonPage, EscapesTextsAndNeedsNothingElse) {
  const std::string text = html_page(example());
  for (const char* raw : {"<img src=x", "<points>", "<b>memory", "<faces>", "wide <", "& b = 2", "<reason>", "<so>"}) {
    EXPECT_FALSE(has(text, raw)) << raw;
  }
  EXPECT_TRUE(has(text, "default-src 'none'; style-src 'unsafe-inline'; img-src data:;"));
  for (const char* outside : {"http:", "https:", "<link", "@import", "url(", "<script"})
    EXPECT_FALSE(has(text, outside)) << outside;
}

}  // namespace
}  // namespace deform::comparison_page_test
