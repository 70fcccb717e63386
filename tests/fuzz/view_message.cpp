// Messages from a page to scree view.
#include <cmath>
#include <string_view>
#include <type_traits>
#include <variant>

#include "tests/fuzz/input.h"
#include "tools/view/message.h"

namespace scree::fuzz {

void view_message(Bytes bytes) {
  namespace view = tools::view;
  const ExactCopy copy(bytes);
  const std::string_view text(reinterpret_cast<const char*>(copy.bytes().data()), copy.bytes().size());
  const Result<view::Message> message = view::parse_message(text);
  if (!message) return must(!message.error().message.empty(), "a refused message is refused with words");
  std::visit(
      [](const auto& body) {
        using Body = std::decay_t<decltype(body)>;
        if constexpr (std::is_same_v<Body, view::PictureRequest>) {
          for (const runtime::Vec3* vector : {&body.camera.eye, &body.camera.target, &body.camera.up})
            for (const double value : *vector)
              must(std::abs(value) <= view::kMaxCoordinate, "a camera's coordinates are bounded");
          for (size_t k = 0; k < 3 && body.clip_box; ++k)
            must(-view::kMaxCoordinate <= body.clip_box->min[k] && body.clip_box->min[k] <= body.clip_box->max[k] &&
                     body.clip_box->max[k] <= view::kMaxCoordinate,
                 "a clipping box is bounded and in order");
          must(body.camera.fov_degrees > 0 && body.camera.fov_degrees < 180, "a field of view is an angle");
          must(body.width >= 1 && body.height >= 1 && body.width <= view::kMaxPictureSide &&
                   body.height <= view::kMaxPictureSide &&
                   uint64_t{body.width} * body.height <= view::kMaxPicturePixels,
               "a picture's size is bounded");
          must(body.most_samples == 1 || body.most_samples == 2 || body.most_samples == 4, "samples are 1, 2 or 4");
          must(!body.cursor || (body.cursor->x < body.width && body.cursor->y < body.height),
               "the cursor lies within the picture");
          must(body.shade.background[3] == 1.0f, "the background is opaque");
        } else if constexpr (std::is_same_v<Body, view::Screenshot>) {
          must(uint64_t{body.width} * body.height <= view::kMaxPicturePixels, "a screenshot's size is bounded");
        } else if constexpr (std::is_same_v<Body, view::Visibility>) {
          must(body.hidden.size() <= view::kMaxListedNodes && body.only.size() <= view::kMaxListedNodes,
               "lists of nodes are bounded");
        } else if constexpr (std::is_same_v<Body, view::Hello>) {
          must(body.token.size() <= 64, "a token is short");
        }
      },
      *message);
}

}  // namespace scree::fuzz
