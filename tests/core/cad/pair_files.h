// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <gtest/gtest.h>

#include <BRepTools.hxx>
#include <algorithm>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "core/cad/document.h"
#include "core/cad/model.h"
#include "tests/core/cad/pair_models.h"

namespace deform::cad {

/// Files of a test, which go with it.
class PairFiles : public testing::Test {
 protected:
  std::filesystem::path path(const std::string& name) {
    const auto* test = testing::UnitTest::GetInstance()->current_test_info();
    std::string stem = test->name();
    std::replace(stem.begin(), stem.end(), '/', '_');
    files_.push_back(std::filesystem::temp_directory_path() / ("deform_pairs_" + stem + "_" + name));
    return files_.back();
  }
  std::filesystem::path file(const TopoDS_Shape& shape, const std::string& name) {
    const auto written = path(name + ".brep");
    BRepTools::Write(shape, written.c_str());
    return written;
  }
  /// STEP with names and colours.
  std::filesystem::path step(const std::vector<Part>& parts, const std::string& name, const std::string& unit = "metre") {
    Model model;
    keep_unit(unit, model);
    Document document;
    document.parts = parts;
    const auto written = path(name + ".step");
    write_document(document, written);
    return written;
  }
  std::filesystem::path step(const TopoDS_Shape& shape, const std::string& name, const std::vector<FaceMark>& marks,
                             const std::string& unit = "metre") {
    return step({Part{shape, "part", std::nullopt, marks, {}}}, name, unit);
  }
  static int face_at(const TopoDS_Shape& shape, const Vec3& point) {
    const std::vector<TopoDS_Face> faces = faces_of(shape);
    for (std::size_t f = 0; f < faces.size(); ++f) {
      if (distance_from(point, faces[f]) < 1e-9) return static_cast<int>(f);
    }
    return -1;
  }
  void TearDown() override {
    for (const auto& path : files_) std::filesystem::remove(path);
  }

 private:
  std::vector<std::filesystem::path> files_;
};

}  // namespace deform::cad
