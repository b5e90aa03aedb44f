// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "core/quality/report.h"
#include "core/report/picture.h"

namespace deform {

/// The content of a page. Texts are escaped.
struct QualityPage {
  struct Gate {
    std::string condition;  ///< "inverted_cells>0"
    double value = 0;
    bool failed = false;
  };
  /// Distances of the points of a constraint from its shape, in model units.
  struct Constraint {
    std::string name;
    double largest = 0, rms = 0;            ///< in the delivered deformation
    double free_largest = 0, free_rms = 0;  ///< without any constraint
    bool missed = false;                    ///< whether an exact constraint is violated
  };
  std::string file, before_file;  ///< before_file: empty without `before`
  const QualityReport& after;
  const QualityReport* before = nullptr;
  std::vector<Gate> gates{};
  std::vector<std::string> notes{};
  std::vector<Constraint> constraints{};
  const Picture* picture = nullptr;
  std::string program{};  ///< "deform 1.2.3"
};

/// A self-contained HTML page with styles, script and data; its content security policy forbids any request. The picture can be
/// rotated with WebGL 2 or, without it, on a plain canvas. Deterministic.
std::string html_page(const QualityPage& page);

namespace quality {

/// The constant parts of the page (report.css, report.js).
std::string_view page_style();
std::string_view page_script();

}  // namespace quality

}  // namespace deform
