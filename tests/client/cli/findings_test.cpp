// SPDX-License-Identifier: GPL-3.0-or-later
// What is printed about a design with constraints.
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>
#include <sstream>

#include "client/cli/output/cell_options.h"

namespace deform::findings_test {
namespace {

v1::DesignResult result() {
  v1::DesignResult result;
  auto& constraints = *result.mutable_constraints();
  auto& bore = *constraints.add_residuals();
  bore.set_name("bore");
  bore.set_largest(0.02);
  bore.set_rms(0.01);
  bore.set_free_largest(2);
  bore.set_free_rms(1);
  constraints.set_converged(true);
  constraints.set_iterations(12);
  constraints.set_convergence_error(2.5e-8);
  return result;
}

std::string printed(const v1::DesignResult& result) {
  std::ostringstream out;
  cli::print_findings(result, out);
  return out.str();
}

TEST(Findings, TellHowConstraintsWereSolved) {
  v1::DesignResult design = result();
  const std::string residuals = "  bore: largest 0.02, rms 0.01 (without constraints 2, 1)\n";
  EXPECT_EQ(printed(design), residuals + "  constraints converged in 12 iterations, 2.5e-08 rms from the solution\n");
  design.mutable_constraints()->set_newton_steps(3);
  EXPECT_EQ(printed(design),
            residuals + "  constraints converged in 12 iterations, 3 of them Newton steps, 2.5e-08 rms from the solution\n");
  design.mutable_constraints()->set_converged(false);
  design.mutable_constraints()->set_newton_steps(0);
  design.mutable_constraints()->set_convergence_error(0);  // an older server, or never estimated
  EXPECT_EQ(printed(design), residuals + "  constraints DID NOT CONVERGE in 12 iterations\n");
  design.mutable_constraints()->mutable_residuals(0)->set_missed(true);
  EXPECT_NE(printed(design).find("(without constraints 2, 1), NOT EXACT: it contradicts others"), std::string::npos);
}

TEST(Findings, TellTheHeightsOfLayers) {
  v1::DesignResult design = result();
  auto& bore = *design.mutable_constraints()->mutable_residuals(0);
  bore.set_least_height(0.98);
  bore.set_largest_height(1.5);
  bore.set_free_least_height(0.5);
  bore.set_free_largest_height(2);
  EXPECT_NE(printed(design).find("(without constraints 2, 1)\n    heights of its layers: 0.98 to 1.5 of those at rest (without "
                                 "constraints 0.5 to 2)\n"),
            std::string::npos)
      << printed(design);
}

TEST(Findings, NameTheCellThatIsNearlyFlat) {
  v1::DesignResult design;
  v1::CellReport& cells = *design.mutable_cells();
  cells.set_cells(8);
  cells.set_safe_amplitude(1);
  cells.set_least_determinant(0.02);
  cells.set_least_determinant_cell(5);
  EXPECT_EQ(printed(design), "  8 cells, none is inverted; the least determinant is 0.02, of cell 5\n");
  cells.set_least_determinant(0.06);
  EXPECT_EQ(printed(design), "  8 cells, none is inverted\n");
  cells.set_least_determinant(0);  // an older server
  EXPECT_EQ(printed(design), "  8 cells, none is inverted\n");
}

TEST(Findings, AreAllInTheJson) {
  v1::DesignResult design = result();
  design.mutable_constraints()->set_newton_steps(3);
  nlohmann::ordered_json json;
  cli::add_findings(design, json);
  EXPECT_EQ(json["constraints"]["iterations"], 12);
  EXPECT_EQ(json["constraints"]["newton_steps"], 3);
  EXPECT_EQ(json["constraints"]["convergence_error"], 2.5e-8);
}

}  // namespace
}  // namespace deform::findings_test
