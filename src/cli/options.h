#pragma once
// The command line as plain values.
#include <optional>
#include <set>
#include <string>
#include <variant>
#include <vector>

#include "cluster/render.h"
#include "cluster/worker.h"
#include "service/client.h"
#include "service/service.h"
#include "simulate/cluster_plan.h"

namespace cloudrenderer {

struct LogOptions {
  std::string file, level = "warn";
};

struct RenderOptions {  // render and manager
  RenderRequest request;
  std::string output;  // "": from the scene
  std::string reference, report, token_file;
  std::optional<Address> web, display;
  std::set<std::string> layers;  // beside R G B
  bool quiet = false;
  std::vector<std::string> command_line;
  int parent = 0;  // a process to die with; 0: none
  LogOptions log;
};

struct SplitCommand {
  std::string scene, output, report;
  int parent = 0;
  SplitOptions options;
};

struct WorkerOptionsGiven {
  WorkerConfig config;
  std::string token_file;
  int parent = 0;  // a process to die with; 0: none
  LogOptions log;
};

struct CompareOptions {
  std::string a, b;
  std::optional<double> max_relmse;
};

struct InfoOptions {
  std::string scene;
  bool language = false;  // print docs/language.md instead
  std::optional<Dialect> dialect;
  std::string confine;
};

struct SimulateOptions {
  std::string model;   // the report of a render with --sample-paths
  std::string report;  // to write
  std::vector<std::uint32_t> hosts{1, 2, 4, 8, 16, 32, 64, 128, 256, 512, 1024};
  std::uint32_t width = 0, height = 0, spp = 0;  // 0: the render's
  std::uint64_t triangles = 0;                   // likewise
  sim::ClusterPlan plan;
};

struct HelpText {  // asked for: printed, exit code 0
  std::string text;
};

struct ServeOptions {
  ServiceConfig config;
  Address listen, api;
  std::string users, prices;  // files; "": none
  double lost_after_s = 3;
  LogOptions log;
};

struct SubmitOptions {
  ServiceAddress service;
  std::vector<std::string> scenes;
  JobRequest request;  // user, scene and files apart
  double check_s = 60;  // to wait at most until it is known whether the job can fit
  bool wait = false, quiet = false;
};
struct StatusOptions {
  ServiceAddress service;
  std::uint64_t job = 0;  // 0: all
  bool hosts = false;     // hosts instead of jobs
};
struct FetchOptions {
  ServiceAddress service;
  std::uint64_t job = 0;
  std::string output;
  bool preview = false;  // of frames that are not done what there is
};
struct RemoveOptions {
  ServiceAddress service;
  std::uint64_t job = 0;
};
struct CancelOptions {
  ServiceAddress service;
  std::uint64_t job = 0;
};
struct ChangeOptions {
  ServiceAddress service;
  std::uint64_t job = 0;
  int priority = 0;
};
struct ResumeOptions {
  ServiceAddress service;
  std::uint64_t job = 0;
  std::optional<double> budget;
};
struct LogsOptions {
  ServiceAddress service;
  std::uint64_t job = 0;
  std::optional<std::uint64_t> frame;
};

using Command = std::variant<RenderOptions, SplitCommand, WorkerOptionsGiven, CompareOptions, InfoOptions, SimulateOptions, ServeOptions,
                             SubmitOptions, StatusOptions, FetchOptions, CancelOptions, ChangeOptions, RemoveOptions, ResumeOptions, LogsOptions, HelpText>;

// Throws UsageError.
Command parse_command_line(int argc, const char* const* argv);

}  // namespace cloudrenderer
