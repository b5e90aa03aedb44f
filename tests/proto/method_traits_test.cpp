// SPDX-License-Identifier: GPL-3.0-or-later
// What is read off the message of a method holds for all fields of Method, also for those that come.
#include "proto/convert/method_traits.h"

#include <gmock/gmock-matchers.h>
#include <google/protobuf/descriptor.h>
#include <gtest/gtest.h>

#include <vector>

#include "core/base/error.h"
#include "core/deformers/methods.h"
#include "proto/convert/method.h"

namespace deform::convert::method_traits_test {
namespace {

/// An empty message of each method.
std::vector<v1::Method> methods() {
  std::vector<v1::Method> result;
  const auto* const kinds = v1::Method::descriptor()->FindOneofByName("kind");
  for (int i = 0; i < kinds->field_count(); ++i) {
    v1::Method& method = result.emplace_back();
    method.GetReflection()->MutableMessage(&method, kinds->field(i));
  }
  return result;
}

/// The message with a field `basis`: that of the method, or its energy.
google::protobuf::Message& basis_holder(v1::Method& method) {
  const auto* const reflection = method.GetReflection();
  google::protobuf::Message* const options = reflection->MutableMessage(
      &method, reflection->GetOneofFieldDescriptor(method, v1::Method::descriptor()->FindOneofByName("kind")));
  const auto* const energy = options->GetDescriptor()->FindFieldByName("energy");
  return energy == nullptr ? *options : *options->GetReflection()->MutableMessage(options, energy);
}

TEST(MethodTraits, EachFieldIsAMethodOfCore) {
  std::size_t in_core = 0;
  Methods::for_each([&]<Method M>() { ++in_core; });
  EXPECT_EQ(methods().size(), in_core);
  for (v1::Method& method : methods()) {
    const std::string name = method_name(method);
    const MethodFeatures features = method_features(method);
    deform::Setup setup;
    setup.method = method_from_proto(method);
    with_method(setup, [&]<Method M>(const typename M::Options&) {
      EXPECT_EQ(name, M::name);
      EXPECT_EQ(features.constraints, M::features.constraints) << name;
      EXPECT_EQ(features.more_of, M::features.more_of) << name;
    });
    canonicalize_method(method);
    EXPECT_EQ(method_name(method), name) << "a method stays what it is";
  }
}

TEST(MethodTraits, AnEmptyMessageIsRbf) {
  EXPECT_EQ(method_name({}), "rbf");
  EXPECT_TRUE(method_features({}).symmetry);
  EXPECT_FALSE(method_features({}).constraints);
  EXPECT_EQ(energy_of({}), nullptr);
  EXPECT_EQ(basis_of({}), v1::BASIS_AUTOMATIC);
}

TEST(MethodTraits, EachMethodHasABasisMode) {
  for (v1::Method& method : methods()) {
    EXPECT_EQ(basis_of(method), v1::BASIS_AUTOMATIC) << method_name(method);
    google::protobuf::Message& holder = basis_holder(method);
    const auto* const field = holder.GetDescriptor()->FindFieldByName("basis");
    ASSERT_NE(field, nullptr) << method_name(method);
    holder.GetReflection()->SetEnumValue(&holder, field, v1::BASIS_NEVER);
    EXPECT_EQ(basis_of(method), v1::BASIS_NEVER) << method_name(method);
    deform::Setup setup;
    setup.method = method_from_proto(method);
    with_method(setup,
                []<Method M>(const typename M::Options& options) { EXPECT_EQ(options.basis, BasisMode::never) << M::name; });
  }
}

TEST(MethodTraits, EnergiesAreThoseOfTheMessage) {
  v1::Method method;
  method.mutable_mls()->mutable_energy()->set_bending(3);
  ASSERT_NE(energy_of(method), nullptr);
  EXPECT_EQ(energy_of(method), &method.mls().energy());
  method.mutable_cage();
  EXPECT_EQ(energy_of(method), nullptr);
}

TEST(MethodTraits, DirectManipulation) {
  v1::Method method;
  method.mutable_ffd()->set_control(v1::CONTROLS);
  EXPECT_FALSE(manipulates_directly(method));
  method.mutable_ffd()->set_control(v1::MESH);
  EXPECT_TRUE(manipulates_directly(method));
  method.mutable_cage()->set_control(v1::MESH);
  EXPECT_TRUE(manipulates_directly(method));
  method.mutable_shell();
  EXPECT_FALSE(manipulates_directly(method));
}

TEST(MethodTraits, EachKernelIsOneOfCore) {
  const auto* const kernels = v1::Kernel_descriptor();
  std::vector<Kernel> found;
  for (int i = 0; i < kernels->value_count(); ++i) {
    if (kernels->value(i)->number() == v1::KERNEL_DEFAULT) continue;
    const auto kernel = kernel_named_as(kernels->value(i)->name());
    ASSERT_TRUE(kernel) << kernels->value(i)->name();
    found.push_back(*kernel);
  }
  std::vector<Kernel> all;
  for (const KernelProperties& kernel : all_kernels()) all.push_back(kernel.kernel);
  EXPECT_THAT(found, testing::UnorderedElementsAreArray(all));
  EXPECT_FALSE(kernel_named_as("KERNEL_DEFAULT"));
}

}  // namespace
}  // namespace deform::convert::method_traits_test
