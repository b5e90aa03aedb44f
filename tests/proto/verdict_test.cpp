// SPDX-License-Identifier: GPL-3.0-or-later
// What makes a design bad or doubtful, and that the reasons come with it, the worst first.
#include "proto/convert/verdict.h"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <limits>
#include <string>
#include <utility>
#include <vector>

namespace deform::convert::verdict_test {
namespace {

v1::DesignResult good_result() {
  v1::DesignResult result;
  result.set_max_displacement(0.1);
  result.set_prescribed_displacement(0.1);
  result.set_estimated_error(1e-14);
  result.set_relative_error(1e-13);
  result.mutable_faces()->set_faces(100);
  result.mutable_cells()->set_cells(50);
  result.mutable_cells()->set_safe_amplitude(1);
  result.mutable_cells()->set_inverted_at_rest(3);  // the fault of the mesh, not of the design
  result.mutable_constraints()->add_residuals()->set_name("bore");
  return result;
}

void set_heights(double least, double largest, v1::DesignResult& result) {
  v1::ConstraintResidual& residual = *result.mutable_constraints()->mutable_residuals(0);
  residual.set_least_height(least);
  residual.set_largest_height(largest);
  residual.set_free_least_height(0.75);
  residual.set_free_largest_height(1.5);
}

void missed_by_held_points(double rms, v1::DesignResult& result) {
  v1::ConstraintResidual& residual = *result.mutable_constraints()->add_residuals();
  residual.set_name("bore");
  residual.set_largest(0.011);
  residual.set_rms(0.01);
  residual.set_free_largest(0.03);
  v1::ConstraintResidual::Held& roof = *residual.add_held();
  roof.set_handle("roof");
  roof.set_points(8);
  residual.add_held()->set_points(4);
  residual.set_held_largest(0.009);
  residual.set_held_rms(rms);
}

const SolutionFacts good_facts{.diagonal = 1, .condition = 1e6, .converged = true, .torn_edges = 0};

void set_error(v1::DesignResult& result, double error) {
  result.set_estimated_error(error);
  result.set_relative_error(error / result.max_displacement());
}

struct Case {
  const char* name;
  std::function<void(SolutionFacts&, v1::DesignResult&)> change;
  v1::Verdict verdict;
  const char* reason;
};

const std::vector<Case> cases = {
    {"nothing", [](auto&, auto&) {}, v1::VERDICT_GOOD, ""},
    {"infinite", [](auto&, auto& r) { r.set_max_displacement(std::numeric_limits<double>::infinity()); }, v1::VERDICT_BAD,
     "points are not finite"},
    {"unknown_error", [](auto&, auto& r) { r.set_estimated_error(std::numeric_limits<double>::quiet_NaN()); }, v1::VERDICT_BAD,
     "points are not finite"},
    {"not_converged", [](auto& f, auto&) { f.converged = false; }, v1::VERDICT_BAD, "the solver did not reach its tolerance"},
    {"not_converged_for_rounding",
     [](auto& f, auto& r) {
       f.converged = false;
       r.mutable_constraints()->set_at_rounding(true);
     },
     v1::VERDICT_GOOD, ""},
    {"far_from_converged_for_rounding",
     [](auto& f, auto& r) {
       f.converged = false;
       r.mutable_constraints()->set_at_rounding(true);
       set_error(r, 1.1e-4);
     },
     v1::VERDICT_BAD, "the estimated error is 0.00011, 0.0011 of the largest displacement"},
    {"not_converged_for_the_condition",
     [](auto& f, auto& r) {
       f.converged = false;
       f.condition = 1e18;
       f.method.condition_effect = MethodFacts::Effect::measured;
       set_error(r, 0.01);
     },
     v1::VERDICT_BAD,
     "the solver did not reach its tolerance: the estimated error is 0.01, 0.1 of the largest displacement; the condition of the "
     "system is 1e+18: handle and fixed points nearly coincide; hold fewer of them, or take kernel BIHARMONIC"},
    {"large_error", [](auto&, auto& r) { set_error(r, 1.1e-4); }, v1::VERDICT_BAD,
     "the estimated error is 0.00011, 0.0011 of the largest displacement"},
    {"error", [](auto&, auto& r) { set_error(r, 0.9e-4); }, v1::VERDICT_DOUBTFUL, "the estimated error is 9e-05"},
    {"small_error", [](auto&, auto& r) { set_error(r, 0.9e-7); }, v1::VERDICT_GOOD, ""},
    {"error_of_next_to_no_motion",
     [](auto&, auto& r) {
       r.set_max_displacement(1e-11);
       r.set_prescribed_displacement(1e-11);
       set_error(r, 0.9e-12);
     },
     v1::VERDICT_GOOD, ""},
    {"condition", [](auto& f, auto&) { f.condition = 1.1e12; }, v1::VERDICT_DOUBTFUL,
     "the condition of the system is 1.1e+12; how far that moves the points is not measured: hold parts"},
    {"condition_of_a_measured_error",
     [](auto& f, auto& r) {
       f.condition = 3e13;
       f.method.condition_effect = MethodFacts::Effect::measured;
       set_error(r, 0.9e-9);
     },
     v1::VERDICT_GOOD, ""},
    {"condition_that_is_felt",
     [](auto& f, auto& r) {
       f.condition = 3e13;
       f.method.condition_effect = MethodFacts::Effect::measured;
       set_error(r, 1.1e-9);
     },
     v1::VERDICT_DOUBTFUL,
     "the condition of the system is 3e+13; the measured error is 1.1e-08 of the largest displacement: handle and fixed points"},
    {"condition_whose_factor_has_digits_left",
     [](auto& f, auto&) {
       f.condition = 4e16;
       f.method.condition_effect = MethodFacts::Effect::measured;
     },
     v1::VERDICT_GOOD, ""},
    {"condition_of_next_to_no_motion",
     [](auto& f, auto& r) {
       f.condition = 3e13;
       f.method.condition_effect = MethodFacts::Effect::measured;
       r.set_max_displacement(1e-11);
       r.set_prescribed_displacement(1e-11);
       set_error(r, 0.9e-12);
     },
     v1::VERDICT_GOOD, ""},
    {"flipped", [](auto&, auto& r) { r.mutable_faces()->set_flipped(2); }, v1::VERDICT_DOUBTFUL, "2 of 100 faces are flipped"},
    {"run_into_others", [](auto&, auto& r) { r.mutable_faces()->set_intersecting(2); }, v1::VERDICT_DOUBTFUL,
     "2 of 100 faces ran into others"},
    {"across_a_plane", [](auto&, auto& r) { r.set_points_across_symmetry(7); }, v1::VERDICT_DOUBTFUL,
     "7 points crossed a symmetry plane"},
    {"torn", [](auto& f, auto&) { f.torn_edges = 3; }, v1::VERDICT_DOUBTFUL, "3 edges are torn at the boundary of the lattice"},
    {"mirrored", [](auto& f, auto&) { f.shapes = {"handle \"root\" is mirrored"}; }, v1::VERDICT_DOUBTFUL,
     "\"root\" is mirrored"},
    {"far", [](auto&, auto& r) { r.set_prescribed_displacement(0.06); }, v1::VERDICT_DOUBTFUL,
     "a point moves 1.67 times the largest prescribed displacement"},
    {"in_other_units",
     [](auto&, auto& r) {
       r.set_max_displacement(11);
       r.set_prescribed_displacement(11);
     },
     v1::VERDICT_DOUBTFUL, "points are to move by up to 11 times the diagonal of the model; are these its units?"},
    {"beyond_its_digits",
     [](auto&, auto& r) {
       r.set_max_displacement(1e300);
       r.set_prescribed_displacement(1e300);
     },
     v1::VERDICT_BAD, "points move by up to 1e+300 times the diagonal of the model, where the rounding of coordinates destroys"},
    {"a_point_beyond_its_digits",
     [](auto& f, auto& r) {
       f.diagonal = 0.01;
       r.set_max_displacement(1.1e10);
       r.set_prescribed_displacement(1e10);
     },
     v1::VERDICT_BAD, "points move by up to 1.1e+12 times the diagonal"},
    {"nearly_beyond_its_digits",
     [](auto&, auto& r) {
       r.set_max_displacement(0.9e12);
       r.set_prescribed_displacement(0.9e12);
     },
     v1::VERDICT_DOUBTFUL, "points are to move by up to 9e+11 times the diagonal of the model; are these its units?"},
    {"a_long_way",
     [](auto&, auto& r) {
       r.set_max_displacement(9);
       r.set_prescribed_displacement(9);
     },
     v1::VERDICT_GOOD, ""},
    {"handles_met_nearly", [](auto& f, auto&) { f.misfit = 0.0019; }, v1::VERDICT_GOOD, ""},
    {"handles_missed", [](auto& f, auto&) { f.misfit = 0.0021; }, v1::VERDICT_DOUBTFUL,
     "handle and fixed points are missed by up to 0.0021, 0.021 of the largest prescribed displacement: take more control "
     "points"},
    {"constraint_met_nearly",
     [](auto& f, auto& r) {
       f.method.more_freedom = "take more samples, ";
       auto& residual = *r.mutable_constraints()->add_residuals();
       residual.set_name("bore");
       residual.set_largest(0.009);
     },
     v1::VERDICT_GOOD, ""},
    {"constraint_missed",
     [](auto& f, auto& r) {
       f.method.more_freedom = "take more samples, ";
       auto& residual = *r.mutable_constraints()->add_residuals();
       residual.set_name("bore");
       residual.set_largest(0.011);
       residual.set_free_largest(0.03);
     },
     v1::VERDICT_DOUBTFUL,
     "constraint \"bore\" is missed by up to 0.011, 0.11 of the largest prescribed displacement, without it by 0.03: take more "
     "samples, a larger weight, or `exact: true`"},
    {"constraint_missed_by_held_points",
     [](auto& f, auto& r) {
       f.method.more_freedom = "take more samples, ";
       missed_by_held_points(0.005, r);
     },
     v1::VERDICT_DOUBTFUL,
     "constraint \"bore\" is missed by up to 0.011, 0.11 of the largest prescribed displacement, without it by 0.03: 12 of its "
     "points are held, 8 by handle \"roof\" and 4 by fixed regions, and these alone miss the shape by up to 0.009 (rms 0.005 of "
     "0.01), which no weight changes: take them out of the region, or let the handle follow the shape"},
    {"constraint_missed_by_other_points",
     [](auto& f, auto& r) {
       f.method.more_freedom = "take more samples, ";
       missed_by_held_points(0.0049, r);
     },
     v1::VERDICT_DOUBTFUL, "without it by 0.03: take more samples, a larger weight, or `exact: true`"},
    {"constraint_missed_by_a_fixed_point_though_exact",
     [](auto&, auto& r) {
       missed_by_held_points(0.005, r);
       auto& residual = *r.mutable_constraints()->mutable_residuals(1);
       residual.set_missed(true);
       residual.clear_held();
       residual.add_held()->set_points(1);
     },
     v1::VERDICT_BAD,
     "exact constraints are missed: \"bore\" (1 of its points is held by fixed regions, and it alone misses the shape by up to "
     "0.009 "
     "(rms 0.005 of 0.01), which no weight changes: take it out of the region)"},
    {"constraint_missed_though_exact",
     [](auto&, auto& r) {
       auto& residual = *r.mutable_constraints()->add_residuals();
       residual.set_name("bore");
       residual.set_largest(0.011);
       residual.set_missed(true);
     },
     v1::VERDICT_BAD, "exact constraints are missed: \"bore\""},
    {"error_of_direct_manipulation",
     [](auto& f, auto& r) {
       f.method.manipulates_directly = true;
       set_error(r, 0.002);
     },
     v1::VERDICT_BAD, "of the largest displacement: the clamp separates singular values"},
    {"handles_missed_somewhat", [](auto& f, auto&) { f.misfit = 0.049; }, v1::VERDICT_DOUBTFUL, "0.49 of the largest"},
    {"handles_missed_far", [](auto& f, auto&) { f.misfit = 0.051; }, v1::VERDICT_BAD, "0.51 of the largest"},
    {"nothing_moves", [](auto&, auto& r) { r.set_max_displacement(0.9e-7); }, v1::VERDICT_BAD,
     "nothing moves: the largest displacement of a point is 9e-08, the largest prescribed one 0.1"},
    {"next_to_nothing_moves", [](auto&, auto& r) { r.set_max_displacement(1.1e-7); }, v1::VERDICT_GOOD, ""},
    {"nothing_is_to_move",
     [](auto&, auto& r) {
       r.set_max_displacement(0);
       r.set_prescribed_displacement(0);
     },
     v1::VERDICT_GOOD, ""},
    {"inverted",
     [](auto&, auto& r) {
       r.mutable_cells()->set_inverted(2);
       r.mutable_cells()->set_safe_amplitude(0.25);
     },
     v1::VERDICT_BAD, "2 of 50 cells are inverted; none before 0.25 of the motion"},
    {"non_orthogonal",
     [](auto&, auto& r) {
       r.mutable_cells()->set_non_orthogonal_faces(3);
       r.mutable_cells()->set_largest_non_orthogonality(81.25);
       r.mutable_cells()->set_largest_non_orthogonality_face(17);
     },
     v1::VERDICT_DOUBTFUL,
     "3 faces of cells have become severely non-orthogonal, beyond 70 degrees; the largest angle is 81.2 degrees, at face 17"},
    {"non_orthogonal_at_rest", [](auto&, auto& r) { r.mutable_cells()->set_non_orthogonal_faces(0); }, v1::VERDICT_GOOD, ""},
    {"split_that_mends",
     [](auto&, auto& r) {
       r.mutable_cells()->set_inverted(2);
       r.mutable_split()->set_inversion_free(true);
       r.mutable_split()->set_reached(1);
     },
     v1::VERDICT_GOOD, ""},
    {"split", [](auto&, auto& r) { r.mutable_split()->set_reached(0.5); }, v1::VERDICT_BAD,
     "the split did not arrive: 0.5 of the motion was reached"},
    {"missed", [](auto&, auto& r) { r.mutable_constraints()->mutable_residuals(0)->set_missed(true); }, v1::VERDICT_BAD,
     "exact constraints are missed: \"bore\""},
    {"given_up", [](auto&, auto& r) { r.mutable_constraints()->set_exact_given_up(true); }, v1::VERDICT_BAD, "given up"},
    {"heights", [](auto&, auto& r) { set_heights(0.9901, 1.0099, r); }, v1::VERDICT_GOOD, ""},
    {"low_layers", [](auto&, auto& r) { set_heights(0.907, 1, r); }, v1::VERDICT_DOUBTFUL,
     "the heights of the layers of \"bore\" are 0.907 to 1 of those at rest, without the constraint 0.75 to 1.5"},
    {"high_layers", [](auto&, auto& r) { set_heights(1, 1.02, r); }, v1::VERDICT_DOUBTFUL, "are 1 to 1.02 of those at rest"},
    {"layers_nowhere", [](auto&, auto& r) { set_heights(std::nan(""), 1, r); }, v1::VERDICT_DOUBTFUL, "of those at rest"},
};

class Verdict : public testing::TestWithParam<Case> {};

TEST_P(Verdict, IsWhatIsFound) {
  SolutionFacts facts = good_facts;
  v1::DesignResult result = good_result();
  GetParam().change(facts, result);
  set_verdict(facts, result);
  EXPECT_EQ(result.verdict(), GetParam().verdict);
  ASSERT_EQ(result.reasons_size(), GetParam().verdict == v1::VERDICT_GOOD ? 0 : 1);
  if (result.reasons_size() > 0) EXPECT_NE(result.reasons(0).find(GetParam().reason), std::string::npos) << result.reasons(0);
}

INSTANTIATE_TEST_SUITE_P(Results, Verdict, testing::ValuesIn(cases),
                         [](const auto& info) { return std::string(info.param.name); });

// Direct solvers have no tolerance that could be missed; others do.
TEST(Verdicts, ASolutionThatIsNotRefinedIsDoubtfulWhereItsErrorIsHarmless) {
  const auto judged = [](double error, const std::function<void(SolutionFacts&)>& change) {
    SolutionFacts facts = good_facts;
    facts.converged = false;
    facts.condition = 3e19;
    facts.method.condition_effect = MethodFacts::Effect::measured;
    change(facts);
    v1::DesignResult result = good_result();
    set_error(result, error);
    set_verdict(facts, result);
    return result;
  };
  const v1::DesignResult harmless = judged(0.9e-10, [](SolutionFacts&) {});
  EXPECT_EQ(harmless.verdict(), v1::VERDICT_DOUBTFUL);
  EXPECT_EQ(
      harmless.reasons(0),
      "the refinement of the solution did not converge: the estimated error is 9e-11, and may be a thousand times too small");
  EXPECT_EQ(judged(1.1e-10, [](SolutionFacts&) {}).verdict(), v1::VERDICT_BAD);
  EXPECT_EQ(judged(1e-13, [](SolutionFacts& f) { f.condition = 1e11; }).verdict(), v1::VERDICT_BAD) << "iterative";
  EXPECT_EQ(judged(1e-13, [](SolutionFacts& f) { f.method.condition_effect = MethodFacts::Effect::unknown; }).verdict(),
            v1::VERDICT_BAD);
  EXPECT_EQ(judged(1e-13, [](SolutionFacts& f) { f.method.least_squares_tolerance = 1e-6; }).verdict(), v1::VERDICT_BAD);
}

TEST(Verdicts, AConditionThatDidNoHarmIsANote) {
  SolutionFacts facts = good_facts;
  v1::DesignResult result = good_result();
  facts.method.condition_effect = MethodFacts::Effect::measured;
  set_verdict(facts, result);
  EXPECT_EQ(result.notes_size(), 0);
  facts.condition = 3e13;
  set_verdict(facts, result);
  set_verdict(facts, result);  // what was there before does not count
  ASSERT_EQ(result.notes_size(), 1);
  EXPECT_EQ(result.notes(0), "the condition of the system is 3e+13; the measured error is 1e-13 of the largest displacement");
  EXPECT_EQ(result.verdict(), v1::VERDICT_GOOD);
  // A solver that did not arrive measures nothing.
  facts.converged = false;
  set_verdict(facts, result);
  EXPECT_EQ(result.notes_size(), 0);
  ASSERT_EQ(result.reasons_size(), 2);
  EXPECT_NE(result.reasons(1).find("condition"), std::string::npos);
}

TEST(Verdicts, OnlyErrorsOfRadialFunctionsShowWhatAConditionDoes) {
  v1::Setup setup;
  EXPECT_EQ(method_facts(setup).condition_effect, MethodFacts::Effect::measured) << "an empty method is rbf";
  setup.mutable_method()->mutable_rbf();
  EXPECT_EQ(method_facts(setup).condition_effect, MethodFacts::Effect::measured);
  setup.add_then()->mutable_method()->mutable_rbf();
  EXPECT_EQ(method_facts(setup).condition_effect, MethodFacts::Effect::measured);
  setup.add_then()->mutable_method()->mutable_ffd();
  EXPECT_EQ(method_facts(setup).condition_effect, MethodFacts::Effect::unknown);
  for (const auto choose : {+[](v1::Method& m) { m.mutable_shell(); }, +[](v1::Method& m) { m.mutable_mls(); },
                            +[](v1::Method& m) { m.mutable_subspace(); }, +[](v1::Method& m) { m.mutable_cage(); }}) {
    v1::Setup other;
    choose(*other.mutable_method());
    EXPECT_EQ(method_facts(other).condition_effect, MethodFacts::Effect::unknown);
  }
}

// Solvers stop at a part of D, whatever the motion: a design at rest, from which optimizers start, is not bad for that.
TEST(Verdicts, JudgeErrorsOfSmallMotionsAsIfTheseWereATenThousandthOfTheDiagonal) {
  const SolutionFacts facts{.diagonal = 2, .condition = 1e6};
  for (const double motion : {0.0, 1e-15, 1e-9, 2e-4}) {
    for (const auto& [error, verdict] : {std::pair{1.9e-10, v1::VERDICT_GOOD}, std::pair{2.1e-10, v1::VERDICT_DOUBTFUL},
                                         std::pair{1.9e-7, v1::VERDICT_DOUBTFUL}, std::pair{2.1e-7, v1::VERDICT_BAD}}) {
      v1::DesignResult result = good_result();
      result.set_max_displacement(motion);
      result.set_prescribed_displacement(motion);
      set_error(result, error);
      set_verdict(facts, result);
      EXPECT_EQ(result.verdict(), verdict) << motion << ", " << error;
    }
  }
  v1::DesignResult result = good_result();
  result.set_max_displacement(2.1e-3);
  set_error(result, 2e-9);
  set_verdict(facts, result);
  EXPECT_EQ(result.verdict(), v1::VERDICT_GOOD) << "larger ones are judged by themselves";
}

TEST(Verdicts, NameTheToleranceThatWouldDo) {
  v1::Setup setup;
  v1::RbfMethod& rbf = *setup.mutable_method()->mutable_rbf();
  rbf.set_tolerance(1e-4);
  EXPECT_EQ(method_facts(setup).least_squares_tolerance, 0);  // of another solver it is the error
  rbf.set_solver(v1::INCREMENTAL_QR);
  EXPECT_EQ(method_facts(setup).least_squares_tolerance, 1e-4);
  SolutionFacts facts = good_facts;
  facts.method = method_facts(setup);
  v1::DesignResult result = good_result();
  set_error(result, 5.14e-3);  // 0.0514 of the motion, that is 51.4 times what is bad
  set_verdict(facts, result);
  ASSERT_EQ(result.reasons_size(), 1);
  EXPECT_NE(result.reasons(0).find("the tolerance 0.0001 of INCREMENTAL_QR is at handle and fixed points"), std::string::npos);
  EXPECT_NE(result.reasons(0).find("take 4e-07 or solver SOLVER_AUTOMATIC"), std::string::npos) << result.reasons(0);
  set_error(result, 3e-6);
  set_verdict(facts, result);
  EXPECT_NE(result.reasons(0).find("take 8e-07 or"), std::string::npos) << result.reasons(0);
  facts.method = {};
  set_verdict(facts, result);
  EXPECT_EQ(result.reasons(0), "the estimated error is 3e-06, 3e-05 of the largest displacement");
}

TEST(Verdicts, NameTheKernelThatOvershoots) {
  v1::Setup setup;
  setup.mutable_method()->mutable_rbf()->set_kernel(v1::THIN_PLATE);
  EXPECT_NE(method_facts(setup).overshoot.find("nothing is fixed"), std::string::npos);
  setup.add_fixed()->set_group("farfield");
  SolutionFacts facts = good_facts;
  facts.method = method_facts(setup);
  v1::DesignResult result = good_result();
  result.set_prescribed_displacement(0.05);
  set_verdict(facts, result);
  ASSERT_EQ(result.reasons_size(), 1);
  EXPECT_NE(result.reasons(0).find("2 times the largest prescribed displacement: kernel THIN_PLATE"), std::string::npos);
  EXPECT_NE(result.reasons(0).find("BIHARMONIC"), std::string::npos);
  for (const v1::Kernel kernel : {v1::TRIHARMONIC, v1::QUINTIC, v1::WENDLAND_C2}) {
    setup.mutable_method()->mutable_rbf()->set_kernel(kernel);
    EXPECT_TRUE(method_facts(setup).overshoot.starts_with("kernel " + v1::Kernel_Name(kernel) + " carries"));
  }
  for (const v1::Kernel kernel : {v1::BIHARMONIC, v1::MULTIQUADRIC, v1::INVERSE_MULTIQUADRIC, v1::GAUSSIAN}) {
    setup.mutable_method()->mutable_rbf()->set_kernel(kernel);
    EXPECT_TRUE(method_facts(setup).overshoot.empty());
  }
  setup.mutable_method()->mutable_mls();
  EXPECT_TRUE(method_facts(setup).overshoot.empty());
}

TEST(Verdicts, NameTheKernelsAndMethodsOfChainsThatOvershoot) {
  const std::string slopes = " carries the slopes of handles that turn or bend on beyond them; kernel BIHARMONIC hardly does";
  v1::Setup setup;
  setup.mutable_method()->mutable_rbf()->set_kernel(v1::THIN_PLATE);
  setup.add_fixed()->set_group("farfield");
  v1::Stage& second = *setup.add_then();
  second.mutable_method()->mutable_rbf()->set_kernel(v1::BIHARMONIC);
  second.add_fixed()->set_group("farfield");
  EXPECT_EQ(method_facts(setup).overshoot, "kernel THIN_PLATE of the first method" + slopes);
  second.mutable_method()->mutable_rbf()->set_kernel(v1::THIN_PLATE);
  EXPECT_EQ(method_facts(setup).overshoot, "kernel THIN_PLATE of the first method and then[0]" + slopes);
  second.mutable_method()->mutable_rbf()->set_kernel(v1::QUINTIC);
  EXPECT_EQ(method_facts(setup).overshoot,
            "kernel THIN_PLATE of the first method" + slopes + "; kernel QUINTIC of then[0]" + slopes);
  second.clear_fixed();
  setup.mutable_method()->mutable_ffd();
  EXPECT_EQ(method_facts(setup).overshoot,
            "nothing is fixed in then[0], so that what is beyond the handles goes on moving as they do; fix what is to stay");
  second.mutable_method()->mutable_ffd()->set_control(v1::MESH);
  EXPECT_TRUE(method_facts(setup).overshoot.empty());
  EXPECT_TRUE(method_facts(setup).manipulates_directly);
  second.mutable_method()->mutable_ffd()->set_control(v1::ENERGY);
  EXPECT_FALSE(method_facts(setup).manipulates_directly);
}

TEST(Verdicts, TheWorstReasonComesFirst) {
  SolutionFacts facts = good_facts;
  facts.condition = 1e13;
  v1::DesignResult result = good_result();
  result.mutable_cells()->set_inverted(2);
  set_verdict(facts, result);
  set_verdict(facts, result);  // what was there before does not count
  EXPECT_EQ(result.verdict(), v1::VERDICT_BAD);
  ASSERT_EQ(result.reasons_size(), 2);
  EXPECT_NE(result.reasons(0).find("inverted"), std::string::npos);
  EXPECT_NE(result.reasons(1).find("condition"), std::string::npos);
  EXPECT_EQ(result.reasons_of_verdict(), 1u);
  result.mutable_cells()->set_inverted(0);
  result.mutable_faces()->set_flipped(1);
  set_verdict(facts, result);
  EXPECT_EQ(result.reasons_of_verdict(), 2u);
  result = good_result();
  set_verdict(good_facts, result);
  EXPECT_EQ(result.reasons_of_verdict(), 0u);
}

}  // namespace
}  // namespace deform::convert::verdict_test
