// Commands of scree_faults for code that none of scree's commands runs, or only slow ones.
#pragma once

namespace scree::faults {

/// The command with the name argv[1]; null for scree's own commands. It prints and returns as scree would. Paths are
/// relative to the current folder.
///
/// scree stream FILE PART THREADS OUTPUT.bin OUTPUT.png: draws frames of a scene around the origin on the CPU, from a
/// pool that holds 1 / PART of its chunks and one chunk more. Writes the samples and the picture of the last frame.
///
/// scree upload FILE READING THREADS OUTPUT: uploads a scene's pages to a device of host memory. READING is mapped,
/// buffered or direct. Writes the uploaded bytes.
///
/// scree sort FILE VERTICES THREADS OUTPUT: sorts the first primitive of a glTF scene as convert does, with the new
/// numbers of VERTICES vertices in memory at a time. Writes the copy.
using Main = int (*)(int argc, char** argv);
Main own_command(const char* name);

}  // namespace scree::faults
