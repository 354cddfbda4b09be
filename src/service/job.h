#pragma once
// What users ask of the service, and how far it is: plain values.
#include <array>
#include <compare>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

namespace cloudrenderer {

enum class JobState : std::uint8_t { checking, queued, running, paused, done, failed, cancelled };
enum class FrameState : std::uint8_t { waiting, splitting, ready, running, done, failed, cancelled };
const char* name(JobState state);
const char* name(FrameState state);
inline bool is_final(JobState s) { return s == JobState::done || s == JobState::failed || s == JobState::cancelled; }
inline bool is_final(FrameState s) { return s == FrameState::done || s == FrameState::failed || s == FrameState::cancelled; }

// What a job, or a user, has used.
struct Usage {
  double cpu_s = 0, memory_byte_s = 0, bytes = 0, rays = 0, host_s = 0, cost = 0;
  double service_cpu_s = 0;  // of the processes that split its scenes and manage its frames, on the service's machine
  void add(const Usage& other);
};

// As on the command line of `render`; what is not given comes from the scene.
struct RenderSettings {
  std::optional<std::uint32_t> spp, max_depth, seed, width, height;
  std::optional<std::array<double, 4>> crop;
  std::optional<double> max_error;
  std::string integrator, dialect, light_paths;  // empty: by the scene
  std::uint64_t part_size = 0;  // 0: the default
  bool operator==(const RenderSettings&) const = default;
};

// By when the user wants a job; it asks for hosts, and is not enforced.
struct Deadline {
  double seconds = 0;
  bool from_now = false;  // from the submission; else Unix time
  std::string text;       // as it was given
  double at(double now) const { return from_now ? now + seconds : seconds; }
};
// "90", "30s", "45m", "2h", "1d" or an ISO 8601 time, "2026-03-01T18:00:00Z" or with an offset like +01:00.
std::optional<Deadline> parse_deadline(const std::string& text);

struct JobRequest {
  std::string name, user, scene;   // the id of a scene of the user
  std::vector<std::string> files;  // of the scene, one a frame
  int priority = 0;
  std::uint32_t retries = 2;        // of a frame
  std::optional<double> timeout_s;  // of a try of a frame
  std::optional<double> budget;     // money; the job stops when it is used up
  bool ask = false;                 // beyond the budget: wait for `resume` instead of failing
  std::optional<Deadline> deadline;
  RenderSettings settings;
};

// What a frame takes of a host at least, as its split says.
struct FrameNeeds {
  std::uint64_t main_bytes = 0, largest_bytes = 0, bytes = 0;  // main scene; largest part with what its build takes; all
  std::uint32_t parts = 0;
  std::uint64_t triangles = 0;
  std::uint64_t pixels = 0;  // of the picture and samples of each, as the scene says; 0: not known
  std::uint32_t spp = 0;
  std::uint64_t least() const { return main_bytes + largest_bytes; }
};

struct JobFrame {
  std::string file;
  FrameState state = FrameState::waiting;
  std::string reason;         // why it failed, or is tried again
  std::uint32_t attempts = 0; // that have ended badly, or that runs
  double not_before = 0;      // of the next attempt
  std::optional<double> started, ended;  // Unix time
  std::optional<FrameNeeds> needs;
  Usage usage;
};

struct Job {
  std::uint64_t id = 0;
  JobRequest request;
  JobState state = JobState::checking;
  std::string reason;
  bool over_budget = false;  // why it is paused or has failed: it can be resumed
  double submitted = 0;
  std::optional<double> deadline;  // Unix time
  std::optional<double> started, ended;
  std::vector<JobFrame> frames;
  Usage usage() const;  // of all frames
};

struct FrameRef {
  std::uint64_t job = 0;
  std::uint32_t frame = 0;
  auto operator<=>(const FrameRef&) const = default;
};

}  // namespace cloudrenderer
