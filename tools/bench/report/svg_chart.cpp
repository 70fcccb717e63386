#include "tools/bench/report/svg_chart.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <limits>
#include <optional>

namespace scree::bench {
namespace {

constexpr double kWidth = 800, kHeight = 420;
constexpr double kLeft = 72, kRight = 548, kTop = 60, kBottom = 364;  // of the plotted area
constexpr size_t kMostTicks = 8;
constexpr double kMarker = 3.2;

// Of middle lightness, apart for most kinds of colour vision (after Okabe and Ito), markers tell the rest.
constexpr std::array kColours{"#2f86c9", "#d97a1e", "#2a9d74", "#c9579a", "#8a6fd1", "#b8901a", "#5aa9c9", "#c2553f"};

// The first grey stands out on white and on black, where a viewer does not know what its reader prefers.
constexpr const char* kStyle =
    "text{font:13px system-ui,sans-serif;fill:#6e7781}.title{font-size:15px;font-weight:600}"
    ".grid{stroke:#8c959f;stroke-opacity:.3}.axis{stroke:#8c959f;fill:none}"
    "@media (prefers-color-scheme:light){text{fill:#57606a}}@media (prefers-color-scheme:dark){text{fill:#a8b1bb}}";

std::string number(double value) {
  char text[32];
  std::snprintf(text, sizeof text, "%.2f", value);
  return text;
}

/// "0.05", "1e-07".
std::string tick_label(double value) {
  char text[32];
  std::snprintf(text, sizeof text, "%.6g", value);
  return text;
}

std::string escaped(const std::string& text) {
  std::string out;
  for (const char c : text) {
    switch (c) {
      case '&':
        out += "&amp;";
        break;
      case '<':
        out += "&lt;";
        break;
      case '>':
        out += "&gt;";
        break;
      case '"':
        out += "&quot;";
        break;
      default:
        out += c;
    }
  }
  return out;
}

std::string text_at(double x, double y, const char* anchor, const std::string& text, const char* extra = "") {
  return "<text x=\"" + number(x) + "\" y=\"" + number(y) + "\" text-anchor=\"" + anchor + "\"" + extra + ">" +
         escaped(text) + "</text>\n";
}

/// One direction: from values to places on the page.
class Scale {
 public:
  Scale(const ChartAxis& axis, const Chart& chart, bool is_x, double from, double to)
      : axis_(axis), from_(from), to_(to) {
    double low = std::numeric_limits<double>::infinity(), high = -low;
    const auto add = [&](double value) {
      if (!can_show(value)) return;
      low = std::min(low, value);
      high = std::max(high, value);
    };
    for (const ChartSeries& series : chart.series)
      for (const auto& [x, y] : series.points) add(is_x ? x : y);
    for (const auto& [value, label] : axis.ticks) add(value);
    if (!(low <= high)) low = high = 1;
    if (low == high) {
      low = axis.log ? low / 2 : low - 1;
      high = axis.log ? high * 2 : high + 1;
    }
    if (axis.ticks.empty()) {
      for (const double tick : chart_ticks(low, high, axis.log, kMostTicks))
        ticks_.emplace_back(tick, tick_label(tick));
      low = std::min(low, ticks_.front().first);
      high = std::max(high, ticks_.back().first);
    } else {
      ticks_ = axis.ticks;
    }
    low_ = position(low);
    high_ = position(high);
    // Markers keep off the borders, which are for what cannot be shown.
    const double margin = 0.03 * (high_ - low_);
    low_ -= margin;
    high_ += margin;
  }

  bool can_show(double value) const { return std::isfinite(value) && (!axis_.log || value > 0); }
  /// On the page; of a value that cannot be shown the border.
  double operator()(double value) const {
    if (!can_show(value)) return value > 0 ? to_ : from_;
    return from_ + (position(value) - low_) / (high_ - low_) * (to_ - from_);
  }
  const std::vector<std::pair<double, std::string>>& ticks() const { return ticks_; }

 private:
  double position(double value) const { return axis_.log ? std::log10(value) : value; }

  const ChartAxis& axis_;
  double from_, to_;
  double low_ = 0, high_ = 1;
  std::vector<std::pair<double, std::string>> ticks_;
};

std::string marker(size_t colour, double x, double y, bool hollow) {
  const std::string stroke = kColours[colour % kColours.size()];
  const std::string paint = " fill=\"" + (hollow ? std::string("none") : stroke) + "\" stroke=\"" + stroke + "\"";
  const double r = kMarker;
  switch (colour % 4) {
    case 0:
      return "<circle cx=\"" + number(x) + "\" cy=\"" + number(y) + "\" r=\"" + number(r) + "\"" + paint + "/>\n";
    case 1:
      return "<rect x=\"" + number(x - r) + "\" y=\"" + number(y - r) + "\" width=\"" + number(2 * r) + "\" height=\"" +
             number(2 * r) + "\"" + paint + "/>\n";
    case 2:
      return "<path d=\"M" + number(x) + " " + number(y - 1.3 * r) + "L" + number(x + 1.2 * r) + " " + number(y + r) +
             "H" + number(x - 1.2 * r) + "Z\"" + paint + "/>\n";
    default:
      return "<path d=\"M" + number(x) + " " + number(y - 1.4 * r) + "L" + number(x + 1.4 * r) + " " + number(y) + "L" +
             number(x) + " " + number(y + 1.4 * r) + "L" + number(x - 1.4 * r) + " " + number(y) + "Z\"" + paint +
             "/>\n";
  }
}

std::string line(const ChartSeries& series, const std::string& path) {
  return "<path d=\"" + path + "\" fill=\"none\" stroke=\"" + kColours[series.colour % kColours.size()] +
         "\" stroke-width=\"1.8\"" + (series.dashed ? " stroke-dasharray=\"6 4\"" : "") + "/>\n";
}

std::string draw_series(const ChartSeries& series, const Scale& x, const Scale& y) {
  std::string path, markers;
  bool is_drawing = false;
  for (const auto& [at, value] : series.points) {
    const double px = x(at), py = y(value);
    const bool shown = x.can_show(at) && y.can_show(value);
    markers += marker(series.colour, px, py, !shown);
    if (shown) path += (is_drawing ? "L" : "M") + number(px) + " " + number(py);
    is_drawing = shown;
  }
  return (path.empty() ? std::string() : line(series, path)) + markers;
}

std::string draw_axes(const Chart& chart, const Scale& x, const Scale& y) {
  std::string out;
  for (const auto& [value, label] : y.ticks()) {
    out += "<path class=\"grid\" d=\"M" + number(kLeft) + " " + number(y(value)) + "H" + number(kRight) + "\"/>\n";
    out += text_at(kLeft - 8, y(value) + 4, "end", label);
  }
  for (const auto& [value, label] : x.ticks()) {
    out += "<path class=\"grid\" d=\"M" + number(x(value)) + " " + number(kTop) + "V" + number(kBottom) + "\"/>\n";
    out += text_at(x(value), kBottom + 18, "middle", label);
  }
  out += "<path class=\"axis\" d=\"M" + number(kLeft) + " " + number(kTop) + "V" + number(kBottom) + "H" +
         number(kRight) + "\"/>\n";
  out += text_at((kLeft + kRight) / 2, kBottom + 42, "middle", chart.x.label);
  const std::string turn = " transform=\"rotate(-90 16 " + number((kTop + kBottom) / 2) + ")\"";
  return out + text_at(16, (kTop + kBottom) / 2, "middle", chart.y.label, turn.c_str());
}

std::string draw_legend(const Chart& chart) {
  std::string out;
  double y = kTop + 8;
  for (const ChartSeries& series : chart.series) {
    if (series.name.empty()) continue;
    out += line(series, "M" + number(kRight + 16) + " " + number(y) + "h26");
    out += marker(series.colour, kRight + 29, y, false);
    out += text_at(kRight + 50, y + 4, "start", series.name);
    y += 20;
  }
  return out;
}

}  // namespace

std::vector<double> chart_ticks(double low, double high, bool log, size_t most) {
  std::vector<double> ticks;
  if (log) {
    const int first = static_cast<int>(std::floor(std::log10(low) + 1e-9));
    const int last = static_cast<int>(std::ceil(std::log10(high) - 1e-9));
    const int decades = std::max(1, last - first);
    const int step = (decades + static_cast<int>(most) - 1) / static_cast<int>(most);
    for (int power = first; power <= last; power += step) {
      const double decade = std::pow(10.0, power);
      ticks.push_back(decade);
      if (static_cast<size_t>(3 * decades) > most || power >= last) continue;
      ticks.push_back(2 * decade);
      ticks.push_back(5 * decade);
    }
    // Without those that nothing needs.
    while (ticks.size() > 2 && ticks[1] <= low) ticks.erase(ticks.begin());
    while (ticks.size() > 2 && ticks[ticks.size() - 2] >= high) ticks.pop_back();
    return ticks;
  }
  const double raw = (high - low) / static_cast<double>(most);
  const double power = std::pow(10.0, std::floor(std::log10(raw)));
  double step = 10 * power;
  for (const double part : {1.0, 2.0, 5.0}) {
    if (part * power < raw) continue;
    step = part * power;
    break;
  }
  const auto first = static_cast<int64_t>(std::floor(low / step + 1e-9));
  const auto last = static_cast<int64_t>(std::ceil(high / step - 1e-9));
  for (int64_t i = first; i <= last; ++i) ticks.push_back(static_cast<double>(i) * step);
  return ticks;
}

std::string svg_chart(const Chart& chart) {
  const Scale x(chart.x, chart, true, kLeft, kRight);
  const Scale y(chart.y, chart, false, kBottom, kTop);
  std::string out = "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 " + number(kWidth) + " " +
                    number(kHeight) + "\" width=\"" + number(kWidth) + "\" height=\"" + number(kHeight) +
                    "\" role=\"img\" aria-label=\"" + escaped(chart.title) + "\">\n<style>" + kStyle + "</style>\n";
  out += text_at(kLeft, 24, "start", chart.title, " class=\"title\"");
  if (!chart.note.empty()) out += text_at(kLeft, 44, "start", chart.note);
  out += draw_axes(chart, x, y);
  for (const ChartSeries& series : chart.series) out += draw_series(series, x, y);
  return out + draw_legend(chart) + "</svg>\n";
}

}  // namespace scree::bench
