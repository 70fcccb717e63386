// Commands of scree_faults beside scree's own, for code that no command runs, or only slow ones.
#pragma once

namespace scree::faults {

/// The command named by argv[1]; null if it is one of scree's. It prints and returns the same as scree would. Paths are
/// in the current folder.
///
/// scree stream FILE PART THREADS OUTPUT.bin OUTPUT.png: draws frames of a scene around the origin on the CPU, from a
/// pool that holds one PART-th of its chunks and one chunk more. Writes the samples and the picture of the last frame.
///
/// scree upload FILE READING THREADS OUTPUT: uploads a scene's pages to a device of host memory, with a READING of
/// mapped, buffered or direct. Writes the uploaded bytes.
///
/// scree sort FILE VERTICES THREADS OUTPUT: sorts the first primitive of a glTF scene as convert does, with the new
/// numbers of that many vertices in memory at a time. Writes the copy.
using Main = int (*)(int argc, char** argv);
Main own_command(const char* name);

}  // namespace scree::faults
