#include "tools/render/camera_path.h"

#include <algorithm>
#include <atomic>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "tests/results.h"
#include "tools/render/path_frames.h"
#include "tools/render/shared_frames.h"

using scree::ErrorCode;
using scree::Result;
using namespace scree::tools;

namespace {

std::string path_of(const std::string& keys, const std::string& more = "") {
  return R"({"format": "scree camera path", "version": 1, )" + more + "\"keys\": [" + keys + "]}";
}

CameraPath must_parse(const std::string& text, std::optional<double> fps = {}) {
  return must(CameraPath::parse(text, fps));
}

std::string refusal(const std::string& text) {
  return refusal(CameraPath::parse(text)).message;
}

const std::string kEye = R"("eye": [4, 2, 6], "target": [0, 1, 0])";

}  // namespace

TEST_CASE("a path passes through its keys, on the curve of scree view", "[path]") {
  const CameraPath path =
      must_parse(path_of("{\"t\": 0, " + kEye + R"(}, {"t": 1, "eye": [6, 2, 0], "target": [0, 1, 0],
    "fov": 60, "up": [0, 0, 1]}, {"t": 3, "eye": [0, 2, -6], "target": [1, 1, 0], "fov": 50})"));
  CHECK(path.frames_per_second() == 30);
  CHECK(path.frame_count() == 91);
  CHECK(path.at(0).eye == scree::runtime::Vec3{4, 2, 6});
  CHECK(path.at(0).fov_degrees == 45);
  CHECK(path.at(30).eye == scree::runtime::Vec3{6, 2, 0});
  CHECK(path.at(30).up == scree::runtime::Vec3{0, 0, 1});
  CHECK(path.at(90).eye == scree::runtime::Vec3{0, 2, -6});
  CHECK(path.at(90).target == scree::runtime::Vec3{1, 1, 0});
  // Half way from the second key to the third: (-p + 9 q + 9 r - s) / 16. The last key counts twice.
  CHECK(path.at(60).eye[0] == Approx((-4.0 + 9 * 6 + 9 * 0 - 0) / 16));
  CHECK(path.at(60).eye[2] == Approx((-6.0 + 9 * 0 + 9 * -6 - -6) / 16));
  for (uint64_t frame = 0; frame < path.frame_count(); ++frame) {
    CHECK(path.at(frame).fov_degrees >= 45);
    CHECK(path.at(frame).fov_degrees <= 60);
  }
}

TEST_CASE("keys without times are frames, and matrices are cameras", "[path]") {
  const std::string keys =
      "{" + kEye + R"(}, {"matrix": [0,0,-1,0, 0,1,0,0, 3,0,0,0, 5,2,0,1], "fov": 30}, {)" + kEye + "}";
  for (const double fps : {30.0, 23.976, 7.0}) {
    const CameraPath path = must_parse(path_of(keys), fps);
    REQUIRE(path.frame_count() == 3);
    CHECK(path.at(0).eye == scree::runtime::Vec3{4, 2, 6});
    CHECK(path.at(1).eye == scree::runtime::Vec3{5, 2, 0});
    CHECK(path.at(1).target == scree::runtime::Vec3{4, 2, 0});
    CHECK(path.at(1).up == scree::runtime::Vec3{0, 1, 0});
    CHECK(path.at(1).fov_degrees == 30);
  }
  CHECK(must_parse(path_of(keys, "\"fps\": 24, ")).frames_per_second() == 24);
  // 2.1 s at 30 frames per second are 63.000000000000007 or 62.999999999999993 frames, depending on rounding.
  CHECK(must_parse(path_of("{\"t\": 0, " + kEye + "}, {\"t\": 2.1, " + kEye + "}")).frame_count() == 64);
  CHECK(must_parse(path_of("{\"t\": 2, " + kEye + "}")).frame_count() == 61);  // a camera that stands still
}

TEST_CASE("an error in a path is named with its place", "[path]") {
  CHECK(refusal("{\n\"format\": oh") == "line 2: is not JSON (byte 13)");
  CHECK(refusal("") == "line 1: is not JSON (byte 0)");
  CHECK(refusal("[1]") == "is no camera path: its \"format\" is not \"scree camera path\"");
  CHECK(refusal(R"({"format": "scree camera path", "version": 2, "keys": []})") ==
        "\"version\" is not 1, the one that this program reads");
  CHECK(refusal(path_of("")) == "\"keys\" is not a list of at least one key");
  CHECK(refusal(path_of("{" + kEye + "}", "\"fps\": 0, ")) ==
        "\"fps\" is not frames per second, above 0 and below 1e6");
  CHECK(refusal(path_of("{" + kEye + "}", "\"speed\": 0, ")) ==
        "has an unknown member \"speed\"; a path has format, version, fps, keys, name");
  CHECK(refusal(path_of("7")) == "key 0: is not an object");
  CHECK(refusal(path_of(R"({"eye": [1, 2, 3]})")) == "key 0: has no \"target\"");
  CHECK(refusal(path_of(R"({"eye": [1, 2], "target": [1, 2, 3]})")) ==
        "key 0: \"eye\" is not 3 numbers of at most 1e15");
  CHECK(refusal(path_of(R"({"eye": [1, 2, "3"], "target": [1, 2, 3]})")) ==
        "key 0: \"eye\" is not 3 numbers of at most 1e15");
  CHECK(refusal(path_of(R"({"eye": [1, 2, 1e16], "target": [1, 2, 3]})")) ==
        "key 0: \"eye\" is not 3 numbers of at most 1e15");
  CHECK(refusal(path_of(R"({"eye": [1, 2, 1e999], "target": [1, 2, 3]})")) == "has a number that is too large");
  CHECK(refusal(path_of("{" + kEye + ", \"fow\": 3}")) ==
        "key 0: has an unknown member \"fow\"; a key has t, eye, target, up, fov, matrix, name");
  CHECK(refusal(path_of("{" + kEye + ", \"fov\": 180}")) ==
        "key 0: \"fov\" is not an angle of at least 1e-9 and below 180 degrees");
  CHECK(refusal(path_of("{\"t\": 1, " + kEye + "}, {\"t\": 1, " + kEye + "}")) ==
        "key 1: its \"t\" is not later than that of the key before");
  CHECK(refusal(path_of("{\"t\": 1, " + kEye + "}, {" + kEye + "}")) == "key 1: has no \"t\", but key 0 has one");
  CHECK(refusal(path_of("{\"t\": -1, " + kEye + "}")) ==
        "key 0: \"t\" is not a time in seconds, 0 or more and below 1e9");
  CHECK(refusal(path_of("{\"t\": 9e8, " + kEye + "}")) == "has more than 10000000 frames");
  CHECK(refusal(path_of(R"({"matrix": [1,0,0,5, 0,1,0,2, 0,0,1,3, 0,0,0,1]})")).find("column by column") !=
        std::string::npos);
  CHECK(refusal(path_of(R"({"matrix": [1,0,0,0, 0,1,0,0, 0,0,0,0, 0,0,0,1]})")).find("no direction") !=
        std::string::npos);
  CHECK(refusal(path_of("{" + kEye + R"(, "matrix": [1,0,0,0, 0,1,0,0, 0,0,1,0, 0,0,0,1]})")) ==
        "key 0: has \"matrix\" together with \"eye\", \"target\" or \"up\", which it replaces");
  CHECK(refusal(std::string(100000, '[')).find("is not JSON") != std::string::npos);
}

TEST_CASE("every frame belongs to one share", "[path]") {
  const FrameRange all = must(parse_frame_range("5:17"));
  CHECK(all.count() == 12);
  CHECK(all.frame(11) == 16);
  for (const uint64_t parts : {1, 2, 5, 12, 20}) {
    std::vector<int> drawn(17);
    for (uint64_t part = 1; part <= parts; ++part) {
      const FrameRange share = must(parse_frame_range("5:17," + std::to_string(part) + "/" + std::to_string(parts)));
      for (uint64_t i = 0; i < share.count(); ++i) ++drawn[share.frame(i)];
    }
    CHECK(drawn == std::vector<int>{0, 0, 0, 0, 0, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1});
  }
  CHECK(parse_frame_range("2/3")->part == 1);
  for (const char* text : {"", "600", "1:", ":5", "5:5", "6:5", "-1:5", "0:99999999999999999999", "0/3", "4/3", "1/0",
                           "0:5,", "0:5,1", "1/3,0:5", "0:5/1", "0 :5", "a:b"}) {
    INFO(text);
    CHECK(refusal(parse_frame_range(text)).code == ErrorCode::kUsage);
  }
}

TEST_CASE("ranks draw runs of frames, equally many each", "[path]") {
  for (const uint64_t ranks : {1, 2, 3, 7, 64})
    for (const uint64_t frames : {1, 2, 15, 120, 121, 600, 100000}) {
      CAPTURE(ranks, frames);
      std::vector<uint64_t> drawn(ranks);
      std::vector<double> time(ranks);  // time per rank if the time of frames grows from 0 to 1
      uint64_t runs = 1;
      for (uint64_t i = 0; i < frames; ++i) {
        ++drawn.at(rank_of_frame(i, frames, ranks));
        time.at(rank_of_frame(i, frames, ranks)) += static_cast<double>(i) / static_cast<double>(frames);
        runs += i != 0 && rank_of_frame(i, frames, ranks) != rank_of_frame(i - 1, frames, ranks);
      }
      const auto [least, most] = std::minmax_element(drawn.begin(), drawn.end());
      CHECK(*most - *least <= std::max<uint64_t>(frames / (8 * ranks), 1));  // one frame per run
      if (ranks > 1 && frames >= 8 * ranks) CHECK(runs <= frames / 8);
      const auto [shortest, longest] = std::minmax_element(time.begin(), time.end());
      if (frames == 120 && ranks == 2) CHECK(*longest < 1.001 * *shortest);  // 1.15 if they took turns as 0 1, 0 1
      if (ranks > 1) CHECK(runs >= std::min<uint64_t>(frames, ranks));
    }
}

TEST_CASE("ranks of a host take each frame once, and neighbouring frames one after the other", "[path]") {
  for (const uint32_t ranks : {1, 2, 3, 4, 7})
    for (const uint64_t frames : {uint64_t{ranks}, uint64_t{20}, uint64_t{601}})
      for (const bool has_slow_rank : {false, true}) {
        CAPTURE(ranks, frames, has_slow_rank);
        std::vector<std::atomic<uint64_t>> words(SharedFrames::words(ranks));
        std::vector<SharedFrames> shares;
        for (uint32_t rank = 0; rank < ranks; ++rank) shares.emplace_back(words, frames, rank, ranks);
        std::vector<int> drawn(frames);
        std::vector<uint64_t> last(ranks, UINT64_MAX);
        uint64_t jumps = 0;
        for (uint64_t turn = 0; shares[0].has_left(); ++turn)
          for (uint32_t rank = 0; rank < ranks; ++rank) {
            if (has_slow_rank && rank == 0 && turn % 4 != 0) continue;
            const std::optional<uint64_t> frame = shares[rank].take();
            if (!frame) continue;
            REQUIRE(*frame < frames);
            ++drawn[*frame];
            const uint64_t distance = *frame > last[rank] ? *frame - last[rank] : last[rank] - *frame;
            if (last[rank] != UINT64_MAX && distance != 1) ++jumps;
            last[rank] = *frame;
            CHECK(shares[rank].count_written() <= frames);
          }
        CHECK(drawn == std::vector<int>(frames, 1));
        CHECK_FALSE(shares[ranks - 1].take());
        CHECK(shares[0].count_written() == frames + 1);
        if (ranks <= 2) CHECK(jumps == 0);
        if (!has_slow_rank) CHECK(jumps <= ranks);
      }
}

TEST_CASE("threads that take frames at the same time get each of them once", "[path]") {
  constexpr uint32_t kRanks = 5;
  constexpr uint64_t kFrames = 20000;
  std::vector<std::atomic<uint64_t>> words(SharedFrames::words(kRanks));
  std::vector<std::atomic<int>> drawn(kFrames);
  std::vector<std::thread> threads;
  for (uint32_t rank = 0; rank < kRanks; ++rank)
    threads.emplace_back([&, rank] {
      SharedFrames shares(words, kFrames, rank, kRanks);
      while (const std::optional<uint64_t> frame = shares.take()) ++drawn[*frame];
    });
  for (std::thread& thread : threads) thread.join();
  CHECK(std::count(drawn.begin(), drawn.end(), 1) == kFrames);
}

TEST_CASE("a frame's number is written into its name once", "[path]") {
  const auto name = [](const std::string& text, uint64_t frame) {
    const Result<FramePattern> pattern = FramePattern::parse("-o", text);
    return pattern ? pattern->name(frame) : std::string("refused");
  };
  CHECK(name("frame_%05d.png", 42) == "frame_00042.png");
  CHECK(name("frame_%05d.png", 1234567) == "frame_1234567.png");
  CHECK(name("%d", 0) == "0");
  CHECK(name("100%%/%03d%%.png", 7) == "100%/007%.png");
  for (const char* text :
       {"frame.png", "%",    "%%d.png",       "%d%d",  "%s.png", "%n.png", "%5d", "%-5d", "%+d",  "%05",
        "%020d",     "%00d", "%99999999999d", "%0x5d", "%ld",    "%.3d",   "%*d", "%1$d", "%d%s", "%d%"}) {
    INFO(text);
    CHECK(name(text, 1) == "refused");
  }
}
