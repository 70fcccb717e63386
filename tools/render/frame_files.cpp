#include "tools/render/frame_files.h"

#include <algorithm>
#include <filesystem>
#include <fstream>

namespace scree::tools {
namespace {

using runtime::Layer;

/// The first bytes of a frame of this size: of a PFM, or of a PNG.
std::string beginning(Layer layer, const FrameSize& size) {
  if (layer == Layer::kDepth)
    return "Pf\n" + std::to_string(size.width) + " " + std::to_string(size.height) + "\n-1.0\n";
  std::string begin("\x89PNG\r\n\x1a\n\0\0\0\rIHDR", 16);
  for (const uint32_t side : {size.width, size.height})
    for (int shift = 24; shift >= 0; shift -= 8) begin += static_cast<char>(side >> shift & 0xff);
  return begin;
}

}  // namespace

Result<bool> has_whole_frame(Layer layer, const std::string& name, const FrameSize& size) {
  std::error_code failed;
  const uint64_t bytes = std::filesystem::file_size(name, failed);
  if (failed) return false;
  if (layer == Layer::kSamples) {  // without a header
    if (bytes == 0 || bytes == size.samples() * sizeof(uint64_t)) return bytes != 0;
    return Error{ErrorCode::kFile, name + ": is no visibility buffer of this size; --resume does not replace it"};
  }
  const std::string begin = beginning(layer, size);
  std::string head(begin.size(), '\0'), tail(12, '\0');
  std::ifstream file(name, std::ios::binary);
  file.read(head.data(), static_cast<std::streamsize>(head.size()));
  head.resize(static_cast<size_t>(file.gcount()));
  if (head.empty() || head[0] == 0) return false;
  const auto has = [&](size_t count) { return head.substr(0, count) == begin.substr(0, std::min(count, head.size())); };
  if (!has(layer == Layer::kDepth ? 3 : 8))  // "Pf", or the signature of a PNG
    return Error{ErrorCode::kFile, name + ": is no frame; --resume does not replace it"};
  if (!has(begin.size()))
    return Error{ErrorCode::kFile, name + ": is a frame of another size; --resume does not replace it"};
  if (layer == Layer::kDepth) return bytes == begin.size() + size.pixels() * sizeof(float);
  if (bytes < 45 || !file.seekg(-12, std::ios::end) || !file.read(tail.data(), 12)) return false;
  return tail == std::string("\0\0\0\0IEND\xae\x42\x60\x82", 12);
}

}  // namespace scree::tools
