// Access to the server: tokens, and checks of the headers Host and Origin.
#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "format/result.h"

namespace scree::tools::view {

/// 128 random bits as 32 hexadecimal digits. Errors kFile: the system has no random bytes.
Result<std::string> make_token();

/// Takes the same time for all texts of the same lengths, so that timing does not reveal the token.
bool is_same_token(std::string_view a, std::string_view b);

/// The host of "name", "name:80" or "[::1]:80", in lower case; empty for any other text.
std::string host_of(std::string_view authority);

/// The host names under which pages may use the server. A page of another site can send requests to 127.0.0.1, and by
/// DNS rebinding it can even send them with its own Host. So Host and Origin must each be in this list; it is not
/// enough that they are equal.
class AccessList {
 public:
  /// `bound`: the address that the server listens on. `allowed`: further names (--allow-host), such as that of a proxy.
  AccessList(std::string_view bound, const std::vector<std::string>& allowed);

  /// Accepts any port, because an SSH tunnel may use another one.
  bool allows_host(std::string_view host_header) const;

  /// `origin`: "http://HOST[:PORT]" or https. It must have the authority of `host_header`, or be a name of
  /// --allow-host, because a proxy may change the Host. A request without an origin is refused: browsers always send it
  /// for a WebSocket.
  bool allows_origin(std::string_view origin, std::string_view host_header) const;

 private:
  std::vector<std::string> own_;
  std::vector<std::string> allowed_;
};

/// The address of `host` as browsers write it: of another spelling of an address, or of "localhost". Error kUsage.
Result<std::string> address_of(const std::string& host);

/// Whether only this machine reaches an address of address_of().
bool is_loopback(std::string_view address);

/// "/x/y" for "x/y/", "/x/y" and so on; empty for "/" and "". Errors kUsage: characters other than letters, digits and
/// -._~/, or a part "..".
Result<std::string> parse_base_path(std::string_view text);

/// `target` without query and base path: "/" and the rest. Returns `target` without its query if a proxy has already
/// removed the base path. Empty if `target` is the base path without a slash, which must be redirected.
std::string_view path_below(std::string_view target, std::string_view base_path);

}  // namespace scree::tools::view
