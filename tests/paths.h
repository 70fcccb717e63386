// Where the programs and the files of the tests are. Known to one source file only: whoever builds in another folder
// compiles that one anew, and not all tests.
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
extern const char* const kModelsFolder;     // real models and measured scenes, where they are: SCREE_MODELS_DIR

}  // namespace scree::tests
