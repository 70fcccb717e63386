// Charts as SVG: lines and markers over two axes. Readable on light and on dark pages: no background, colours in the
// middle, and text that follows what the reader's screen prefers.
#pragma once

#include <span>
#include <string>
#include <utility>
#include <vector>

namespace scree::bench {

struct ChartAxis {
  std::string label;
  bool log = false;
  /// Where lines and labels stand instead of at round numbers; values ascend.
  std::vector<std::pair<double, std::string>> ticks;
};

/// Values that an axis cannot show (0 on a logarithmic one, infinity) are hollow markers on the border.
struct ChartSeries {
  std::string name;                               // in the legend; empty: not there
  std::vector<std::pair<double, double>> points;  // in the order of the line
  size_t colour = 0;                              // series of one number have one colour and marker
  bool dashed = false;
};

struct Chart {
  std::string title;
  std::string note;  // under the title; may be empty
  ChartAxis x, y;
  std::vector<ChartSeries> series;
};

/// A whole SVG document, 800 x 420. The same chart gives the same bytes.
std::string svg_chart(const Chart& chart);

/// Round numbers that cover [low, high] with at most `most` steps: 1, 2 or 5 times a power of ten apart; logarithmic:
/// powers of ten, with 2 and 5 where they are few. low < high; logarithmic: 0 < low.
std::vector<double> chart_ticks(double low, double high, bool log, size_t most);

}  // namespace scree::bench
