#include <gtest/gtest.h>

#include "cli/report.h"

namespace cloudrenderer {
namespace {

RenderOutcome outcome() {
  RenderOutcome o;
  o.facts.settings.film.frame = {8, 4, 0, 0, 8, 4};
  o.film = std::make_unique<Film>(o.facts.settings.film.frame, 30);
  o.paths_done = 100;
  o.wire_bytes = 2500;
  o.render_s = 2;
  o.tail = 0.125;
  for (std::uint32_t i : {1u, 2u}) {
    ManagerCore::HostReport& h = o.hosts[HostId(i)];
    h.hello.set_name("host");
    h.hello.set_threads(2);
    h.last.mutable_counters()->set_camera(50);
    h.last.mutable_counters()->set_moved(10);
    h.last.mutable_counters()->set_busy_s(3);
  }
  o.hosts[HostId(2)].left = 1.5;
  return o;
}

TEST(Report, HasTheKeysOfTheContract) {
  const auto r = make_report(outcome(), "a.pbrt", ImageDifference{});
  for (const char* key : {"version", "scene", "width", "height", "spp", "parts", "time", "rays",
                          "wire", "invalid_samples", "clamped_samples", "bit_exact", "wasted_paths",
                          "copied_paths", "error", "convergence", "hosts"})
    EXPECT_TRUE(r.contains(key)) << key;
  const std::vector<std::pair<const char*, std::vector<const char*>>> nested{
      {"parts", {"count", "bytes", "triangles"}},
      {"time", {"wall_s", "load_s", "render_s", "cpu_s"}},
      {"rays", {"camera", "bounce", "shadow", "moved", "shadow_asked"}},
      {"wire", {"bytes", "bytes_per_path"}},
      {"error", {"estimated_relmse", "estimated_relmse_low", "estimated_relmse_high", "relmse", "relmse_trimmed", "mse"}}};
  for (const auto& [key, inner] : nested)
    for (const char* k : inner) EXPECT_TRUE(r[key].contains(k)) << key << "." << k;
  for (const char* key :
       {"name", "threads", "memory_budget", "memory_peak", "peak_rss", "parts_loaded", "busy",
        "bytes_sent", "bytes_received", "tasks", "retries", "joined_s", "left_s"})
    EXPECT_TRUE(r["hosts"][0].contains(key)) << key;
  for (const char* key : {"loader", "unloader", "renderer", "tracer", "aggregator", "intersection"})
    EXPECT_TRUE(r["hosts"][0]["tasks"].contains(key)) << key;
}

TEST(Report, SumsOverTheHosts) {
  const auto r = make_report(outcome(), "a.pbrt", std::nullopt);
  EXPECT_EQ(r["rays"]["camera"], 100);
  EXPECT_EQ(r["rays"]["moved"], 20);
  EXPECT_EQ(r["wire"]["bytes_per_path"], 25.0);
  EXPECT_EQ(r["tail"], 0.125);
  EXPECT_EQ(r["hosts"][0]["busy"], 0.75);
  EXPECT_TRUE(r["hosts"][0]["left_s"].is_null());
  EXPECT_EQ(r["hosts"][1]["left_s"], 1.5);
  EXPECT_FALSE(r["error"].contains("relmse")) << "there was no reference";
}

}  // namespace
}  // namespace cloudrenderer
