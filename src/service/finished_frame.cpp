#include "service/finished_frame.h"

#include <algorithm>

#include "film/film.h"
#include "web/tiles.h"

namespace cloudrenderer {
namespace {

constexpr std::uint32_t kTile = 64;

// The value at a path of keys, or null: a report may be of another version.
Json at(const Json& json, std::initializer_list<const char*> keys) {
  const Json* here = &json;
  for (const char* key : keys) {
    if (!here->is_object() || !here->contains(key)) return nullptr;
    here = &here->at(key);
  }
  return *here;
}

double number(const Json& json) { return json.is_number() ? json.get<double>() : 0; }

Json or_zero(Json json) { return json.is_number() ? std::move(json) : Json(0); }

Json host_view(const Json& h, std::size_t id, double wall_s) {
  const Json left = at(h, {"left_s"});
  const bool lost = at(h, {"lost"}).is_boolean() && h.at("lost").get<bool>();
  return {{"id", id},
          {"name", at(h, {"name"})},
          {"address", ""},
          {"version", ""},
          {"threads", or_zero(at(h, {"threads"}))},
          {"memory_budget", or_zero(at(h, {"memory_budget"}))},
          {"memory_used", or_zero(at(h, {"memory_peak"}))},
          {"joined_s", number(at(h, {"joined_s"}))},
          {"left_s", left.is_number() && number(left) < wall_s - 1 ? left : Json(nullptr)},
          {"lost", lost},
          {"paths_done", or_zero(at(h, {"paths_done"}))},
          {"live_paths", 0},
          {"load_s", 0},
          {"busy", number(at(h, {"busy"}))},
          {"cpu_s", 0},
          {"bytes_sent", or_zero(at(h, {"bytes_sent"}))},
          {"bytes_received", or_zero(at(h, {"bytes_received"}))},
          {"parts", Json::array()},
          {"parts_loaded", or_zero(at(h, {"parts_loaded"}))}};
}

}  // namespace

Json view_of_report(const Json& report, const std::string& file, bool done) {
  const double wall = number(at(report, {"time", "wall_s"})), render = number(at(report, {"time", "render_s"}));
  Json hosts = Json::array(), history = Json::array();
  double host_s = 0, threads = 0;
  if (const Json list = at(report, {"hosts"}); list.is_array())
    for (const Json& h : list) {
      hosts.push_back(host_view(h, hosts.size() + 1, wall));
      const double joined = number(hosts.back()["joined_s"]), left = number(at(h, {"left_s"}));
      host_s += std::max(0.0, (left > 0 ? std::min(left, wall) : wall) - joined);
      threads += number(hosts.back()["threads"]);
    }
  // The cost of an earlier moment is not in the report: time, with the hosts there were on average.
  if (const Json list = at(report, {"convergence"}); list.is_array())
    for (const Json& p : list) {
      const double share = render > 0 ? std::min(1.0, number(at(p, {"render_s"})) / render) : 0;
      history.push_back({number(at(p, {"render_s"})), number(at(p, {"spp"})), share * host_s, share * number(at(report, {"time", "cpu_s"})),
                         number(at(p, {"estimated_relmse"}))});
    }
  const double pixels = number(at(report, {"width"})) * number(at(report, {"height"}));
  const double asked = number(at(report, {"spp_asked"}));
  return {{"id", 1},
          {"scene", file},
          {"phase", done ? "done" : "stopped"},
          {"waiting_for", ""},
          {"width", or_zero(at(report, {"width"}))},
          {"height", or_zero(at(report, {"height"}))},
          {"spp", or_zero(at(report, {"spp_asked"}))},
          {"parts", or_zero(at(report, {"parts", "count"}))},
          {"triangles", or_zero(at(report, {"parts", "triangles"}))},
          {"elapsed_s", wall},
          {"render_s", render},
          {"paths_done", number(at(report, {"paths"}))},
          {"paths_total", done ? number(at(report, {"paths"})) : asked * pixels},
          {"estimated_relmse", at(report, {"error", "estimated_relmse"})},
          {"estimated_relmse_low", at(report, {"error", "estimated_relmse_low"})},
          {"estimated_relmse_high", at(report, {"error", "estimated_relmse_high"})},
          {"invalid_samples", or_zero(at(report, {"invalid_samples"}))},
          {"paged_parts", 0},
          {"bit_exact", at(report, {"bit_exact"}) != Json(false)},
          {"threads", threads},
          {"host_s", host_s},
          {"cpu_s", number(at(report, {"time", "cpu_s"}))},
          {"tasks", Json::object()},
          {"hosts", hosts},
          {"hosts_ever", hosts.size()},
          {"history", std::move(history)}};
}

std::string stream_of_picture(const std::string& picture, Json view) {
  const Image image = read_image(picture);
  view["width"] = image.width;
  view["height"] = image.height;
  std::string out;
  append_frame(out, FrameKind::job, dump(view));
  std::vector<Rgb> pixels;
  for (std::uint32_t y0 = 0; y0 < image.height; y0 += kTile)
    for (std::uint32_t x0 = 0; x0 < image.width; x0 += kTile) {
      const TileBox box{x0, y0, std::min(image.width, x0 + kTile), std::min(image.height, y0 + kTile), 0};
      pixels.clear();
      for (std::uint32_t y = y0; y < box.y1; ++y)
        for (std::uint32_t x = x0; x < box.x1; ++x) pixels.push_back(image.pixels[std::size_t{y} * image.width + x]);
      append_frame(out, FrameKind::tile, encode_tile(box, pixels));
    }
  return out;
}

}  // namespace cloudrenderer
