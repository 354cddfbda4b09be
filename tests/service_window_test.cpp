// What is shown of frames that do not run, and who may look on.
#include "service/service_window.h"

#include <gtest/gtest.h>

#include <cstring>
#include <filesystem>
#include <set>

#include "film/film.h"
#include "service/finished_frame.h"
#include "web/job_view.h"
#include "web/tiles.h"

namespace cloudrenderer {
namespace {

std::set<std::string> keys_of(const Json& json) {
  std::set<std::string> out;
  for (const auto& [key, value] : json.items()) out.insert(key);
  return out;
}

TEST(Seats, AreFreeAgainWhenTheyAreLeft) {
  Seats seats(3, 2);
  const auto first = seats.take("ann");
  auto second = seats.take("ann");
  ASSERT_TRUE(first && second);
  EXPECT_FALSE(seats.take("ann")) << "two are a user's";
  const auto other = seats.take("bob");
  ASSERT_TRUE(other);
  EXPECT_FALSE(seats.take("cid")) << "three there are";
  second.reset();
  EXPECT_TRUE(seats.take("ann"));
}

Json report() {
  return {{"width", 4},
          {"height", 2},
          {"spp_asked", 16},
          {"paths", 64},
          {"time", {{"wall_s", 10.0}, {"render_s", 8.0}, {"cpu_s", 6.0}}},
          {"error", {{"estimated_relmse", 0.5}, {"estimated_relmse_low", 0.25}, {"estimated_relmse_high", 1.0}}},
          {"convergence", {{{"render_s", 4.0}, {"spp", 4}, {"estimated_relmse", 2.0}}}},
          {"hosts", {{{"name", "a"}, {"threads", 2}, {"joined_s", 2.0}, {"left_s", nullptr}, {"lost", false}},
                     {{"name", "b"}, {"threads", 1}, {"joined_s", 0.0}, {"left_s", 4.0}, {"lost", true}}}},
          {"bit_exact", true}};
}

TEST(FinishedFrame, IsTheViewThatItsWindowShowed) {
  JobView job;
  job.hosts.emplace_back();
  const Json running = to_json(job), view = view_of_report(report(), "a.pbrt", false);
  EXPECT_EQ(keys_of(view), keys_of(running));
  std::set<std::string> host = keys_of(running["hosts"][0]);
  host.insert("parts_loaded");
  EXPECT_EQ(keys_of(view["hosts"][0]), host);
  EXPECT_EQ(view["phase"], "stopped");
  EXPECT_EQ(view["paths_total"], 16 * 8);
  EXPECT_DOUBLE_EQ(view["host_s"].get<double>(), 8 + 4);
  EXPECT_DOUBLE_EQ(view["history"][0][2].get<double>(), 6) << "half of the time, half of the cost";
  EXPECT_EQ(view["hosts"][0]["left_s"], nullptr);
  EXPECT_EQ(view["hosts"][1]["lost"], true);
  EXPECT_EQ(view_of_report(report(), "a.pbrt", true)["paths_total"], 64);
}

TEST(FinishedFrame, TakesWhateverAReportIs) {
  const std::set<std::string> keys = keys_of(view_of_report(report(), "", true));
  for (const char* text : {"null", "[]", "3", R"({"hosts": 3, "time": []})", R"({"hosts": [3, {"name": 5, "left_s": "x", "lost": 1}], "convergence": [[], {}]})"})
    EXPECT_EQ(keys_of(view_of_report(Json::parse(text), "a.pbrt", true)), keys) << text;
  EXPECT_EQ(keys_of(view_of_report(Json::parse("{", nullptr, false), "a.pbrt", true)), keys);
}

TEST(FinishedFrame, StreamsAllPixels) {
  Image image{100, 70, {}};
  for (std::uint32_t i = 0; i < 7000; ++i) image.pixels.emplace_back(static_cast<float>(i % 512), static_cast<float>(i / 512), 1.f);
  const std::string path = (std::filesystem::temp_directory_path() / ("cloudrenderer_finished_" + std::to_string(getpid()) + ".exr")).string();
  write_image(path, image, {100, 70, 0, 0, 100, 70});
  const std::string stream = stream_of_picture(path, view_of_report(report(), "a.pbrt", true));
  std::filesystem::remove(path);
  std::vector<int> seen(7000);
  for (std::size_t at = 0; at < stream.size();) {
    std::uint32_t length = 0;
    std::memcpy(&length, stream.data() + at, 4);
    const std::string body = stream.substr(at + 5, length - 1);
    if (at == 0) {
      ASSERT_EQ(stream[4], static_cast<char>(FrameKind::job));
      EXPECT_EQ(Json::parse(body)["width"], 100) << "the picture's, whatever the report says";
    } else {
      ASSERT_EQ(stream[at + 4], static_cast<char>(FrameKind::tile));
      std::vector<std::uint32_t> words(body.size() / 4);
      std::memcpy(words.data(), body.data(), body.size());
      ASSERT_EQ(words.size(), 5 + words[2] * words[3]);
      for (std::uint32_t i = 0; i < words[2] * words[3]; ++i) {
        const std::uint32_t pixel = (words[1] + i / words[2]) * 100 + words[0] + i % words[2];
        ++seen.at(pixel);
        ASSERT_EQ(words[5 + i], pack_rgb9e5(image.pixels[pixel]));
      }
    }
    at += 4 + length;
  }
  EXPECT_EQ(seen, std::vector<int>(7000, 1));
  EXPECT_THROW(stream_of_picture(path, Json::object()), std::runtime_error);
}

}  // namespace
}  // namespace cloudrenderer
