#include "cli/progress.h"

#include <spdlog/fmt/fmt.h>
#include <unistd.h>

#include <algorithm>

namespace cloudrenderer {
namespace {

constexpr double kPlainEvery = 10;  // seconds between lines that stay

std::string clock_text(double seconds) {
  const auto s = static_cast<long>(seconds + 0.5);
  return s >= 3600 ? fmt::format("{}:{:02}:{:02}", s / 3600, s / 60 % 60, s % 60)
                   : fmt::format("{}:{:02}", s / 60, s % 60);
}

std::string rate_text(double per_second) {
  if (per_second >= 1e6) return fmt::format("{:.2f} M ", per_second / 1e6);
  if (per_second >= 1e3) return fmt::format("{:.1f} k ", per_second / 1e3);
  return fmt::format("{:.0f} ", per_second);
}

}  // namespace

std::string describe(const RenderProgress& p) {
  switch (p.phase) {
    case ManagerCore::Phase::gathering:
      return p.hosts == 0 ? "waiting for hosts"
                          : fmt::format("waiting for more hosts, {} there", p.hosts);
    case ManagerCore::Phase::loading:
      return fmt::format("{} {} loading", p.hosts, p.hosts == 1 ? "host is" : "hosts are");
    case ManagerCore::Phase::rendering:
      break;
    default:
      return "finishing";
  }
  const double done = p.paths_total == 0
                          ? 0
                          : static_cast<double>(p.paths_done) / static_cast<double>(p.paths_total);
  std::string text = fmt::format("{:5.1f} %  {}", 100 * done, clock_text(p.render_s));
  const auto made = static_cast<double>(p.paths_done - p.paths_restored);  // by this run
  const auto left = static_cast<double>(p.paths_total - p.paths_done);
  if (made > 0.001 * (made + left) && p.render_s > 0.2)
    text += fmt::format(", {} to go", clock_text(p.render_s / made * left));
  if (p.render_s > 0.2) text += fmt::format(", {}samples/s", rate_text(made / p.render_s));
  text += p.hosts == 0 ? ", waiting for hosts"
                       : fmt::format(", {} {}", p.hosts, p.hosts == 1 ? "host" : "hosts");
  if (p.estimate && p.estimate->relmse > 0)
    text += fmt::format(", relMSE about {:.2g} ({:.2g} to {:.2g})", p.estimate->relmse, p.estimate->low, p.estimate->high);
  return text;
}

ProgressDisplay::ProgressDisplay(std::FILE* out, bool quiet)
    : out_(out), quiet_(quiet), terminal_(isatty(fileno(out)) != 0) {}

void ProgressDisplay::show(const RenderProgress& progress) {
  if (quiet_) return;
  if (!terminal_) {
    if (progress.elapsed_s < next_) return;
    if (next_ > 0) fmt::print(out_, "{}\n", describe(progress));
    next_ = progress.elapsed_s + kPlainEvery;
  } else {
    fmt::print(out_, "\r\x1b[K{}", describe(progress));
    line_open_ = true;
  }
  std::fflush(out_);
}

void ProgressDisplay::finish() {
  if (!line_open_) return;
  fmt::print(out_, "\r\x1b[K");
  std::fflush(out_);
  line_open_ = false;
}

}  // namespace cloudrenderer
