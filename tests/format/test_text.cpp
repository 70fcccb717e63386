#include "format/text.h"

#include "tests/results.h"

using scree::format::in_brackets;

TEST_CASE("long names are cut between characters", "[text]") {
  CHECK(in_brackets("").empty());
  CHECK(in_brackets("moss") == " (moss)");
  CHECK(in_brackets(std::string(100, 'a')) == " (" + std::string(100, 'a') + ")");
  CHECK(in_brackets(std::string(101, 'a')) == " (" + std::string(100, 'a') + "...)");
  CHECK(in_brackets(std::string(99, 'a') + "\u00e9tude") == " (" + std::string(99, 'a') + "...)");
}
