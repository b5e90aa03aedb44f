// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <filesystem>
#include <vector>

#include "client/cli/output/measured_mesh.h"
#include "core/report/page.h"

namespace deform::cli {

/// A page for people: tables, distributions, the surface in colours.
void write_quality_page(const Comparison& comparison, const std::vector<QualityPage::Gate>& gates,
                        const std::filesystem::path& path);

/// Arrays for ParaView: .vtp of a surface, .vtu of a volume mesh.
void write_quality_arrays(const Comparison& comparison, const std::filesystem::path& path);

}  // namespace deform::cli
