// Commands that scree_faults has beside those of scree: what no command reaches, or none that is quick.
#pragma once

namespace scree::faults {

/// The command that argv[1] names; null where it is one of scree's. Says and returns what scree would. Paths are in the
/// current folder.
///
/// scree stream FILE PART THREADS OUTPUT.bin OUTPUT.png: draws frames of a scene round the origin on the CPU out of a
/// pool that holds a PART-th of its chunks, and one chunk more; writes the samples and the picture of the last.
///
/// scree upload FILE READING THREADS OUTPUT: brings a scene's pages to a device of host memory, read as READING says
/// (mapped, buffered or direct); writes what arrived.
///
/// scree sort FILE VERTICES THREADS OUTPUT: sorts the first primitive of a glTF scene as convert does, with the new
/// numbers of so many vertices in memory at a time; writes the copy.
using Main = int (*)(int argc, char** argv);
Main own_command(const char* name);

}  // namespace scree::faults
