// SPDX-License-Identifier: GPL-3.0-or-later
#include "server/engine/compiled_records.h"

#include <utility>

#include "core/base/version.h"

namespace deform::server {

namespace {

CompiledForm named_form(const SystemCache::Handle& system, const std::string& mesh) {
  CompiledForm form(system->system);
  compiled::Content& content = form.content();
  content.creator = std::string("deformd ") + version();
  content.geometry_id = system->info.geometry_id();
  content.system_id = system->info.id();
  content.mesh = mesh;
  content.setup = system->info.setup().SerializeAsString();
  return form;
}

}  // namespace

CompiledRecords::CompiledRecords(const SystemCache::Handle& system, const std::string& mesh, Charge charge)
    : charge_(std::move(charge)),
      system_(system),
      form_(named_form(system, mesh)),
      records_(std::as_const(form_).content(),
               [this](std::size_t basis, std::size_t first, std::span<double> out) { form_.values(basis, first, out); }) {
  header_.set_system_id(system->info.id());
  header_.set_geometry_id(system->info.geometry_id());
  header_.set_bytes(records_.bytes());
  header_.set_version(compiled::layout_version);
}

bool CompiledRecords::next(std::string& records) {
  if (!records_.next(piece_)) return false;
  records.assign(reinterpret_cast<const char*>(piece_.data()), piece_.size());
  return true;
}

}  // namespace deform::server
