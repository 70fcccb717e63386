#include "tools/view/access.h"

#include <algorithm>
#include <array>
#include <cctype>
#include <cstdint>

#include <arpa/inet.h>
#include <sys/random.h>
#include <unistd.h>

namespace scree::tools::view {
namespace {

std::string lower_case(std::string_view text) {
  std::string out(text);
  std::transform(out.begin(), out.end(), out.begin(),
                 [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  return out;
}

bool is_one_of(const std::vector<std::string>& list, const std::string& text) {
  return std::find(list.begin(), list.end(), text) != list.end();
}

}  // namespace

Result<std::string> make_token() {
  std::array<uint8_t, 16> bytes{};
  if (::getrandom(bytes.data(), bytes.size(), 0) != static_cast<ssize_t>(bytes.size()))
    return Error{ErrorCode::kFile, "no random bytes for a token"};
  std::string token;
  for (const uint8_t byte : bytes) {
    constexpr char kDigits[] = "0123456789abcdef";
    token += kDigits[byte >> 4];
    token += kDigits[byte & 15];
  }
  return token;
}

bool is_same_token(std::string_view a, std::string_view b) {
  if (a.size() != b.size()) return false;
  unsigned difference = 0;
  for (size_t i = 0; i < a.size(); ++i)
    difference |= static_cast<unsigned char>(a[i]) ^ static_cast<unsigned char>(b[i]);
  return difference == 0;
}

std::string host_of(std::string_view authority) {
  size_t end = authority.find(':');
  if (authority.starts_with('[')) {
    end = authority.find(']');
    if (end == std::string_view::npos) return {};
    ++end;
  }
  const std::string_view port = end >= authority.size() ? std::string_view() : authority.substr(end);
  if (!port.empty() && (port.front() != ':' || port.size() < 2 || port.size() > 6 ||
                        !std::all_of(port.begin() + 1, port.end(), [](unsigned char c) { return std::isdigit(c); })))
    return {};
  const std::string_view host = authority.substr(0, end);
  const bool is_plain = std::all_of(host.begin(), host.end(), [](unsigned char c) {
    return std::isalnum(c) || c == '.' || c == '-' || c == '_' || c == ':' || c == '[' || c == ']';
  });
  return is_plain ? lower_case(host) : std::string();
}

Result<std::string> address_of(const std::string& host) {
  in_addr four{};
  in6_addr six{};
  char text[INET6_ADDRSTRLEN] = {};
  if (lower_case(host) == "localhost") return std::string("127.0.0.1");
  if (::inet_pton(AF_INET, host.c_str(), &four) == 1)
    return std::string(::inet_ntop(AF_INET, &four, text, sizeof text));
  if (::inet_pton(AF_INET6, host.c_str(), &six) != 1)
    return Error{ErrorCode::kUsage, "--host: '" + host + "' is not an address such as 127.0.0.1"};
  if (IN6_IS_ADDR_V4MAPPED(&six)) return std::string(::inet_ntop(AF_INET, six.s6_addr + 12, text, sizeof text));
  return std::string(::inet_ntop(AF_INET6, &six, text, sizeof text));
}

bool is_loopback(std::string_view address) {
  return address == "::1" || address.starts_with("127.");
}

AccessList::AccessList(std::string_view bound, const std::vector<std::string>& allowed)
    : own_{"127.0.0.1", "localhost", "[::1]"} {
  const std::string address = lower_case(bound);
  if (address == "0.0.0.0" || address == "::") {
    char name[256] = {};
    if (::gethostname(name, sizeof name - 1) == 0 && name[0] != 0) own_.push_back(lower_case(name));
  } else {
    own_.push_back(address.find(':') == std::string::npos ? address : "[" + address + "]");
  }
  for (const std::string& host : allowed) allowed_.push_back(lower_case(host));
}

bool AccessList::allows_host(std::string_view host_header) const {
  const std::string host = host_of(host_header);
  return !host.empty() && (is_one_of(own_, host) || is_one_of(allowed_, host));
}

bool AccessList::allows_origin(std::string_view origin, std::string_view host_header) const {
  std::string text = lower_case(origin);
  const std::string_view scheme = text.starts_with("https://") ? "https://" : "http://";
  if (!text.starts_with(scheme)) return false;
  const std::string authority = text.substr(scheme.size());
  const std::string host = host_of(authority);
  if (host.empty()) return false;
  if (is_one_of(allowed_, host)) return true;
  return is_one_of(own_, host) && authority == lower_case(host_header);
}

Result<std::string> parse_base_path(std::string_view text) {
  std::string path;
  for (size_t at = 0; at < text.size();) {
    const size_t end = std::min(text.find('/', at), text.size());
    const std::string_view part = text.substr(at, end - at);
    at = end + 1;
    if (part.empty()) continue;
    const bool is_plain = std::all_of(part.begin(), part.end(), [](unsigned char c) {
      return std::isalnum(c) || c == '-' || c == '.' || c == '_' || c == '~';
    });
    if (!is_plain || part == "." || part == "..")
      return Error{ErrorCode::kUsage, "--base-path: '" + std::string(text) + "' is not a path such as /scree"};
    path.append("/").append(part);
  }
  return path;
}

std::string_view path_below(std::string_view target, std::string_view base_path) {
  target = target.substr(0, target.find_first_of("?#"));
  if (base_path.empty() || !target.starts_with(base_path)) return target;
  const std::string_view rest = target.substr(base_path.size());
  if (rest.empty() || rest.front() == '/') return rest;
  return target;
}

}  // namespace scree::tools::view
