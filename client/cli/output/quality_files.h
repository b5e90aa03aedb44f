// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "client/cli/output/measured_mesh.h"
#include "core/report/page.h"

namespace deform::cli {

/// What a page shows besides the meshes.
struct PageExtras {
  std::vector<QualityPage::Gate> gates;
  std::vector<QualityPage::Constraint> constraints;
};

/// The residuals in what `deform apply --json` printed. Throws Error(not_found), Error(invalid_argument) when it is something
/// else or its design had no constraints.
std::vector<QualityPage::Constraint> constraints_of(const std::string& path);

/// A page for people: tables, distributions, the surface in colours.
void write_quality_page(const Comparison& comparison, const PageExtras& extras, const std::filesystem::path& path);

/// Arrays for ParaView: .vtp of a surface, .vtu of a volume mesh.
void write_quality_arrays(const Comparison& comparison, const std::filesystem::path& path);

}  // namespace deform::cli
