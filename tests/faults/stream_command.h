// A command that scree_faults has beside those of scree.
#pragma once

namespace scree::faults {

/// scree stream FILE PART THREADS OUTPUT.bin OUTPUT.png: draws frames of a scene round the origin on the CPU out of a
/// pool that holds a PART-th of its chunks, and one chunk more; writes the samples and the picture of the last. Says
/// and returns what scree would.
int stream_main(int argc, char** argv);

}  // namespace scree::faults
