#include "core/base/text.h"

#include <gtest/gtest.h>

#include "core/base/base64.h"

namespace deform {
namespace {

TEST(MarkupText, NothingIsMarkup) {
  EXPECT_EQ(markup_text("<script>alert(\"1\" & '2')</script>"),
            "&lt;script&gt;alert(&quot;1&quot; &amp; &#39;2&#39;)&lt;/script&gt;");
  EXPECT_EQ(markup_text("Gr\xc3\xb6\xc3\x9f"
                        "e \xe2\x88\x9e"),
            "Gr\xc3\xb6\xc3\x9f"
            "e \xe2\x88\x9e");
  EXPECT_EQ(markup_text("a\x01\n\tb\x7f"), "a   b ");
  EXPECT_EQ(markup_text(std::string("a\0b", 3)), "a b");
  EXPECT_EQ(markup_text("\xff<\xc3"), "\xef\xbf\xbd&lt;\xef\xbf\xbd");
  EXPECT_EQ(markup_text("\xc0\xbc\xed\xa0\x80"), "\xef\xbf\xbd\xef\xbf\xbd\xef\xbf\xbd\xef\xbf\xbd\xef\xbf\xbd")
      << "overlong, surrogate";
}

TEST(Base64, OfEveryLength) {
  EXPECT_EQ(base64_encoded(""), "");
  EXPECT_EQ(base64_encoded("f"), "Zg==");
  EXPECT_EQ(base64_encoded("fo"), "Zm8=");
  EXPECT_EQ(base64_encoded("foo"), "Zm9v");
  EXPECT_EQ(base64_encoded("\xff\xfe\xfd\x00"), "//79");
}

TEST(Base64, DecodesWhatItEncodesAndNothingElse) {
  for (const std::string& bytes : {std::string(), std::string("f"), std::string("fo"), std::string("foo\0", 4)}) {
    EXPECT_EQ(base64_decoded(base64_encoded(bytes)), bytes);
    EXPECT_EQ(base64_encoded(bytes).size(), base64_size(bytes.size()));
  }
  for (const char* bad : {"Zg", "Zg=", "Z===", "Z*==", "====", "Zg==Zg=="}) EXPECT_FALSE(base64_decoded(bad)) << bad;
}

}  // namespace
}  // namespace deform
