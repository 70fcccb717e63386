#include "tools/convert/report.h"

#include <cstdio>

#include "tools/common/options.h"

namespace scree::convert {

std::string describe_work(const ConvertReport& report) {
  std::string text = describe(report.rates);
  if (report.threads < report.threads_asked)
    text +=
        ", " + std::to_string(report.threads) + " of " + std::to_string(report.threads_asked) + " threads (--memory)";
  if (report.windows_ahead > 0)
    text += ", " + std::to_string(report.windows_ahead) + " of " + std::to_string(report.windows) +
            " windows encoded before all were measured";
  return text;
}

std::string describe(const ConvertOptions& options, const ConvertReport& report) {
  char numbers[256];
  const double in = static_cast<double>(report.input_bytes);
  const double out = static_cast<double>(report.output_bytes);
  const double triangles = static_cast<double>(report.triangles);
  std::snprintf(numbers, sizeof numbers,
                "ratio %.2f, %.2f bits/triangle, max position error %.3g (%.2g of the diagonal), %.2f s, "
                "%s triangles/s, peak memory %s",
                out > 0 ? in / out : 0.0, triangles > 0 ? 8 * out / triangles : 0.0, report.position_error,
                report.relative_position_error, report.seconds,
                tools::format_count(report.seconds > 0 ? triangles / report.seconds : 0).c_str(),
                tools::format_bytes(report.peak_bytes).c_str());
  std::string text = options.input + " -> " + report.output + ": " + tools::format_bytes(report.input_bytes) + " -> " +
                     tools::format_bytes(report.output_bytes) + ", " + numbers;
  if (report.rates.encoded_triangles > 0) text += "; " + describe_work(report);
  if (report.sorted_triangles > 0)
    text += ", sorted " + tools::format_count(static_cast<double>(report.sorted_triangles)) +
            " triangles that lay in no order (a temporary file of " + tools::format_bytes(report.sort_file_bytes) + ")";
  if (report.resumed_pages > 0) text += ", resumed after " + std::to_string(report.resumed_pages) + " pages";
  return text;
}

}  // namespace scree::convert
