// scree devices: lists the GPUs of this machine, and whether this program can draw on them.
#include <cstdio>
#include <memory>
#include <string>

#include "runtime/draw/device_list.h"
#include "tools/common/options/command.h"
#include "tools/common/options/options.h"
#include "tools/common/output/json_writer.h"
#include "tools/common/output/standard_output.h"

namespace scree::tools {
namespace {

std::string version_or_none(int version) {
  return version == 0 ? "none" : runtime::cuda_version_name(version);
}

std::string capability(const runtime::Gpu& gpu) {
  return std::to_string(gpu.major) + "." + std::to_string(gpu.minor);
}

std::string as_text(const runtime::GpuList& list) {
  std::string text = "driver: ";
  if (list.program_cuda == 0) {
    text += "not checked\n";
  } else if (list.driver_cuda == 0) {
    text += "none\n";
  } else {
    text += (list.driver.empty() ? "" : list.driver + ", ") + "for CUDA up to " +
            runtime::cuda_version_name(list.driver_cuda) + "\n";
  }
  text += "program: " +
          (list.program_cuda == 0
               ? std::string("built without CUDA")
               : "CUDA " + runtime::cuda_version_name(list.program_cuda) + ", code for " + list.code_for) +
          "\n";
  bool any = false;
  for (const runtime::Gpu& gpu : list.gpus) {
    any = any || gpu.is_usable();
    text += "cuda:" + std::to_string(gpu.index) + ": " + gpu.name + ", compute capability " + capability(gpu) + ", " +
            format_bytes(gpu.total_bytes) + ", ";
    if (gpu.is_usable()) text += format_bytes(gpu.free_bytes) + " free, ";
    text += gpu.uuid + ": " + (gpu.is_usable() ? "usable" : "not usable: " + gpu.why_unusable) + "\n";
  }
  if (list.gpus.empty()) {
    text += "no usable GPU: " + list.why_none + "; the CPU draws\n";
  } else if (!any) {
    text += "no usable GPU; the CPU draws\n";
  }
  return text;
}

std::string as_json(const runtime::GpuList& list) {
  std::string text;
  JsonWriter json(text);
  json.begin_object();
  json.member("driver", list.driver);
  json.member("driver_cuda", version_or_none(list.driver_cuda));
  json.member("program_cuda", version_or_none(list.program_cuda));
  json.member("code_for", list.code_for);
  json.member("why_none", list.why_none);
  json.key("devices");
  json.begin_array();
  for (const runtime::Gpu& gpu : list.gpus) {
    json.line();
    json.begin_object();
    json.member("index", static_cast<uint32_t>(gpu.index));
    json.member("name", gpu.name);
    json.member("uuid", gpu.uuid);
    json.member("compute_capability", capability(gpu));
    json.member("memory_bytes", gpu.total_bytes);
    json.member("free_bytes", gpu.free_bytes);
    json.member("usable", gpu.is_usable());
    json.member("why_unusable", gpu.why_unusable);
    json.end_object();
  }
  json.end_array();
  json.end_object();
  json.line();
  return text;
}

}  // namespace

Command add_devices(CLI::App& parent) {
  const auto json = std::make_shared<bool>(false);
  CLI::App* app = parent.add_subcommand(
      "devices", "Lists the GPUs: name, compute capability, memory, UUID, and whether this program can draw on them");
  app->add_flag("--json", *json, "One JSON object");
  return {app, [json]() -> Result<void> {
            const runtime::GpuList list = runtime::list_gpus();
            const std::string text = *json ? as_json(list) : as_text(list);
            std::fwrite(text.data(), 1, text.size(), stdout);
            return finish_output();
          }};
}

}  // namespace scree::tools
