// SPDX-License-Identifier: Apache-2.0
#include "core/report/page_head.h"

#include "core/base/text.h"
#include "core/report/page.h"

namespace deform::quality {

std::string page_head(const std::string& title, const std::string& allowed) {
  std::string out =
      "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n"
      "<meta http-equiv=\"Content-Security-Policy\" content=\"default-src 'none'; style-src 'unsafe-inline'; " +
      allowed +
      "; base-uri 'none'; form-action 'none'\">\n"
      "<meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n<title>" +
      markup_text(title) + "</title>\n<style>\n";
  out += page_style();
  return out + "</style>\n</head>\n<body>\n";
}

}  // namespace deform::quality
