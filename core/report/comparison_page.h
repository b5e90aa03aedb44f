// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

namespace deform {

/// One setup deformed by several methods. Texts may contain anything: they are escaped.
struct ComparisonPage {
  enum class Mark { none, good, bad };
  struct Cell {
    std::string text;
    Mark mark = Mark::none;
  };
  /// What is said of one method.
  struct Row {
    std::string method;
    std::vector<Cell> cells;              ///< one per column
    std::vector<std::string> refusals{};  ///< why there is nothing in the cells, which are none then
  };
  struct Table {
    std::vector<std::string> columns;
    std::vector<Row> rows;
  };
  struct Shot {
    std::string caption, note;
    Mark mark = Mark::none;  ///< of the note
    std::string png;         ///< the bytes of a file
  };
  /// Pictures side by side, with one scale of colours.
  struct Gallery {
    std::string title, low, high;  ///< what the ends of the scale mean
    std::vector<Shot> shots;
  };
  struct Design {
    std::string name, values;
    std::vector<Gallery> galleries;
    Table table;
    std::vector<std::string> remarks{};  ///< a sentence each
  };
  std::string setup;               ///< its file
  std::vector<std::string> about;  ///< a line each
  Table methods;
  std::vector<Design> designs;
  std::vector<std::string> notes;  ///< how things were measured
  std::string program;             ///< "deform 1.2.3"
};

/// A page of HTML that needs nothing else: styles and pictures are in it, there is no script, and its content security policy
/// forbids any request. Deterministic.
std::string html_page(const ComparisonPage& page);

}  // namespace deform
