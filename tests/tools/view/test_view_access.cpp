#include "tools/view/access.h"

#include <set>
#include <string>

#include "tests/results.h"

using namespace scree::tools::view;

TEST_CASE("tokens are random, and all characters are compared", "[view][view-access]") {
  std::set<std::string> tokens;
  for (int i = 0; i < 100; ++i) {
    const auto token = must(make_token());
    CHECK(token.size() == 32);
    CHECK(token.find_first_not_of("0123456789abcdef") == std::string::npos);
    tokens.insert(token);
  }
  CHECK(tokens.size() == 100);
  CHECK(is_same_token("abc", "abc"));
  CHECK_FALSE(is_same_token("abc", "abd"));
  CHECK_FALSE(is_same_token("abc", "ab"));
  CHECK_FALSE(is_same_token("abc", ""));
}

TEST_CASE("a host is the text before the port", "[view][view-access]") {
  CHECK(host_of("127.0.0.1") == "127.0.0.1");
  CHECK(host_of("LocalHost:8080") == "localhost");
  CHECK(host_of("[::1]:80") == "[::1]");
  CHECK(host_of("[::1]") == "[::1]");
  for (const char* bad :
       {"", "[::1", "a:b", "a:", "a:1234567", "a b", "a/b", "a@b", "a:80:80", "[::1]80", "user@127.0.0.1"})
    CHECK(host_of(bad).empty());
}

TEST_CASE("an address has one spelling", "[view][view-access]") {
  using scree::tools::view::address_of;
  CHECK(*address_of("127.0.0.1") == "127.0.0.1");
  CHECK(*address_of("LOCALHOST") == "127.0.0.1");
  CHECK(*address_of("0::0") == "::");
  CHECK(*address_of("0:0:0:0:0:0:0:1") == "::1");
  CHECK(*address_of("::ffff:127.0.0.1") == "127.0.0.1");
  for (const char* bad : {"", "example.com", "256.0.0.1", "[::1]", "127.0.0.1:80"})
    CHECK(address_of(bad).error().message == "--host: '" + std::string(bad) + "' is not an address such as 127.0.0.1");
}

TEST_CASE("hosts and origins are admitted by name", "[view][view-access]") {
  const AccessList local("127.0.0.1", {});
  CHECK(local.allows_host("127.0.0.1:8080"));
  CHECK(local.allows_host("localhost"));
  CHECK_FALSE(local.allows_host("192.168.1.5:8080"));
  CHECK_FALSE(local.allows_host(""));
  CHECK(local.allows_origin("http://127.0.0.1:8080", "127.0.0.1:8080"));
  CHECK(local.allows_origin("http://LOCALHOST:8080", "localhost:8080"));
  CHECK_FALSE(local.allows_origin("http://127.0.0.1:3000", "127.0.0.1:8080"));
  CHECK_FALSE(local.allows_origin("http://localhost:8080", "127.0.0.1:8080"));
  CHECK_FALSE(local.allows_origin("http://evil.example", "evil.example"));
  CHECK_FALSE(local.allows_origin("http://127.0.0.1:8080/", "127.0.0.1:8080"));
  CHECK_FALSE(local.allows_origin("file://", "127.0.0.1:8080"));
  CHECK_FALSE(local.allows_origin("ftp://127.0.0.1:8080", "127.0.0.1:8080"));
  CHECK_FALSE(local.allows_origin("", ""));
  const AccessList proxied("127.0.0.1", {"View.example"});
  CHECK(proxied.allows_host("view.example"));
  CHECK(proxied.allows_origin("https://view.example", "127.0.0.1:8080"));
  CHECK_FALSE(proxied.allows_origin("https://x.view.example", "127.0.0.1:8080"));
  const AccessList lan("192.168.1.5", {});
  CHECK(lan.allows_host("192.168.1.5:8080"));
  CHECK(AccessList("::", {}).allows_host("localhost"));
}

TEST_CASE("a base path is removed completely or not at all", "[view][view-access]") {
  CHECK(*parse_base_path("") == "");
  CHECK(*parse_base_path("/") == "");
  CHECK(*parse_base_path("a/b/") == "/a/b");
  CHECK_FALSE(parse_base_path("/a/../b"));
  CHECK_FALSE(parse_base_path("/a?b"));
  CHECK(path_below("/main.js?x=1", "") == "/main.js");
  CHECK(path_below("/a/main.js", "/a") == "/main.js");
  CHECK(path_below("/a/", "/a") == "/");
  CHECK(path_below("/a", "/a").empty());
  CHECK(path_below("/ab/main.js", "/a") == "/ab/main.js");
}
