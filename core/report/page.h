// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "core/quality/report.h"
#include "core/report/picture.h"

namespace deform {

/// What a page shows. Texts may contain anything: they are escaped.
struct QualityPage {
  struct Gate {
    std::string condition;  ///< "inverted_cells>0"
    double value = 0;
    bool failed = false;
  };
  std::string file, before_file;  ///< before_file: empty without `before`
  const QualityReport& after;
  const QualityReport* before = nullptr;
  std::vector<Gate> gates{};
  std::vector<std::string> notes{};
  const Picture* picture = nullptr;
  std::string program{};  ///< "deform 1.2.3"
};

/// A page of HTML that needs nothing else: styles, script and data are in it, and its content security policy forbids any
/// request. The picture turns with WebGL 2, or without it on a plain canvas. Deterministic.
std::string html_page(const QualityPage& page);

namespace quality {

/// The parts of the page that do not change (report.css, report.js).
std::string_view page_style();
std::string_view page_script();

}  // namespace quality

}  // namespace deform
