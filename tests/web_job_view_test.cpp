#include "web/job_view.h"

#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "web/page.h"

namespace cloudrenderer {
namespace {

JobView job_of_two_hosts() {
  JobView job;
  job.scene = "a \"scene\".pbrt";
  job.phase = "rendering";
  job.width = 4;
  job.height = 2;
  job.spp = 16;
  job.progress.elapsed_s = 10;
  job.progress.render_s = 8;
  job.progress.paths_done = 32;
  job.progress.paths_total = 128;
  HostView a;
  a.id = 1;
  a.name = "here";
  a.threads = 2;
  a.joined_s = 2;
  a.parts = {1, 3};
  a.status.mutable_counters()->set_cpu_s(7);
  a.status.mutable_counters()->set_busy_s(8);
  a.status.mutable_counters()->set_camera(32);
  for (int i = 1; i <= 6; ++i) a.status.add_tasks_in_state(static_cast<unsigned>(i));
  HostView gone = a;
  gone.id = 2;
  gone.name = "gone\nhost";
  gone.left_s = 5;
  gone.lost = true;
  job.hosts = {a, gone};
  return job;
}

TEST(JobJson, SaysWhoIsThereWhatItCostAndWhatIsWaitedFor) {
  const auto json = to_json(job_of_two_hosts());
  EXPECT_EQ(json["scene"], "a \"scene\".pbrt");
  EXPECT_EQ(json["estimated_relmse"], nullptr) << "not known yet";
  EXPECT_DOUBLE_EQ(json["host_s"].get<double>(), 8 + 3);
  EXPECT_DOUBLE_EQ(json["cpu_s"].get<double>(), 14);
  EXPECT_EQ(json["threads"], 2) << "of hosts that are there";
  EXPECT_EQ(json["tasks"]["running"], 3) << "of hosts that are there";
  EXPECT_EQ(json["tasks"].size(), 6u);
  EXPECT_EQ(json["hosts"][0]["left_s"], nullptr);
  EXPECT_EQ(json["hosts"][0]["parts"], (std::vector<int>{1, 3}));
  EXPECT_DOUBLE_EQ(json["hosts"][0]["busy"].get<double>(), 0.5);
  EXPECT_EQ(json["hosts"][1]["lost"], true);
}

TEST(Metrics, AreInPrometheussFormat) {
  const std::string text = metrics_text(job_of_two_hosts());
  const auto has = [&](const char* line) { EXPECT_NE(text.find(std::string("\n") + line + "\n"), std::string::npos) << line << " in\n" << text; };
  has("# TYPE cloudrenderer_paths_total counter");
  has("cloudrenderer_paths_total 32");
  has("cloudrenderer_host_seconds_total 11");
  has("cloudrenderer_phase{phase=\"rendering\"} 1");
  has("cloudrenderer_phase{phase=\"done\"} 0");
  has("cloudrenderer_host_up{host=\"2\",name=\"gone\\nhost\"} 0");
  has("cloudrenderer_rays_total{host=\"1\",name=\"here\",kind=\"camera\"} 32");
  EXPECT_EQ(text.find("estimated_relmse"), std::string::npos) << "not known yet";
}

TEST(History, StaysShortAndKeepsItsEnds) {
  std::vector<CostPoint> history;
  for (int i = 0; i < 5000; ++i) {
    CostPoint p;
    p.render_s = i;
    add_point(history, p);
    ASSERT_LE(history.size(), 512u);
    ASSERT_EQ(history.back().render_s, i);
    ASSERT_EQ(history.front().render_s, 0);
    for (std::size_t k = 1; k < history.size(); ++k) ASSERT_LT(history[k - 1].render_s, history[k].render_s);
  }
}

TEST(Page, IsOneFileThatAsksNobodyElse) {
  EXPECT_TRUE(kPage.starts_with("<!doctype html>"));
  EXPECT_TRUE(kPage.ends_with("</html>\n"));
  // The only address in it names the language of its drawings.
  const std::size_t first = kPage.find("http://");
  EXPECT_EQ(kPage.substr(first, 26), "http://www.w3.org/2000/svg");
  EXPECT_EQ(kPage.find("http://", first + 1), std::string_view::npos);
  EXPECT_EQ(kPage.find("https://"), std::string_view::npos);
}

}  // namespace
}  // namespace cloudrenderer
