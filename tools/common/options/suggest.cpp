#include "tools/common/options/suggest.h"

#include <algorithm>
#include <numeric>
#include <string_view>
#include <vector>

namespace scree::tools {
namespace {

size_t edit_distance(std::string_view a, std::string_view b) {
  std::vector<size_t> row(b.size() + 1);
  std::iota(row.begin(), row.end(), size_t{0});
  for (size_t i = 0; i < a.size(); ++i) {
    size_t diagonal = row[0];
    row[0] = i + 1;
    for (size_t j = 0; j < b.size(); ++j) {
      const size_t substitute = diagonal + (a[i] != b[j]);
      diagonal = row[j + 1];
      row[j + 1] = std::min({row[j] + 1, row[j + 1] + 1, substitute});
    }
  }
  return row.back();
}

std::vector<std::string> known_words(const CLI::App& app, bool options) {
  std::vector<std::string> words;
  if (options) {
    for (const CLI::Option* option : app.get_options())
      for (const std::string& name : option->get_lnames()) words.push_back("--" + name);
  } else {
    for (const CLI::App* sub : app.get_subcommands([](const CLI::App*) { return true; }))
      words.push_back(sub->get_name());
  }
  return words;
}

/// The error's text. Replaces CLI11's words for a missing value ("NAME: 1 required TYPE missing") and for an option
/// that is given twice ("NAME: At Most 1 required but received 2").
std::string text_of(const CLI::ParseError& error) {
  constexpr std::string_view kMissing = ": 1 required ", kTwice = ": At Most 1 required but received ";
  const std::string text = error.what();
  if (const size_t end = text.find(kTwice); end != std::string::npos)
    return text.substr(0, end) + ": given " + text.substr(end + kTwice.size()) + " times, expected once";
  const size_t end = text.find(kMissing), rest = text.rfind(" missing");
  if (end == std::string::npos || rest == std::string::npos) return text;
  const size_t type = end + kMissing.size();
  return text.substr(0, end) + ": no value, expected " + text.substr(type, rest - type);
}

}  // namespace

std::string describe_parse_error(const CLI::App& app, const CLI::ParseError& error) {
  std::string unknown;
  for (const std::string& word : app.remaining())
    if (unknown.empty() || (word.starts_with("--") && !unknown.starts_with("--"))) unknown = word;
  if (unknown.empty()) return text_of(error);
  const bool is_option = unknown.starts_with("-");
  unknown = unknown.substr(0, unknown.find('='));
  std::string message = (is_option ? "unknown option " : "unknown argument ") + unknown;
  std::string nearest;
  size_t nearest_distance = std::max<size_t>(2, unknown.size() / 3) + 1;
  for (const std::string& word : known_words(app, is_option)) {
    const size_t distance = edit_distance(unknown, word);
    if (distance < nearest_distance) {
      nearest_distance = distance;
      nearest = word;
    }
  }
  if (!nearest.empty()) message += "; did you mean " + nearest + "?";
  return message;
}

}  // namespace scree::tools
