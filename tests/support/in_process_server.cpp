// SPDX-License-Identifier: GPL-3.0-or-later
#include "tests/support/in_process_server.h"

#include <grpcpp/grpcpp.h>
#include <spdlog/spdlog.h>
#include <stdlib.h>

#include <string>
#include <system_error>
#include <utility>

namespace deform::support {

TemporaryFolder::TemporaryFolder() {
  std::string name = (std::filesystem::temp_directory_path() / "deform-test-XXXXXX").string();
  if (mkdtemp(name.data()) == nullptr) throw std::system_error(errno, std::generic_category(), "mkdtemp");
  path_ = name;
}

TemporaryFolder::~TemporaryFolder() {
  std::error_code ignored;
  std::filesystem::remove_all(path_, ignored);
}

namespace {

server::ServerOptions prepared(server::ServerOptions options, Transport transport, const std::filesystem::path& folder) {
  options.address = transport == Transport::loopback ? "127.0.0.1:0" : "";
  if (options.engine.data_dir.empty()) options.engine.data_dir = folder / "data";
  spdlog::set_level(spdlog::level::off);
  return options;
}

}  // namespace

InProcessServer::InProcessServer(Transport transport, server::ServerOptions options)
    : transport_(transport),
      options_(prepared(std::move(options), transport, folder_.path())),
      running_(server::start_server(options_)) {}

InProcessServer::InProcessServer(Transport transport, std::unique_ptr<server::Engine> engine,
                                 const server::ServiceOptions& service)
    : transport_(transport), options_(prepared({}, transport, folder_.path())) {
  options_.service = service;
  running_ = server::start_server(options_, std::move(engine));
}

std::shared_ptr<grpc::Channel> InProcessServer::channel() {
  if (transport_ == Transport::in_process) return running_->in_process_channel();
  grpc::ChannelArguments arguments;
  arguments.SetInt(GRPC_ARG_USE_LOCAL_SUBCHANNEL_POOL, 1);  // a connection of its own, not shared with other channels
  return grpc::CreateCustomChannel(running_->address(), grpc::InsecureChannelCredentials(), arguments);
}

void InProcessServer::restart() {
  running_.reset();  // gives the data directory back
  running_ = server::start_server(options_);
}

}  // namespace deform::support
