// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/base/text.h"

#include <gtest/gtest.h>

#include "core/base/base64.h"

namespace deform::text_test {
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

TEST(Printable, EscapesWhatActsOnTerminals) {
  EXPECT_EQ(printable("\x1b]0;owned\x07"), "\\x1b]0;owned\\x07");
  EXPECT_EQ(printable("a\r\n\tb\x7f"), "a\\x0d\\x0a\\x09b\\x7f");
  EXPECT_EQ(printable(std::string_view("\0", 1)), "\\x00");
  EXPECT_EQ(printable("\xc2\x9b"
                      "31m"),
            "\\u{9b}31m")
      << "a C1 control as UTF-8";
}

TEST(Printable, EscapesWhatReordersText) {
  EXPECT_EQ(printable("\u202e.obj"), "\\u{202e}.obj");
  for (const char* control : {"\u061c", "\u200e", "\u200f", "\u2028", "\u2029", "\u202a", "\u202e", "\u2066", "\u2069"}) {
    EXPECT_EQ(printable(control).substr(0, 3), "\\u{") << control;
  }
  for (const char* plain : {"\u061b", "\u200d", "\u2010", "\u2027", "\u202f", "\u2065", "\u206a", "\u00a0"}) {
    EXPECT_EQ(printable(plain), plain);
  }
}

TEST(Printable, KeepsTextAndWhatItIsToldTo) {
  EXPECT_EQ(printable("Gr\xc3\xb6\xc3\x9f"
                      "e \xe2\x88\x9e \xf0\x9f\x9a\x97 C:\\a"),
            "Gr\xc3\xb6\xc3\x9f"
            "e \xe2\x88\x9e \xf0\x9f\x9a\x97 C:\\a");
  EXPECT_EQ(printable("a\n\tb\r", "\n\t"), "a\n\tb\\x0d");
}

TEST(Printable, EscapesBytesThatAreNoText) {
  EXPECT_EQ(printable("\xff<\xc3"), "\\xff<\\xc3");
  EXPECT_EQ(printable("\xe2\x80"), "\\xe2\\x80") << "the front of a control";
  EXPECT_EQ(printable("\xc0\x9b"), "\\xc0\\x9b") << "overlong";
}

TEST(Escaped, EscapesBackslashesAndWhatIsNotPrintable) {
  EXPECT_EQ(escaped("C:\\a\n", 100), "C:\\x5ca\\x0a");
  EXPECT_EQ(escaped("\\x0a", 100), "\\x5cx0a") << "not to be taken for an escaped line break";
}

TEST(Escaped, CutsBetweenCharacters) {
  EXPECT_EQ(escaped("abcdef", 6), "abcdef");
  EXPECT_EQ(escaped("abcdefg", 6), "abc...");
  EXPECT_EQ(escaped("ab\\cd", 7), "ab...") << "an escape stays whole";
  EXPECT_EQ(escaped("ab\\cd", 8), "ab\\x5ccd");
  EXPECT_EQ(escaped("abc", 2), "..");
}

TEST(Case, ChangesAsciiLettersOnly) {
  EXPECT_EQ(lower_case("A-z[Z]@`{\xc3\x84"), "a-z[z]@`{\xc3\x84");
  EXPECT_EQ(upper_case("A-z[Z]@`{\xc3\xa4"), "A-Z[Z]@`{\xc3\xa4");
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
}  // namespace deform::text_test
