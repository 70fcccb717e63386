// Marks code that runs on the CPU and inside CUDA kernels.
#pragma once

#if defined(__CUDACC__)
#define SCREE_HD __host__ __device__
#else
#define SCREE_HD
#endif

// kernels/cpu/passes.cpp is compiled once per instruction set. Its definitions lie in a namespace of that set, so that
// the linker never uses an inline function built for AVX2 in the baseline code.
#ifndef SCREE_ISA
#define SCREE_ISA isa_baseline
#endif
