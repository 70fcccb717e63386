#include "tools/view/message.h"

#include <string>

#include "tests/results.h"
#include "tests/tools/view/page_client.h"

using namespace scree::tools::view;
using scree::Result;
using scree::tests::replaced;
using scree::tests::view_text;

namespace {

PictureRequest must_be_view(const std::string& text) {
  const Message message = must(parse_message(text));
  REQUIRE(std::holds_alternative<PictureRequest>(message));
  return std::get<PictureRequest>(message);
}

std::string error_of(const std::string& text) {
  const Result<Message> message = parse_message(text);
  return message ? "" : message.error().message;
}

}  // namespace

TEST_CASE("all members of a view message are read", "[view][view-message]") {
  const double eye_x = 0.1 + 0.2;  // a double without a short decimal form
  const PictureRequest view = must_be_view(view_text(77, 1280, 720, eye_x, true, 4));
  CHECK(view.sequence == 77);
  CHECK(view.camera.eye == scree::runtime::Vec3{eye_x, 0.25, 2.5});
  CHECK(view.width == 1280);
  CHECK(view.most_samples == 4);
  CHECK(view.is_moving);
  CHECK_FALSE(view.cursor);
  CHECK(view.shade.light);
  CHECK(view.shade.background[3] == 1.0f);
  CHECK(must_be_view(replaced(view_text(1, 64, 64), "{", "{\"x\":63,\"y\":0,")).cursor == Pixel{63, 0});
  CHECK_FALSE(must_be_view(replaced(view_text(1, 64, 64), "{", "{\"x\":64,\"y\":0,")).cursor);
  CHECK_FALSE(view.clip_box);
  CHECK(must_be_view(replaced(view_text(1, 64, 64), "{", "{\"clip\":[-1,0,0.5,2,0,1e3],")).clip_box ==
        scree::runtime::WorldBox{{-1, 0, 0.5}, {2, 0, 1e3}});
}

TEST_CASE("messages outside their limits are refused with the member's name", "[view][view-message]") {
  const std::string view = view_text(1, 64, 64);
  CHECK(error_of(replaced(view, "\"eye\":[0.5", "\"eye\":[1e16")).find("eye") != std::string::npos);
  CHECK(error_of(replaced(view, "\"eye\":[0.5", "\"eye\":[1e999")) != "");
  CHECK(error_of(replaced(view, "\"eye\":[0.5", "\"eye\":[\"0\"")).find("eye") != std::string::npos);
  CHECK(error_of(replaced(view, "\"eye\":[0.5,", "\"eye\":[")).find("eye") != std::string::npos);
  CHECK(error_of(replaced(view, "\"fov\":45", "\"fov\":180")).find("fov") != std::string::npos);
  CHECK(error_of(replaced(view, "\"width\":64", "\"width\":0")).find("width") != std::string::npos);
  CHECK(error_of(replaced(view, "\"width\":64", "\"width\":-1")).find("width") != std::string::npos);
  CHECK(error_of(replaced(view, "\"width\":64", "\"width\":1.5")).find("width") != std::string::npos);
  CHECK(error_of(replaced(view, "\"width\":64", "\"width\":8193")).find("width") != std::string::npos);
  CHECK(error_of(replaced(replaced(view, "\"width\":64", "\"width\":8192"), "\"height\":64", "\"height\":8192"))
            .find("width") != std::string::npos);
  CHECK(error_of(replaced(view, "\"samples\":1", "\"samples\":3")).find("samples") != std::string::npos);
  CHECK(error_of(replaced(view, "\"texture\"", "\"overdrive\"")).find("show") != std::string::npos);
  CHECK(error_of(replaced(view, "#20252d", "#20252")).find("background") != std::string::npos);
  CHECK(error_of(replaced(view, "\"light\":true", "\"light\":1")).find("light") != std::string::npos);
  CHECK(error_of(replaced(view, "\"seq\":1,", "")).find("seq") != std::string::npos);
  for (const char* box :
       {"[-1,0,0,2,1]", "[-1,0,0,2,1,1,1]", "[-1,0,0,2,1,1e16]", "[-1,0,0,2,1,null]", "[-1,2,0,2,1,1]", "{}", "null"})
    CHECK(error_of(replaced(view, "{", "{\"clip\":" + std::string(box) + ",")).find("clip") != std::string::npos);
  CHECK(error_of("{\"type\":\"quit\"}").find("type") != std::string::npos);
  CHECK(error_of("{}").find("type") != std::string::npos);
  CHECK(error_of("[]") != "");
  CHECK(error_of("") != "");
  CHECK(error_of(std::string(kMaxMessageBytes, '[')) != "");
  CHECK(error_of("{\"type\":\"nodes\"}" + std::string(kMaxMessageBytes, ' ')) != "");
  std::string nodes = "1";
  for (uint32_t i = 0; i < kMaxListedNodes; ++i) nodes += ",1";
  CHECK(error_of("{\"type\":\"hide\",\"only\":[],\"hidden\":[" + nodes + "]}").find("hidden") != std::string::npos);
}

TEST_CASE("every prefix of a message is refused", "[view][view-message]") {
  const std::string view = view_text(1, 64, 64);
  REQUIRE(parse_message(view));
  for (size_t size = 0; size < view.size(); ++size) CHECK_FALSE(parse_message(view.substr(0, size)));
}
