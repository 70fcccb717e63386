// ViewServer in a build without Boost.
#include "tools/view/server.h"

namespace scree::tools::view {

struct ViewServer::Impl {};

ViewServer::ViewServer(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
ViewServer::ViewServer(ViewServer&&) noexcept = default;
ViewServer& ViewServer::operator=(ViewServer&&) noexcept = default;
ViewServer::~ViewServer() = default;

Result<ViewServer> ViewServer::listen(ServerOptions) {
  return Error{
      ErrorCode::kUnsupported,
      "this program was built without Boost.Beast, which the server needs (libboost-dev; scripts/setup installs "
      "it, then build again)"};
}
uint16_t ViewServer::port() const {
  return 0;
}
void ViewServer::run(Hub&, const std::function<bool()>&) {}

}  // namespace scree::tools::view
