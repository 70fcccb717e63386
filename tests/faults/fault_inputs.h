// What scree_faults is run on, for the tests.
#pragma once

#include <string>

#include "tests/tools/temp_folder.h"

namespace scree::tests {

/// A scene of a .gltf, its .bin and its images, two that are sorted, and what the program made of the first: the inputs
/// of all commands.
class FaultInputs {
 public:
  FaultInputs();

  /// many.scree and many_packed.scree, of many chunks round the origin, for what streams them.
  void add_many();

  /// shuffled.scree and shuffled_packed.scree, whose pages take more than a block.
  void add_shuffled();

  /// giant.gltf and lying.gltf, whose only primitive is encoded while it is measured; what the second states of it
  /// proves wrong when four windows are measured, and a page of them is in the file.
  void add_giant();

  /// Runs scree_faults; fails the test with what it says where something is wrong. `options`: in front of all.
  void check(const std::string& kind, const std::string& which, const std::string& outputs, const std::string& command,
             const std::string& options = "");

  const TempFolder& folder() const { return folder_; }

 private:
  void make(const std::string& command);

  TempFolder folder_;
};

}  // namespace scree::tests
