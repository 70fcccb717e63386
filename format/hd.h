// Marks code that runs on the CPU and inside CUDA kernels.
#pragma once

#if defined(__CUDACC__)
#define SCREE_HD __host__ __device__
#else
#define SCREE_HD
#endif
