// Paths of the programs and files of the tests. Only one source file defines them, so that a build in another folder
// recompiles that file alone.
#pragma once

namespace scree::tests {

extern const char* const kProgram;          // scree
extern const char* const kLabProgram;       // scree-lab
extern const char* const kFaultsProgram;    // scree_faults
extern const char* const kDataFolder;       // tests/data
extern const char* const kValidatorFolder;  // tests/validator
extern const char* const kViewPageFolder;   // tests/view
extern const char* const kCliFolder;        // tests/cli
extern const char* const kCorpusFolder;     // tests/fuzz/corpus
extern const char* const kVectorsFolder;    // spec/vectors
extern const char* const kModelsFolder;     // real models and measured scenes, if available: SCREE_MODELS_DIR

}  // namespace scree::tests
