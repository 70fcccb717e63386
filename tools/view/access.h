// Access to the server: tokens, and the hosts that a browser may name.
#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "format/result.h"

namespace scree::tools::view {

/// 128 random bits as 32 hexadecimal digits. Errors kFile: the system has no random bytes.
Result<std::string> make_token();

/// Takes a time that depends only on the lengths.
bool is_same_token(std::string_view a, std::string_view b);

/// "name", "name:80", "[::1]:80" without the port and in lower case; empty for any other text.
std::string host_of(std::string_view authority);

/// The hosts by which pages may reach the server. A page of another site can send requests to 127.0.0.1, and by DNS
/// rebinding it can even send them with its own Host. So Host and Origin must each be known here; it is not enough that
/// they are equal.
class AccessList {
 public:
  /// `bound`: the address that the server listens on. `allowed`: further names (--allow-host), such as a proxy's.
  AccessList(std::string_view bound, const std::vector<std::string>& allowed);

  /// Accepts any port, because an SSH tunnel may have another.
  bool allows_host(std::string_view host_header) const;

  /// `origin`: "http://HOST[:PORT]" or https. It must have the authority of `host_header`, or be a name of
  /// --allow-host, because a proxy may change the Host. A request without an origin is refused: browsers always send it
  /// for a WebSocket.
  bool allows_origin(std::string_view origin, std::string_view host_header) const;

 private:
  std::vector<std::string> own_;
  std::vector<std::string> allowed_;
};

/// "127.0.0.1", "::1", "localhost" and the like.
bool is_loopback(std::string_view host);

/// "/x/y" for "x/y/", "/x/y" and so on; empty for "/" and "". Errors kUsage: characters other than letters, digits and
/// -._~/, or a part "..".
Result<std::string> parse_base_path(std::string_view text);

/// `target` without the query and the base path: "/" and the rest. If a proxy has already removed the base path,
/// `target` itself. Empty if it is the base path without a slash, which must be redirected.
std::string_view path_below(std::string_view target, std::string_view base_path);

}  // namespace scree::tools::view
