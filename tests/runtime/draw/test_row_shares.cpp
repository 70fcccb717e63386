// Rows of a picture are divided among GPUs: all rows, in order, in whole pixels, and in the end with equal times.
#include "runtime/draw/row_shares.h"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <random>
#include <vector>

#include "tests/catch.h"

using scree::kernels::RowRange;
using scree::runtime::RowShares;

namespace {

/// The time of rows whose cost is concentrated around one row, plus a constant cost of each share.
float ms_of(const RowRange& rows, double middle) {
  double ms = 0.2;
  for (uint32_t row = rows.first; row < rows.end; ++row)
    ms += 0.006 * std::exp(-std::pow((static_cast<double>(row) - middle) / 300, 2));
  return static_cast<float>(ms);
}

}  // namespace

TEST_CASE("shares of rows cover the picture in order", "[gpus]") {
  for (const uint32_t count : {1u, 2u, 3u, 16u}) {
    RowShares shares;
    std::vector<float> ms(count);
    for (const uint32_t height : {1u, 3u, 4u, 5u, 9u, 64u, 77u, 77u, 2160u, 2160u, 2160u, 16384u, 16384u}) {
      CAPTURE(count, height);
      shares.divide(height, ms);
      uint32_t next = 0;
      for (uint32_t i = 0; i < count; ++i) {
        const RowRange rows = shares.rows(i);
        REQUIRE(rows.first == next);
        REQUIRE(rows.end >= rows.first);
        CHECK((rows.end % RowShares::kStep == 0 || rows.end == height));
        CHECK(rows.is_empty() == (i >= (height + RowShares::kStep - 1) / RowShares::kStep));
        next = rows.end;
        ms[i] = i % 3 == 0 ? 0.0f : 1e6f;  // the first frame has no times, and a share may have stopped for seconds
      }
      CHECK(next == height);
    }
  }
}

TEST_CASE("shares of rows take equally long in the end, also with a moving camera", "[gpus]") {
  for (const uint32_t count : {2u, 4u}) {
    RowShares shares;
    std::vector<float> ms(count);
    std::vector<RowRange> before(count);
    uint32_t pictures = 0;  // number of pictures with the same rows
    for (uint32_t frame = 0; frame < 300; ++frame) {
      CAPTURE(count, frame);
      shares.divide(2160, ms);
      bool moved = false;
      for (uint32_t i = 0; i < count; ++i) {
        const RowRange rows = shares.rows(i);
        moved = moved || rows.first != before[i].first || rows.end != before[i].end;
        ms[i] = ms_of(rows, frame < 150 ? 700 : 700 + 2 * (frame - 150));
      }
      const float most = *std::max_element(ms.begin(), ms.end());
      const float mean = std::accumulate(ms.begin(), ms.end(), 0.0f) / static_cast<float>(count);
      if (frame == 0) CHECK(most > 1.3f * mean);
      if (frame >= 60) CHECK(most < (frame < 150 ? 1.05f : 1.6f) * mean);
      if (moved && frame > 0) CHECK(pictures >= RowShares::kSettled);
      pictures = moved ? 1 : pictures + 1;
      // New rows take much longer at first. That alone must not move them back.
      for (uint32_t i = 0; i < count; ++i) {
        if (pictures < RowShares::kSettled && i % 2 == 0) ms[i] *= 5;
        before[i] = shares.rows(i);
      }
    }
  }
}

TEST_CASE("rows stay where they are while times differ little", "[gpus]") {
  RowShares shares;
  std::vector<float> ms(2);
  for (int frame = 0; frame < 50; ++frame) {
    shares.divide(1080, ms);
    CHECK(shares.rows(0).end == 540);
    ms = {1.0f, frame % 2 == 0 ? 1.03f : 0.97f};
  }
  ms = {1.0f, 1.1f};
  for (int frame = 0; frame < 6; ++frame) shares.divide(1080, ms);
  CHECK(shares.rows(0).end > 540);
}

TEST_CASE("a small difference between shares of rows is found in times that vary", "[gpus]") {
  std::mt19937 random(7);
  std::normal_distribution<float> noise(1.0f, 0.02f);
  RowShares shares;
  std::vector<float> ms(2);
  uint32_t moves = 0;
  double excess = 0;
  constexpr uint32_t kHeight = 2160, kFrames = 400, kLast = 200;
  for (uint32_t frame = 0; frame < kFrames; ++frame) {
    const uint32_t before = frame == 0 ? 0 : shares.rows(0).end;
    shares.divide(kHeight, ms);
    moves += before != shares.rows(0).end ? 1 : 0;
    // The second share's rows take 3% longer.
    const double real[2] = {1.0 * shares.rows(0).end, 1.03 * (kHeight - shares.rows(0).end)};
    for (size_t i = 0; i < 2; ++i) ms[i] = static_cast<float>(real[i]) * noise(random);
    if (frame >= kFrames - kLast) excess += 2 * std::max(real[0], real[1]) / (real[0] + real[1]) - 1;
  }
  CHECK(excess / kLast < 0.005);
  CHECK(moves < 8);
}
