// Inputs of scree_faults, for the tests.
#pragma once

#include <cstdint>
#include <string>

#include "tests/tools/temp_folder.h"

namespace scree::tests {

/// The inputs of all commands: a scene as .gltf with its .bin and its images, two scenes that are sorted, and the
/// program's output for the first scene.
class FaultInputs {
 public:
  FaultInputs();

  /// Adds many.scree and many_packed.scree, which have many chunks around the origin, for streaming.
  /// `scale`: factor of the columns and rows of triangles per chunk.
  void add_many(uint32_t scale = 1);

  /// Adds shuffled.scree and shuffled_packed.scree, whose pages take more than one block.
  void add_shuffled();

  /// Adds giant.gltf and lying.gltf, whose only primitive is encoded while it is measured. The second one's box turns
  /// out to be wrong when four windows are measured and one of their pages is in the file.
  void add_giant();

  /// Runs scree_faults. If it finds an error, the test fails with its output. `options`: placed before all other
  /// arguments.
  void check(const std::string& kind, const std::string& which, const std::string& outputs, const std::string& command,
             const std::string& options = "");

  const TempFolder& folder() const { return folder_; }

 private:
  void make(const std::string& command);

  TempFolder folder_;
};

}  // namespace scree::tests
