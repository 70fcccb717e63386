// The list of GPUs: their names, and the messages for unusable ones.
#include "runtime/draw/device_list.h"

#include <algorithm>
#include <array>
#include <cstdlib>
#include <string>
#include <utility>
#include <vector>

#include "tests/gpu.h"
#include "tests/models.h"
#include "tests/results.h"
#include "tests/tools/run_program.h"
#include "tools/common/options/backend.h"

namespace scree::tests {
namespace {

using runtime::Gpu;

std::vector<Gpu> two_gpus() {
  const Gpu a{.index = 0, .name = "first", .uuid = "GPU-5fd4f087-86f3-7a43-b711-4771313afc50"};
  Gpu b = a;
  b.index = 1;
  b.name = "second";
  b.uuid = "GPU-5fd5a9d2-4ffb-9d48-e2b8-aa10fe9ac1b8";
  return {a, b};
}

/// Sets an environment variable during a test.
class Variable {
 public:
  Variable(const char* name, const char* value) : name_(name) {
    if (const char* const before = std::getenv(name)) before_ = before, has_before_ = true;
    setenv(name, value, 1);
  }
  Variable(const Variable&) = delete;
  Variable& operator=(const Variable&) = delete;
  ~Variable() { has_before_ ? setenv(name_, before_.c_str(), 1) : unsetenv(name_); }

 private:
  const char* name_;
  std::string before_;
  bool has_before_ = false;
};

}  // namespace

TEST_CASE("a GPU is named by its index, its UUID or a prefix of its UUID", "[device]") {
  const std::vector<Gpu> gpus = two_gpus();
  CHECK(runtime::find_gpu(gpus, "1")->name == "second");
  CHECK(runtime::find_gpu(gpus, "0001")->name == "second");
  CHECK(runtime::find_gpu(gpus, gpus[0].uuid)->name == "first");
  CHECK(runtime::find_gpu(gpus, "gpu-5FD5")->name == "second");
  for (const char* none : {"2", "99999999999999999999", "GPU-6", "GPU-5fd4f087-86f3-7a43-b711-4771313afc500"})
    check_refusal(runtime::find_gpu(gpus, none), ErrorCode::kDevice, "there is 0 GPU-5fd4f087");
  CHECK(refusal(runtime::find_gpu(gpus, "GPU-5fd")).message.find("several") != std::string::npos);

  for (const char* good : {"0", "17", "GPU-5", "gpu-5FD4f087-86f3"}) CHECK(runtime::names_gpu(good));
  for (const char* bad : {"", "-1", "1.5", "cuda:0", "GPU-", "GPU-xyz", "0 "}) CHECK_FALSE(runtime::names_gpu(bad));
}

TEST_CASE("the GPU of --device is used, and it is an error if it cannot draw", "[device]") {
  using tools::BackendChoice;
  using tools::parse_backend;
  CHECK(parse_backend("auto", "")->choice == BackendChoice::kAuto);
  CHECK(parse_backend("auto", "1")->choice == BackendChoice::kCuda);
  CHECK(parse_backend("cuda", "GPU-5")->device == "GPU-5");
  CHECK(parse_backend("auto", "")->gpus == 1);
  CHECK(parse_backend("auto", "", "2")->gpus == 2);
  CHECK(parse_backend("auto", "", "2")->choice == BackendChoice::kCuda);
  CHECK(parse_backend("cuda", "1", "all")->gpus == runtime::kAllGpus);
  for (const auto& [backend, gpus] : {std::pair{"cpu", "2"}, {"auto", "0"}, {"auto", "17"}, {"auto", "two"}})
    CHECK(parse_backend(backend, "", gpus).error().code == ErrorCode::kUsage);
  for (const auto& [backend, device] : {std::pair{"cpu", "0"}, {"auto", "-1"}, {"gpu", ""}, {"cuda", "cuda:0"}}) {
    CAPTURE(backend, device);
    CHECK(refusal(parse_backend(backend, device)).code == ErrorCode::kUsage);
  }
}

TEST_CASE("a UUID is printed as by nvidia-smi", "[device]") {
  std::array<std::byte, 16> bytes{};
  for (size_t i = 0; i < bytes.size(); ++i) bytes[i] = static_cast<std::byte>(17 * i);
  CHECK(runtime::uuid_name(bytes) == "GPU-00112233-4455-6677-8899-aabbccddeeff");
}

TEST_CASE("architectures and versions are printed readably", "[device]") {
  CHECK(runtime::architecture_names("90") == "9.0, PTX 9.0");
  CHECK(runtime::architecture_names("75-real,80-real,90,120-real,120-virtual") ==
        "7.5, 8.0, 9.0, 12.0, PTX 9.0, PTX 12.0");
  CHECK(runtime::architecture_names("90a-real") == "9.0a");
  CHECK(runtime::architecture_names("80-virtual") == "PTX 8.0");
  CHECK(runtime::cuda_version_name(13000) == "13.0");
  CHECK(runtime::cuda_version_name(12040) == "12.4");
}

TEST_CASE("the chosen GPU is the one in the machine's list of GPUs", "[device]") {
  const runtime::GpuList list = runtime::list_gpus();
  const Result<Gpu> used = runtime::use_gpu();
  if (list.gpus.empty()) {
    REQUIRE_FALSE(used);
    CHECK(used.error().message == list.why_none);
    CHECK_FALSE(list.why_none.empty());
    return;
  }
  CHECK(list.why_none.empty());
  CHECK(list.driver_cuda >= list.program_cuda / 1000 * 1000);
  for (const Gpu& gpu : list.gpus) {
    if (!gpu.is_usable()) continue;
    REQUIRE(used);
    CHECK(gpu.free_bytes <= gpu.total_bytes);
    CHECK(runtime::use_gpu(std::to_string(gpu.index))->uuid == gpu.uuid);
    CHECK(runtime::use_gpu(gpu.uuid)->index == gpu.index);
    CHECK(runtime::current_gpu()->index == gpu.index);
  }
  if (used) CHECK(runtime::use_gpu()->index == used->index);
}

#if defined(SCREE_EMULATED_CUDA)
TEST_CASE("the first usable GPU is taken, and the others are listed with a reason", "[device]") {
  const Variable gpus("SCREE_EMULATED_GPU", "6.1,7.5,9.0:512,8.0");
  const runtime::GpuList list = runtime::list_gpus();
  REQUIRE(list.gpus.size() == 4);
  CHECK(list.gpus[0].why_unusable.find("compute capability 6.1, this program needs 7.5") != std::string::npos);
  CHECK(list.gpus[1].why_unusable.find("has no code for") != std::string::npos);
  CHECK(list.gpus[1].why_unusable.find("built for 8.0, 9.0, PTX 8.0, PTX 9.0; this GPU is 7.5") != std::string::npos);
  CHECK(list.gpus[2].is_usable());
  CHECK(list.gpus[2].total_bytes == uint64_t{512} << 20);
  CHECK(list.gpus[3].is_usable());
  CHECK(runtime::use_gpu()->index == 2);
  CHECK(runtime::use_gpu("3")->index == 3);
  CHECK(runtime::current_gpu()->index == 3);
  CHECK(runtime::use_gpu("GPU-e3")->index == 3);
  for (const char* bad : {"0", "1", "4", "GPU-e", "GPU-e0"}) {
    CAPTURE(bad);
    CHECK(refusal(runtime::use_gpu(bad)).code == ErrorCode::kDevice);
  }
  CHECK(runtime::use_gpu("2"));
}

TEST_CASE("processes of a host take its GPUs in turn", "[device]") {
  const auto taken = [] {
    std::string numbers;
    for (uint32_t process = 0; process < 7; ++process)
      numbers += std::to_string(runtime::use_gpu_in_turn(process)->index) + " ";
    CHECK(runtime::current_gpu()->index == numbers[12] - '0');
    return numbers;
  };
  {
    const Variable gpus("SCREE_EMULATED_GPU", "9.0,8.0,9.0");
    CHECK(taken() == "0 1 2 0 1 2 0 ");
  }
  {
    const Variable gpus("SCREE_EMULATED_GPU", "6.1,9.0,6.1,8.0");
    CHECK(taken() == "1 1 3 3 1 1 3 ");
  }
  const Variable gpus("SCREE_EMULATED_GPU", "6.1,6.1");
  CHECK(refusal(runtime::use_gpu_in_turn(3)).message.find("compute capability 6.1, this program needs 7.5") !=
        std::string::npos);
}

TEST_CASE("a missing or old driver and a missing GPU are different errors", "[device]") {
  {
    const Variable gpus("SCREE_EMULATED_GPU", "1"), driver("SCREE_EMULATED_DRIVER", "11080");
    CHECK(refusal(runtime::use_gpu()).message.find("too old: it runs CUDA up to 11.8, this program needs ") !=
          std::string::npos);
  }
  {
    const Variable driver("SCREE_EMULATED_DRIVER", "0");
    CHECK(runtime::use_gpu().error().message == "no NVIDIA driver found");
  }
  const Variable gpus("SCREE_EMULATED_GPU", "");
  CHECK(runtime::use_gpu().error().message.starts_with("no NVIDIA GPU found"));
}

TEST_CASE("a fallback to the CPU prints its reason in one line, and the GPU that drew is named", "[device]") {
  const TempFolder folder;
  const std::string log = folder.file("log.txt"), packed = folder.file("a.scree");
  REQUIRE(run_program({"convert", data_path("textured_cube.glb").string(), "-o", packed, "-q"}, log).exit_code == 0);
  struct Case {
    const char* gpus;
    const char* driver;
    std::vector<std::string> words;
    int exit_code;
    const char* says;
  };
  const Case cases[] = {
      {"9.0", "99000", {}, 0, " on cuda:0 (emulated GPU) ("},
      {"6.1,9.0", "99000", {}, 0, " on cuda:1 (emulated GPU) ("},
      {"9.0,9.0", "99000", {"--device", "1"}, 0, " on cuda:1 (emulated GPU) ("},
      {"9.0,9.0", "99000", {"--device", "GPU-e1"}, 0, " on cuda:1 (emulated GPU) ("},
      {"9.0", "0", {}, 0, "warning: the CPU draws: no NVIDIA driver found\n"},
      {"9.0", "11080", {}, 0, "warning: the CPU draws: the NVIDIA driver"},
      {"", "99000", {}, 0, "warning: the CPU draws: no NVIDIA GPU found"},
      {"6.1", "99000", {}, 0, "has compute capability 6.1, this program needs 7.5\n"},
      {"7.5", "99000", {}, 0, "; this GPU is 7.5\n"},
      // Less memory than the scene needs at least.
      {"9.0:1", "99000", {}, 0, "warning: the CPU draws: cuda:0 (emulated GPU): "},
      {"9.0", "99000", {"--device-memory", "1"}, 0, "warning: the CPU draws: cuda:0 (emulated GPU): "},
      {"6.1", "99000", {"--backend", "cuda"}, 4, "has compute capability 6.1, this program needs 7.5; --backend cpu"},
      {"9.0", "0", {"--backend", "cuda"}, 4, "no NVIDIA driver found; --backend cpu draws without a GPU\n"},
      {"9.0:1", "99000", {"--device", "0"}, 4, "scree render: "},
      {"9.0", "99000", {"--device", "1"}, 4, "no GPU 1; there is 0 GPU-"},
  };
  for (const Case& one : cases) {
    CAPTURE(one.gpus, one.driver, one.says, one.words.size());
    const Variable gpus("SCREE_EMULATED_GPU", one.gpus), driver("SCREE_EMULATED_DRIVER", one.driver);
    std::vector<std::string> words =
        words_of("render " + packed + " -o " + folder.file("a.png") + " --force --size 16x16 --threads 2");
    words.insert(words.end(), one.words.begin(), one.words.end());
    const ProgramRun run = run_program(words, log);
    CAPTURE(run.output);
    CHECK(run.exit_code == one.exit_code);
    CHECK(run.output.find(one.says) != std::string::npos);
    const bool warns = run.output.find("warning") != std::string::npos;
    if (one.exit_code != 0) {
      CHECK_FALSE(warns);
      continue;
    }
    CHECK(std::count(run.output.begin(), run.output.end(), '\n') == (warns ? 2 : 1));
    CHECK((run.output.find(" on the CPU, 2 threads (") != std::string::npos) == warns);
    words.push_back("-q");
    CHECK(run_program(words, log).output.empty());
  }
}

TEST_CASE("scree devices lists every GPU and whether it can be used", "[device]") {
  const TempFolder folder;
  const std::string log = folder.file("log.txt");
  const Variable gpus("SCREE_EMULATED_GPU", "7.5,9.0:512");
  const ProgramRun text = run_program({"devices"}, log);
  CHECK(text.exit_code == 0);
  CHECK(text.output.find("cuda:0: emulated GPU, compute capability 7.5") != std::string::npos);
  CHECK(text.output.find("not usable: this program has no code for") != std::string::npos);
  CHECK(text.output.find("cuda:1: emulated GPU, compute capability 9.0, 512 MiB, 512 MiB free, GPU-e1") !=
        std::string::npos);
  const ProgramRun json = run_program({"devices", "--json"}, log);
  CHECK(json.exit_code == 0);
  CHECK(json.output.find("\"free_bytes\":536870912,\"usable\":true") != std::string::npos);
}
#endif

}  // namespace scree::tests
