// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "core/io/formats/containers/container_mesh.h"

namespace deform::io {

/// The library of a format in a separate process (ReadOptions::isolated_reader). Any thread may call.
class IsolatedLibrary {
 public:
  IsolatedLibrary(Format format, ReadOptions options) : format_(format), options_(std::move(options)) {}

  /// As read() and overwrite() of its ContainerLibrary. Also throws Error(invalid_argument) if the process crashes or reaches a
  /// limit, Error(cancelled) if it is interrupted, Error(failed_precondition) if it cannot be started.
  ContainerMesh read(const ContainerFile& file, std::size_t bytes, const std::string& name) const;
  void overwrite(const ContainerFile& file, std::size_t bytes, const std::string& name, const std::string& layout,
                 std::span<const Vec3> points) const;

 private:
  Format format_;
  ReadOptions options_;
};

}  // namespace deform::io
