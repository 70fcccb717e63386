// Reads the worked examples of spec/vectors (spec/codecs.md, worked examples).
#pragma once

#include <cstddef>
#include <cstdlib>
#include <fstream>
#include <map>
#include <sstream>
#include <string>
#include <vector>

#include "tests/catch.h"
#include "tests/paths.h"

namespace scree::tests {

/// One example: "key: value" lines up to an empty line.
class SpecVector {
 public:
  void set(const std::string& key, const std::string& value) { fields_[key] = value; }
  bool empty() const { return fields_.empty(); }
  bool has(const std::string& key) const { return fields_.count(key) != 0; }

  std::string text(const std::string& key) const {
    const auto field = fields_.find(key);
    if (field == fields_.end()) FAIL("the vector has no " << key);
    return field->second;
  }
  template <class Integer>
  std::vector<Integer> integers(const std::string& key) const {
    std::vector<Integer> values;
    for (const std::string& word : words(key)) {
      values.push_back(word[0] == '-' ? static_cast<Integer>(std::strtoll(word.c_str(), nullptr, 10))
                                      : static_cast<Integer>(std::strtoull(word.c_str(), nullptr, 10)));
    }
    return values;
  }
  template <class Integer>
  Integer integer(const std::string& key) const {
    const auto values = integers<Integer>(key);
    REQUIRE(values.size() == 1);
    return values[0];
  }
  std::vector<float> floats(const std::string& key) const {
    std::vector<float> values;
    for (const std::string& word : words(key)) values.push_back(std::strtof(word.c_str(), nullptr));
    return values;
  }
  double number(const std::string& key) const { return std::strtod(text(key).c_str(), nullptr); }
  std::vector<std::byte> bytes(const std::string& key) const {
    std::vector<std::byte> values;
    for (const std::string& word : words(key))
      values.push_back(static_cast<std::byte>(std::strtoul(word.c_str(), nullptr, 16)));
    return values;
  }

  std::vector<std::string> words(const std::string& key) const {
    std::istringstream stream(text(key));
    std::vector<std::string> found;
    for (std::string word; stream >> word;) found.push_back(word);
    return found;
  }

 private:
  std::map<std::string, std::string> fields_;
};

/// The examples of a file of spec/vectors. Fails the test if there are none.
inline std::vector<SpecVector> spec_vectors(const std::string& file) {
  std::ifstream stream(std::string(tests::kVectorsFolder) + "/" + file);
  std::vector<SpecVector> vectors;
  SpecVector current;
  const auto finish = [&] {
    if (!current.empty()) vectors.push_back(current);
    current = {};
  };
  for (std::string line; std::getline(stream, line);) {
    if (line.empty()) finish();
    if (line.empty() || line[0] == '#') continue;
    const size_t colon = line.find(':');
    if (colon == std::string::npos) FAIL(file << ": no key in: " << line);
    current.set(line.substr(0, colon), colon + 2 <= line.size() ? line.substr(colon + 2) : std::string());
  }
  finish();
  REQUIRE(vectors.size() > 0);
  return vectors;
}

}  // namespace scree::tests
