// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "client/cli/compare/method_choice.h"
#include "client/cli/setup/prescribed_places.h"
#include "core/io/mesh_file.h"
#include "core/quality/curvature_change.h"
#include "core/quality/region_jumps.h"
#include "core/quality/report.h"
#include "deform/v1/deformation.pb.h"

namespace deform::cli {

/// Measure of mesh quality shown in the comparison.
struct ShownMeasure {
  std::string name, label;
  Better better = Better::neither;
  double at_rest = 0;
};

/// Smoothness of a deformed surface.
struct Smoothness {
  double high_pass_energy = 0;  ///< CurvatureChange::high_pass_energy
  double border_kink = 0;       ///< degrees: JumpGrowth::normal at the borders of handles and fixed regions
};

/// Result of one method for one design.
struct ComparedDesign {
  std::string error;                     ///< reason why there is no deformation; the rest is then empty
  v1::DesignResult result;               ///< report of the server
  std::optional<Misfit> misfit;          ///< empty where the client does not know the prescribed positions
  std::optional<Smoothness> smoothness;  ///< empty without faces in space
  std::vector<double> measures;          ///< one per measure shown
  Points points;                         ///< for designs that are drawn, else empty
  std::vector<double> curvature_change;  ///< n likewise, 1 / length
  std::vector<char> flipped;             ///< f likewise
};

/// Result of one method for all designs.
struct ComparedMethod {
  MethodChoice choice;
  std::vector<std::string> refusals;  ///< reasons why the server rejects it; the rest is then empty
  v1::SystemInfo system;
  std::uint64_t peak_bytes = 0;         ///< estimated memory during preparation
  double seconds_per_design = 0;        ///< on the server, median
  std::vector<ComparedDesign> designs;  ///< one per design compared

  bool works() const;  ///< not rejected, and with at least one deformation
};

/// Comparison of several methods on one setup.
struct MethodComparison {
  std::string setup;                 ///< its file name, or the id of a system
  std::shared_ptr<const Mesh> mesh;  ///< at rest
  std::vector<std::string> designs;  ///< their names
  std::vector<std::string> values;   ///< of their variables: "roof_up = 0.03"
  std::vector<char> hidden;          ///< f marks, or none: faces that pictures leave out
  std::vector<ShownMeasure> measures;
  std::vector<ComparedMethod> methods;
};

/// Marks (f) the faces of a volume mesh whose patches have no face that a handle holds, which would hide the others. None of a
/// surface, or where no patch would be left.
std::vector<char> faces_without_handles(const v1::Setup& setup, const Mesh& mesh);

/// Compares deformed designs with the mesh at rest. The meshes and the setup must outlive it.
class DesignMeasurer {
 public:
  DesignMeasurer(const v1::Setup& setup, const io::MeshFile& rest);
  ~DesignMeasurer();

  const std::vector<ShownMeasure>& measures() const { return measures_; }
  /// Keeps the data needed for pictures.
  enum class Keep { nothing, pictures };
  ComparedDesign measured(const v1::DesignResult& result, Points&& points, std::span<const double> values, Keep keep) const;

 private:
  struct Surface;
  const v1::Setup& setup_;
  const Mesh& mesh_;
  std::optional<PrescribedPlaces> places_;  // empty where points slide or handles move control points
  std::unique_ptr<const Surface> surface_;  // null without faces in space
  std::vector<ShownMeasure> measures_;
};

}  // namespace deform::cli
