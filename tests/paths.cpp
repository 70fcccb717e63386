#include "tests/paths.h"

namespace scree::tests {

const char* const kProgram = SCREE_PROGRAM;
const char* const kLabProgram = SCREE_LAB_PROGRAM;
const char* const kFaultsProgram = SCREE_FAULTS_PROGRAM;
const char* const kDataFolder = SCREE_TESTS_DIR "/data";
const char* const kValidatorFolder = SCREE_TESTS_DIR "/validator";
const char* const kViewPageFolder = SCREE_TESTS_DIR "/view";
const char* const kCliFolder = SCREE_TESTS_DIR "/cli";
const char* const kCorpusFolder = SCREE_TESTS_DIR "/fuzz/corpus";
const char* const kVectorsFolder = SCREE_TESTS_DIR "/../spec/vectors";
const char* const kModelsFolder = SCREE_MODELS;

}  // namespace scree::tests
