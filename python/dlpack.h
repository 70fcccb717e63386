// The structures of DLPack that capsules hold (versions 0.8 and 1.0, dlpack.h).
#ifndef SCREE_PYTHON_DLPACK_H
#define SCREE_PYTHON_DLPACK_H

#include <cstdint>

namespace scree_python {

struct DlDevice {
  int32_t type;
  int32_t index;
};
constexpr int32_t kDlCpu = 1;
constexpr int32_t kDlCuda = 2;
constexpr int32_t kDlCudaHost = 3;  // pinned
constexpr int32_t kDlCudaManaged = 13;

struct DlDataType {
  uint8_t code;  // 0: int, 1: unsigned int, 2: float
  uint8_t bits;
  uint16_t lanes;
};

struct DlTensor {
  void* data;
  DlDevice device;
  int32_t dimensions;
  DlDataType type;
  int64_t* shape;
  int64_t* strides;  // in elements; null: rows follow each other without gaps
  uint64_t byte_offset;
};

/// The contents of a capsule "dltensor".
struct DlManagedTensor {
  DlTensor tensor;
  void* context;
  void (*deleter)(DlManagedTensor*);
};

/// The contents of a capsule "dltensor_versioned".
struct DlVersionedTensor {
  uint32_t major;
  uint32_t minor;
  void* context;
  void (*deleter)(DlVersionedTensor*);
  uint64_t flags;
  DlTensor tensor;
};
constexpr uint64_t kDlReadOnly = 1;  // a bit of `flags`

}  // namespace scree_python

#endif
