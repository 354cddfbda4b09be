#include <gtest/gtest.h>

#include "cli/options.h"
#include "cli/progress.h"
#include "cli/size.h"
#include "cluster/usage.h"

namespace cloudrenderer {
namespace {

Command parse(std::vector<const char*> words) {
  words.insert(words.begin(), "cloudrenderer");
  return parse_command_line(static_cast<int>(words.size()), words.data());
}

TEST(Size, ReadsUnitsAndFractions) {
  EXPECT_EQ(parse_size("64MiB"), 64u << 20);
  EXPECT_EQ(parse_size("4GiB"), std::uint64_t{4} << 30);
  EXPECT_EQ(parse_size("512MB"), 512'000'000u);
  EXPECT_EQ(parse_size("100"), 100u);
  EXPECT_EQ(parse_size("1.5 kib"), 1536u);
  EXPECT_EQ(parse_size("2t"), 2'000'000'000'000u);
}

TEST(Size, RefusesWhatIsNone) {
  for (const char* text :
       {"", "MiB", "-1MiB", "12 parsecs", "1e400", "nan", "0", "64MiBs", "9999999999TiB"})
    EXPECT_THROW(parse_size(text), UsageError) << text;
}

TEST(Size, IsWrittenForPeople) {
  EXPECT_EQ(format_size(100), "100 bytes");
  EXPECT_EQ(format_size(3 << 19), "1.5 MiB");
}

TEST(CommandLine, RenderHasTheDefaultsOfTheContract) {
  const auto o = std::get<RenderOptions>(parse({"render", "a.pbrt"}));
  EXPECT_EQ(o.request.scene, "a.pbrt");
  EXPECT_EQ(o.request.hosts, 1u);
  EXPECT_EQ(o.request.replication, 1u);
  EXPECT_EQ(o.request.threads, available_threads());
  EXPECT_EQ(o.request.split.part_size, 64u << 20);
  EXPECT_EQ(o.request.overrides.seed, 0u);
  EXPECT_FALSE(o.request.overrides.spp);
  EXPECT_FALSE(o.request.listen);
  EXPECT_NEAR(static_cast<double>(o.request.memory), 0.8 * static_cast<double>(available_memory()),
              10);
}

TEST(CommandLine, HostsOfOneMachineShareItsMemoryByDefault) {
  const auto o = std::get<RenderOptions>(parse({"render", "a.pbrt", "--hosts", "4"}));
  EXPECT_NEAR(static_cast<double>(o.request.memory), 0.2 * static_cast<double>(available_memory()),
              10);
}

TEST(CommandLine, RenderTakesEveryOption) {
  const auto o = std::get<RenderOptions>(parse({"render",
                                                "a.pbrt",
                                                "-o",
                                                "b.exr",
                                                "--hosts",
                                                "3",
                                                "--threads",
                                                "2",
                                                "--memory",
                                                "1GiB",
                                                "--replication",
                                                "2",
                                                "--part-size",
                                                "1MiB",
                                                "--spp",
                                                "16",
                                                "--max-depth",
                                                "0",
                                                "--resolution",
                                                "640x480",
                                                "--seed",
                                                "7",
                                                "--max-error",
                                                "0.01",
                                                "--max-time",
                                                "2.5",
                                                "--reference",
                                                "r.exr",
                                                "--report",
                                                "r.json",
                                                "--quiet",
                                                "--crop",
                                                "0,0.5,0.25,1",
                                                "--integrator",
                                                "path",
                                                "--dialect",
                                                "v3",
                                                "--alpha",
                                                "0.5"}));
  const JobOverrides& j = o.request.overrides;
  EXPECT_EQ(o.output, "b.exr");
  EXPECT_EQ(o.request.hosts, 3u);
  EXPECT_EQ(o.request.memory, 1u << 30);
  EXPECT_EQ(j.spp, 16u);
  EXPECT_EQ(j.max_depth, 0u);
  EXPECT_EQ(j.width, 640u);
  EXPECT_EQ(j.height, 480u);
  EXPECT_EQ(j.seed, 7u);
  EXPECT_EQ(o.request.max_error, 0.01);
  EXPECT_EQ(o.request.max_time_s, 2.5);
  EXPECT_EQ(j.crop, (std::array<float, 4>{0, 0.5f, 0.25f, 1}));
  EXPECT_EQ(o.request.split.dialect, Dialect::v3);
  EXPECT_TRUE(o.quiet);
}

TEST(CommandLine, WrongUsageIsSaid) {
  const std::vector<std::vector<const char*>> wrong{
      {},
      {"paint"},
      {"render"},
      {"render", "a", "--no-such-option"},
      {"render", "a", "--spp", "0"},
      {"render", "a", "--spp", "-1"},
      {"render", "a", "--spp", "many"},
      {"render", "a", "--hosts", "0"},
      {"render", "a", "--threads", "0"},
      {"render", "a", "--memory", "much"},
      {"render", "a", "--resolution", "640"},
      {"render", "a", "--resolution", "0x5"},
      {"render", "a", "--crop", "0,1,1,0"},
      {"render", "a", "--crop", "0,1"},
      {"render", "a", "--crop", "0,nan,0,1"},
      {"render", "a", "--dialect", "v5"},
      {"render", "a", "--max-error", "nan"},
      {"render", "a", "--log-level", "loud"},
      {"manager", "a"},
      {"manager", "a", "--listen", "nowhere"},
      {"worker"},
      {"worker", "--manager", ":7800"},
      {"worker", "--manager", "a:1", "--tls", "perhaps"},
      {"worker", "--manager", "a:1", "--token", "on the command line"},
      {"split", "a"},
      {"compare", "a"},
  };
  for (const auto& words : wrong) {
    std::string line;
    for (const char* w : words) line += std::string(w) + " ";
    EXPECT_THROW(parse(words), UsageError) << line;
  }
}

TEST(CommandLine, WorkerAndManagerFindEachOther) {
  const auto m = std::get<RenderOptions>(
      parse({"manager", "a.pbrt", "--listen", ":7800", "--min-hosts", "2", "--wait", "5"}));
  EXPECT_EQ(m.request.listen, (Address{"", 7800}));
  EXPECT_EQ(m.request.min_hosts, 2u);
  EXPECT_EQ(m.request.wait_s, 5.0);
  const auto w = std::get<WorkerOptionsGiven>(
      parse({"worker", "--manager", "big:7800", "--advertise", "me:1", "--memory", "2GiB"}));
  EXPECT_EQ(w.config.manager, (Address{"big", 7800}));
  EXPECT_EQ(w.config.advertise, (Address{"me", 1}));
  EXPECT_EQ(w.config.memory, std::uint64_t{2} << 30);
}

TEST(CommandLine, EncryptionIsAutomaticUnlessSaid) {
  const auto mode = [](const std::vector<const char*>& words) {
    return std::get<WorkerOptionsGiven>(parse(words)).config.tls.mode;
  };
  EXPECT_EQ(mode({"worker", "--manager", "a:1"}), TlsMode::automatic);
  EXPECT_EQ(mode({"worker", "--manager", "a:1", "--tls", "auto"}), TlsMode::automatic);
  EXPECT_EQ(mode({"worker", "--manager", "a:1", "--tls", "on"}), TlsMode::on);
  EXPECT_EQ(mode({"worker", "--manager", "a:1", "--tls", "off"}), TlsMode::off);
  const auto m = std::get<RenderOptions>(parse(
      {"manager", "a", "--listen", ":1", "--tls-cert", "c", "--tls-key", "k", "--tls-ca", "ca"}));
  EXPECT_EQ(m.request.tls.certificate, "c");
  EXPECT_EQ(m.request.tls.key, "k");
  EXPECT_EQ(m.request.tls.authority, "ca");
}

TEST(CommandLine, HelpAndVersionAreNoErrors) {
  EXPECT_NE(std::get<HelpText>(parse({"--help"})).text.find("render"), std::string::npos);
  EXPECT_NE(std::get<HelpText>(parse({"render", "--help"})).text.find("--spp"), std::string::npos);
  EXPECT_NE(std::get<HelpText>(parse({"--version"})).text.find("cloudrenderer"), std::string::npos);
}

TEST(Progress, SaysWhatPeopleAskFor) {
  RenderProgress p;
  p.phase = ManagerCore::Phase::rendering;
  p.render_s = 10;
  p.paths_done = 20'000'000;
  p.paths_total = 80'000'000;
  p.hosts = 2;
  p.estimate = Film::ErrorEstimate{.relmse = 0.0123, .low = 0.0111, .high = 0.0142};
  EXPECT_EQ(describe(p),
            " 25.0 %  0:10, 0:30 to go, 2.00 M samples/s, 2 hosts, relMSE about 0.012 (0.011 to 0.014)");
}

}  // namespace
}  // namespace cloudrenderer
