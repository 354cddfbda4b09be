// The command line of the service and of its users.
#include <gtest/gtest.h>

#include <cstdlib>

#include "cli/options.h"

namespace cloudrenderer {
namespace {

Command parse(std::vector<const char*> words) {
  words.insert(words.begin(), "cloudrenderer");
  return parse_command_line(static_cast<int>(words.size()), words.data());
}

class ServiceCommandLine : public ::testing::Test {
 protected:
  ServiceCommandLine() {
    setenv("CLOUDRENDERER_SERVICE", "http://farm:8080", 1);
    setenv("CLOUDRENDERER_USER_TOKEN", "mine", 1);
  }
  ~ServiceCommandLine() override {
    unsetenv("CLOUDRENDERER_SERVICE");
    unsetenv("CLOUDRENDERER_USER_TOKEN");
  }
};

TEST_F(ServiceCommandLine, SubmitTakesEveryOption) {
  const auto o = std::get<SubmitOptions>(parse({"submit", "a.pbrt", "b.pbrt", "--name", "n", "--priority", "-2", "--retries", "0", "--timeout", "60",
                                                "--budget", "2.5", "--on-budget", "ask", "--deadline", "1.5h", "--spp", "4", "--max-depth", "3", "--seed", "9", "--max-error",
                                                "0.5", "--resolution", "64x32", "--crop", "0,0.1,0.25,1", "--integrator", "path", "--light-paths", "all", "--dialect", "v3",
                                                "--part-size", "1MiB", "--wait", "--quiet"}));
  EXPECT_EQ(o.service.url, "http://farm:8080");
  EXPECT_EQ(o.service.token, "mine");
  EXPECT_EQ(o.scenes, (std::vector<std::string>{"a.pbrt", "b.pbrt"}));
  EXPECT_TRUE(o.wait && o.quiet && o.request.ask);
  EXPECT_EQ(o.request.priority, -2);
  EXPECT_EQ(o.request.retries, 0u);
  EXPECT_EQ(o.request.timeout_s, 60);
  EXPECT_EQ(o.request.budget, 2.5);
  EXPECT_EQ(o.request.deadline->at(100), 5500);
  const RenderSettings& s = o.request.settings;
  EXPECT_EQ(s.spp, 4u);
  EXPECT_EQ(s.max_depth, 3u);
  EXPECT_EQ(s.seed, 9u);
  EXPECT_EQ(s.max_error, 0.5);
  EXPECT_EQ(s.width, 64u);
  EXPECT_EQ(s.height, 32u);
  EXPECT_EQ(s.crop, (std::array<double, 4>{0, 0.1, 0.25, 1}));
  EXPECT_EQ(s.integrator + s.light_paths + s.dialect, "pathallv3");
  EXPECT_EQ(s.part_size, 1u << 20);
}

TEST_F(ServiceCommandLine, OtherCommandsNameTheirJob) {
  EXPECT_EQ(std::get<StatusOptions>(parse({"status"})).job, 0u);
  EXPECT_EQ(std::get<StatusOptions>(parse({"status", "3", "--service", "http://other"})).service.url, "http://other");
  EXPECT_EQ(std::get<FetchOptions>(parse({"fetch", "3", "-o", "x"})).output, "x");
  EXPECT_FALSE(std::get<FetchOptions>(parse({"fetch", "3"})).preview);
  EXPECT_TRUE(std::get<FetchOptions>(parse({"fetch", "3", "--preview"})).preview);
  EXPECT_EQ(std::get<CancelOptions>(parse({"cancel", "3"})).job, 3u);
  EXPECT_EQ(std::get<ChangeOptions>(parse({"change", "3", "--priority", "-2"})).priority, -2);
  EXPECT_THROW(parse({"change", "3"}), UsageError);
  EXPECT_EQ(std::get<RemoveOptions>(parse({"remove", "3"})).job, 3u);
  EXPECT_EQ(std::get<ResumeOptions>(parse({"resume", "3", "--budget", "7"})).budget, 7);
  EXPECT_EQ(std::get<LogsOptions>(parse({"logs", "3", "--frame", "2"})).frame, 2u);
  for (const char* command : {"fetch", "cancel", "change", "resume", "logs"}) EXPECT_THROW(parse({command}), UsageError) << command;
  EXPECT_THROW(parse({"cancel", "x"}), UsageError);
  EXPECT_THROW(parse({"submit"}), UsageError);
  EXPECT_THROW(parse({"submit", "a.pbrt", "--spp", "-1"}), UsageError);
  EXPECT_THROW(parse({"submit", "a.pbrt", "--deadline", "tomorrow"}), UsageError);
  EXPECT_TRUE(std::get<StatusOptions>(parse({"status", "--hosts"})).hosts);
  EXPECT_THROW(parse({"status", "3", "--hosts"}), UsageError);
  unsetenv("CLOUDRENDERER_USER_TOKEN");
  EXPECT_THROW(parse({"status"}), UsageError);
}

TEST_F(ServiceCommandLine, AManagerServesOrRendersAScene) {
  const auto o = std::get<ServeOptions>(parse({"manager", "--serve", "data", "--listen", "0.0.0.0:7000", "--advertise", "farm", "--api", "127.0.0.1:1",
                                               "--users", "u", "--prices", "p", "--jobs-at-once", "2", "--patience", "5", "--user-bytes", "1GiB",
                                               "--child-memory", "2GiB", "--tls", "on", "--lost-after", "9", "--keep", "30d", "--disk", "5GiB", "--ports", "7100-7101", "--min-hosts", "0",
                                               "--max-hosts", "6", "--host-start", "20", "--host-idle", "30"}));
  EXPECT_EQ(o.config.folder, "data");
  EXPECT_EQ(o.config.managers_host, "farm");
  EXPECT_EQ(o.listen.port, 7000);
  EXPECT_EQ(o.api.port, 1);
  EXPECT_EQ(o.users + o.prices, "up");
  EXPECT_EQ(o.config.scheduler.slots, 2u);
  EXPECT_EQ(o.config.scheduler.patience_s, 5);
  EXPECT_EQ(o.config.user_bytes, std::uint64_t{1} << 30);
  EXPECT_EQ(o.config.child_memory, std::uint64_t{2} << 30);
  EXPECT_EQ(o.config.tls.mode, TlsMode::on);
  EXPECT_EQ(o.lost_after_s, 9);
  const ElasticLimits& e = o.config.elastic;
  EXPECT_EQ(e.least, 0u);
  EXPECT_EQ(e.most, 6u);
  EXPECT_EQ(e.start_s, 20);
  EXPECT_EQ(e.worth_s, 80);
  EXPECT_EQ(e.idle_s, 30);
  EXPECT_EQ(e.jobs_at_once, 2u);
  EXPECT_THROW(parse({"manager", "--serve", "data", "--listen", "127.0.0.1:7000", "--min-hosts", "101"}), UsageError) << "above --max-hosts";
  EXPECT_EQ(o.config.rules.keep_s, 30 * 86400.0);
  EXPECT_EQ(o.config.rules.disk, std::uint64_t{5} << 30);
  EXPECT_EQ(o.config.manager_ports->to_string(), "7100-7101");
  for (const char* keep : {"0", "-1d", "d", "3w", "1e99"})
    EXPECT_THROW(parse({"manager", "--serve", "data", "--listen", "h:7000", "--keep", keep}), UsageError) << keep;
  for (const char* ports : {"7000", "7001-7000", "a-b", "1-2-3", "0-9", "65530-65536", "7000-7002"})  // four are needed
    EXPECT_THROW(parse({"manager", "--serve", "data", "--listen", "h:7000", "--ports", ports}), UsageError) << ports;
  EXPECT_THROW(parse({"manager", "--serve", "data", "--listen", ":7000"}), UsageError) << "workers could not find it";
  EXPECT_THROW(parse({"manager", "a.pbrt", "--serve", "data", "--listen", "127.0.0.1:7000"}), UsageError);
  EXPECT_THROW(parse({"manager", "--listen", "127.0.0.1:7000"}), UsageError) << "neither";
}

}  // namespace
}  // namespace cloudrenderer
