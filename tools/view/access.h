// Who may talk to the server: tokens, and the hosts that a browser may name.
#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "format/result.h"

namespace scree::tools::view {

/// 128 random bits as 32 hexadecimal digits. Errors kFile: the system has no random bytes.
Result<std::string> make_token();

/// In a time that depends on the lengths alone.
bool is_same_token(std::string_view a, std::string_view b);

/// "name", "name:80", "[::1]:80" without the port and in lower case; empty where it is none of these.
std::string host_of(std::string_view authority);

/// The hosts by which pages may reach the server. A page of another site can send requests to 127.0.0.1, and by DNS
/// rebinding even has them sent with a Host of its own, so Host and Origin must each be known here; that they equal
/// each other proves nothing.
class AccessList {
 public:
  /// `bound`: the address that is listened on; `allowed`: further names (--allow-host), as a proxy's.
  AccessList(std::string_view bound, const std::vector<std::string>& allowed);

  /// Of any port: an SSH tunnel may have another.
  bool allows_host(std::string_view host_header) const;

  /// `origin`: "http://HOST[:PORT]" or https. It has the authority of `host_header`, or is a name of --allow-host,
  /// since a proxy may change the Host. A request without one is refused: browsers always send it for a WebSocket.
  bool allows_origin(std::string_view origin, std::string_view host_header) const;

 private:
  std::vector<std::string> own_;
  std::vector<std::string> allowed_;
};

/// "127.0.0.1", "::1", "localhost" and the like.
bool is_loopback(std::string_view host);

/// "/x/y" for "x/y/", "/x/y" and so on, empty for "/" and "". Errors kUsage: characters other than letters, digits and
/// -._~/, or a part that is "..".
Result<std::string> parse_base_path(std::string_view text);

/// `target` without the query and the base path: "/" and what follows. Where a proxy has taken the base path away
/// already, `target` itself. Empty where it is the base path without a slash, which is to be redirected.
std::string_view path_below(std::string_view target, std::string_view base_path);

}  // namespace scree::tools::view
