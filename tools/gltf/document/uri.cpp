#include "tools/gltf/document/uri.h"

#include <array>
#include <cctype>
#include <cerrno>
#include <cstdint>
#include <cstdlib>
#include <cstring>
#include <memory>

#include "format/fail.h"
#include "format/text.h"

namespace scree::convert {
namespace {

int hex_digit(char c) {
  if (c >= '0' && c <= '9') return c - '0';
  if (c >= 'a' && c <= 'f') return c - 'a' + 10;
  if (c >= 'A' && c <= 'F') return c - 'A' + 10;
  return -1;
}

// An excerpt for a message. URIs can be long and can hold any character.
std::string quoted(std::string_view text) {
  std::string out = "\"";
  for (const char c : text.substr(0, 80)) out += static_cast<unsigned char>(c) < 0x20 || c == 0x7f ? '?' : c;
  return out + (text.size() > 80 ? "...\"" : "\"");
}

Result<std::string> percent_decoded(std::string_view text) {
  std::string out;
  out.reserve(text.size());
  for (size_t i = 0; i < text.size(); ++i) {
    if (text[i] != '%') {
      out += text[i];
      continue;
    }
    const int high = i + 2 < text.size() ? hex_digit(text[i + 1]) : -1;
    const int low = i + 2 < text.size() ? hex_digit(text[i + 2]) : -1;
    if (high < 0 || low < 0) return Error{ErrorCode::kFormat, "URI " + quoted(text) + ": bad percent coding"};
    out += static_cast<char>(high * 16 + low);
    i += 2;
  }
  return out;
}

constexpr std::array<int8_t, 256> make_base64_table() {
  std::array<int8_t, 256> table{};
  for (auto& entry : table) entry = -1;
  constexpr std::string_view kDigits = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  for (size_t i = 0; i < kDigits.size(); ++i) table[static_cast<unsigned char>(kDigits[i])] = static_cast<int8_t>(i);
  table['-'] = 62;  // the URL-safe alphabet (RFC 4648 5), which some writers use
  table['_'] = 63;
  return table;
}

Result<std::vector<std::byte>> decode_base64(std::string_view text) {
  static constexpr auto kTable = make_base64_table();
  size_t padding = 0;
  while (!text.empty() && text.back() == '=' && padding < 2) {
    text.remove_suffix(1);
    ++padding;
  }
  if (text.size() % 4 == 1 || (padding > 0 && (text.size() + padding) % 4 != 0))
    return fail(ErrorCode::kFormat, "data: URI: base64 of ", text.size() + padding, " digits");
  std::vector<std::byte> out;
  out.reserve(text.size() / 4 * 3 + 2);
  uint32_t bits = 0;
  for (size_t i = 0; i < text.size(); ++i) {
    const int digit = kTable[static_cast<unsigned char>(text[i])];
    if (digit < 0) return fail(ErrorCode::kFormat, "data: URI: not a base64 digit at character ", i);
    bits = (bits << 6) | static_cast<uint32_t>(digit);
    if (i % 4 == 3) {
      out.push_back(static_cast<std::byte>(bits >> 16));
      out.push_back(static_cast<std::byte>(bits >> 8));
      out.push_back(static_cast<std::byte>(bits));
    }
  }
  if (text.size() % 4 == 2) {
    out.push_back(static_cast<std::byte>(bits >> 4));
  } else if (text.size() % 4 == 3) {
    out.push_back(static_cast<std::byte>(bits >> 10));
    out.push_back(static_cast<std::byte>(bits >> 2));
  }
  return out;
}

// The scheme of an absolute URI ("http" of "http://x"), empty for a relative path. A colon after the first slash is
// part of a file name (RFC 3986 4.2).
std::string_view scheme_of(std::string_view uri) {
  size_t i = 0;
  while (i < uri.size() &&
         (std::isalnum(static_cast<unsigned char>(uri[i])) != 0 || uri[i] == '+' || uri[i] == '-' || uri[i] == '.'))
    ++i;
  const bool is_scheme =
      i > 0 && i < uri.size() && uri[i] == ':' && std::isalpha(static_cast<unsigned char>(uri[0])) != 0;
  return is_scheme ? uri.substr(0, i) : std::string_view{};
}

// Whether a path with steps such as "a/../b" ever climbs above its start.
bool climbs_out(std::string_view path) {
  int64_t depth = 0;
  while (!path.empty()) {
    const size_t slash = path.find('/');
    const std::string_view step = path.substr(0, slash);
    if (step == "..") {
      if (--depth < 0) return true;
    } else if (!step.empty() && step != ".") {
      ++depth;
    }
    if (slash == std::string_view::npos) break;
    path.remove_prefix(slash + 1);
  }
  return false;
}

struct FreeDeleter {
  void operator()(char* text) const { std::free(text); }
};

}  // namespace

bool is_data_uri(std::string_view uri) {
  constexpr std::string_view kScheme = "data:";
  return format::lower_case(uri.substr(0, kScheme.size())) == kScheme;
}

Result<std::vector<std::byte>> decode_data_uri(std::string_view uri) {
  const size_t comma = uri.find(',');
  if (!is_data_uri(uri) || comma == std::string_view::npos)
    return Error{ErrorCode::kFormat, "data: URI without a comma: " + quoted(uri)};
  const std::string_view head = uri.substr(0, comma);
  std::string_view body = uri.substr(comma + 1);
  constexpr std::string_view kBase64 = ";base64";
  // RFC 2397 writes the mark in lower case, but its grammar (RFC 822) ignores case.
  const bool base64 =
      head.size() >= kBase64.size() && format::lower_case(head.substr(head.size() - kBase64.size())) == kBase64;
  std::string decoded;
  if (!base64 || body.find('%') != std::string_view::npos) {
    decoded = SCREE_TRY(percent_decoded(body));
    body = decoded;
  }
  if (base64) return decode_base64(body);
  std::vector<std::byte> bytes(body.size());
  if (!bytes.empty()) std::memcpy(bytes.data(), body.data(), body.size());
  return bytes;
}

Result<std::string> resolve_uri(const std::string& folder, std::string_view uri, bool allow_outside) {
  if (!scheme_of(uri).empty()) {
    return Error{ErrorCode::kUnsupported, "URI " + quoted(uri) + ": scheme \"" +
                                              std::string(scheme_of(uri).substr(0, 20)) +
                                              ":\" is not read, only files in the scene's folder and data:"};
  }
  auto decoded = SCREE_TRY(percent_decoded(uri));
  const std::string& relative = decoded;
  if (relative.empty()) return Error{ErrorCode::kFormat, "URI is empty"};
  if (relative.find('\0') != std::string::npos)
    return Error{ErrorCode::kFormat, "URI " + quoted(uri) + ": holds a zero byte"};
  if (relative.front() == '/' || relative.front() == '\\')
    return Error{ErrorCode::kUnsupported,
                 "URI " + quoted(uri) + ": an absolute path, expected one in the scene's folder"};
  const std::string outside = "URI " + quoted(uri) + ": leaves the scene's folder";
  constexpr const char* kAdvice = "; --allow-outside reads it";
  if (!allow_outside && climbs_out(relative)) return Error{ErrorCode::kUnsupported, outside + kAdvice};

  const std::string path = folder + "/" + relative;
  const std::unique_ptr<char, FreeDeleter> real_folder(::realpath(folder.c_str(), nullptr));
  if (!real_folder) return Error{ErrorCode::kFile, folder + ": " + std::strerror(errno)};
  const std::unique_ptr<char, FreeDeleter> real_path(::realpath(path.c_str(), nullptr));
  if (!real_path) return Error{ErrorCode::kFile, path + ": " + std::strerror(errno)};
  if (allow_outside) return std::string(real_path.get());
  std::string inside = real_folder.get();
  if (inside.back() != '/') inside += '/';
  const std::string resolved = real_path.get();
  if (resolved.compare(0, inside.size(), inside) != 0)
    return Error{ErrorCode::kUnsupported, outside + " by way of a symbolic link" + kAdvice};
  return resolved;
}

}  // namespace scree::convert
