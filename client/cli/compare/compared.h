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

/// A measure of the quality of a mesh that the comparison shows.
struct ShownMeasure {
  std::string name, label;
  Better better = Better::neither;
  double at_rest = 0;
};

/// How smooth a deformed surface is.
struct Smoothness {
  double high_pass_energy = 0;  ///< CurvatureChange::high_pass_energy
  double border_kink = 0;       ///< degrees: JumpGrowth::normal over the borders of handles and fixed regions
};

/// One design by one method.
struct ComparedDesign {
  std::string error;                     ///< why there is no deformation; then nothing else is there
  v1::DesignResult result;               ///< what the server says of it
  std::optional<Misfit> misfit;          ///< nothing where the client does not know where points are sent
  std::optional<Smoothness> smoothness;  ///< nothing without faces in space
  std::vector<double> measures;          ///< one per shown measure
  Points points;                         ///< of designs that are drawn, else empty
  std::vector<double> curvature_change;  ///< n likewise, 1 / length
  std::vector<char> flipped;             ///< f likewise
};

/// What became of a setup with one method.
struct ComparedMethod {
  MethodChoice choice;
  std::vector<std::string> refusals;  ///< why the server does not take it; then nothing else is there
  v1::SystemInfo system;
  std::uint64_t peak_bytes = 0;         ///< estimated memory while preparing
  double seconds_per_design = 0;        ///< on the server, median
  std::vector<ComparedDesign> designs;  ///< as many as are compared

  bool works() const;  ///< neither refused nor without any deformation
};

/// One setup by several methods.
struct MethodComparison {
  std::string setup;                 ///< its file, or the id of a system
  std::shared_ptr<const Mesh> mesh;  ///< at rest
  std::vector<std::string> designs;  ///< their names
  std::vector<std::string> values;   ///< of their variables: "roof_up = 0.03"
  std::vector<char> hidden;          ///< f marks, or none: faces that pictures leave out
  std::vector<ShownMeasure> measures;
  std::vector<ComparedMethod> methods;
};

/// Of a volume mesh the faces of patches without a face that a handle holds, which would hide the others: f marks. None of a
/// surface, or where no patch would be left.
std::vector<char> faces_without_handles(const v1::Setup& setup, const Mesh& mesh);

/// Measures deformed designs against the mesh at rest. The meshes and the setup outlive it.
class DesignMeasurer {
 public:
  DesignMeasurer(const v1::Setup& setup, const io::MeshFile& rest);
  ~DesignMeasurer();

  const std::vector<ShownMeasure>& measures() const { return measures_; }
  /// Keeps what pictures need.
  enum class Keep { nothing, pictures };
  ComparedDesign measured(const v1::DesignResult& result, Points&& points, std::span<const double> values, Keep keep) const;

 private:
  struct Surface;
  const v1::Setup& setup_;
  const Mesh& mesh_;
  std::optional<PrescribedPlaces> places_;  // nothing where points slide or control points are moved
  std::unique_ptr<const Surface> surface_;  // null without faces in space
  std::vector<ShownMeasure> measures_;
};

}  // namespace deform::cli
