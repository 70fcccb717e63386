#include "tools/render/path_frames.h"

#include <algorithm>
#include <charconv>
#include <optional>

#include "tools/render/camera_path.h"

namespace scree::tools {
namespace {

/// `text` as a number in [0, kMaxPathFrames].
std::optional<uint64_t> frame_count(std::string_view text) {
  uint64_t value = 0;
  const auto [rest, status] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (status != std::errc{} || rest != text.data() + text.size() || value > kMaxPathFrames) return std::nullopt;
  return value;
}

bool parse_ends(std::string_view text, size_t colon, FrameRange& range) {
  const auto first = frame_count(text.substr(0, colon)), end = frame_count(text.substr(colon + 1));
  if (!first || !end || *first >= *end) return false;
  range.first = *first;
  range.end = *end;
  return true;
}

bool parse_share(std::string_view text, size_t slash, FrameRange& range) {
  const auto part = frame_count(text.substr(0, slash)), parts = frame_count(text.substr(slash + 1));
  if (!part || !parts || *part == 0 || *part > *parts) return false;
  range.part = *part - 1;
  range.parts = *parts;
  return true;
}

}  // namespace

uint32_t rank_of_frame(uint64_t index, uint64_t frames, uint64_t ranks) {
  constexpr uint64_t kRun = 8, kMostRounds = 1024;
  uint64_t rounds = std::clamp<uint64_t>(frames / (kRun * ranks), 1, kMostRounds);
  if (rounds > 1) rounds -= rounds % 2;  // as many in each order
  const uint64_t run = index * rounds * ranks / frames, rank = run % ranks;
  return static_cast<uint32_t>(run / ranks % 2 == 0 ? rank : ranks - 1 - rank);
}

Result<FrameRange> parse_frame_range(std::string_view text) {
  FrameRange range;
  const size_t comma = text.find(',');
  const std::string_view ends = text.substr(0, comma);
  bool is_good = true;
  if (const size_t colon = ends.find(':'); colon != std::string_view::npos) {
    is_good = parse_ends(ends, colon, range);
    if (comma != std::string_view::npos) {
      const std::string_view share = text.substr(comma + 1);
      const size_t slash = share.find('/');
      is_good = is_good && slash != std::string_view::npos && parse_share(share, slash, range);
    }
  } else {
    const size_t slash = text.find('/');
    is_good = slash != std::string_view::npos && parse_share(text, slash, range);
  }
  if (is_good) return range;
  return Error{ErrorCode::kUsage, "--frames: '" + std::string(text) +
                                      "' is not FIRST:END, such as 0:600 for frames 0 to 599, nor I/N, share I of N "
                                      "counted from 1, nor both, such as 0:600,1/8"};
}

Result<FramePattern> FramePattern::parse(std::string_view option, const std::string& text) {
  const Error wrong{ErrorCode::kUsage, std::string(option) + ": '" + text +
                                           "' does not have exactly one frame number, such as %d or %05d in "
                                           "frame_%05d.png (1 to 19 digits; %% is a %)"};
  FramePattern pattern;
  bool has_number = false;
  for (size_t i = 0; i < text.size(); ++i) {
    std::string& part = has_number ? pattern.after_ : pattern.before_;
    if (text[i] != '%') {
      part += text[i];
      continue;
    }
    const std::string_view rest = std::string_view(text).substr(i + 1);
    if (rest.starts_with('%')) {
      part += '%';
      ++i;
      continue;
    }
    const size_t end = rest.find('d');
    if (has_number || end == std::string_view::npos) return wrong;
    if (end > 0) {
      const auto digits = frame_count(rest.substr(1, end - 1));
      if (rest[0] != '0' || !digits || *digits == 0 || *digits > 19) return wrong;
      pattern.digits_ = *digits;
    }
    has_number = true;
    i += end + 1;
  }
  if (!has_number) return wrong;
  return pattern;
}

std::string FramePattern::name(uint64_t frame) const {
  const std::string number = std::to_string(frame);
  return before_ + std::string(digits_ - std::min(digits_, number.size()), '0') + number + after_;
}

}  // namespace scree::tools
