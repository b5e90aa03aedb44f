// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cstdint>
#include <filesystem>
#include <map>
#include <string>
#include <vector>

#include "client/client.h"

namespace deform::cli {

/// What holds points of the mesh already: handles and fixed regions of a setup.
struct HeldPoints {
  std::vector<std::uint32_t> labels;  ///< of every point, as region_labels(); empty: nothing is held
  std::vector<std::string> handles;   ///< names, of the labels from 2
};

/// A setup with what was found as constraints, in two files.
struct DetectedSetup {
  std::string text;                       ///< the setup, YAML
  std::string points;                     ///< the file of point ids that it names, JSON; empty when all lists are short
  std::size_t written = 0, left_out = 0;  ///< constraints
};

struct DetectedSetupOptions {
  std::string geometry;     ///< what the setup calls its mesh file
  std::string beginning;    ///< text of a setup without constraints that is continued; empty: a setup without handles
  std::string points_file;  ///< what the setup calls the file of ids
  HeldPoints held;
  /// Planes that are symmetry planes of the model, by name, with the reason to leave them out: "it lies in symmetry[0]".
  std::map<std::string, std::string> in_symmetry{};
  std::string
      symmetry{};      ///< groups whose points lie in such planes, of a setup that is not continued: an entry of YAML or empty
  std::string origin;  ///< a sentence on one line: where the sets come from; empty: from detection
  /// How near to their shapes the constraints put their points: as near as their weight does, or exactly.
  enum class Kept { by_weight, exactly } kept = Kept::by_weight;
};

/// A constraint for every set that was found, without those that cannot be constrained (too few points), that others imply, and
/// that handles and fixed regions hold as a whole, or that are symmetry planes of the model; these follow as comments with the
/// reason. Every constraint is one that `deform prepare` accepts.
DetectedSetup detected_setup(const client::Detected& detected, const DetectedSetupOptions& options);

/// The text of a setup file that detected_setup() can continue. Throws Error(invalid_argument): it has constraints already, is
/// not in block style, or its method takes no constraints.
std::string continued_text(const std::filesystem::path& setup);

/// The text as YAML: in quotes unless it is a plain word there.
std::string yaml_text(const std::string& text);

}  // namespace deform::cli
