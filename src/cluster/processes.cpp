#include "cluster/processes.h"

#include <fcntl.h>
#include <signal.h>
#include <spawn.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cstring>
#include <string_view>
#include <thread>

#include "base/error.h"

extern char** environ;

namespace cloudrenderer {

namespace {

void limit(pid_t pid, __rlimit_resource what, std::uint64_t most) {
  const rlimit value{most, most};
  prlimit(pid, what, &value, nullptr);
}

// Ours, with `more` in front of and instead of what has the same names.
std::vector<char*> environment_with(std::vector<std::string>& more) {
  std::vector<char*> out;
  for (std::string& entry : more) out.push_back(entry.data());
  for (char** entry = environ; *entry; ++entry) {
    const std::string_view old = *entry;
    const auto same_name = [&](const std::string& m) { return old.starts_with(m.substr(0, m.find('=') + 1)); };
    if (std::none_of(more.begin(), more.end(), same_name)) out.push_back(*entry);
  }
  out.push_back(nullptr);
  return out;
}

}  // namespace

pid_t spawn_self(const std::vector<std::string>& arguments, const SpawnOptions& options) {
  std::string program = "/proc/self/exe";
  std::vector<char*> argv{program.data()};
  std::vector<std::string> held = arguments, more = options.environment;
  for (std::string& a : held) argv.push_back(a.data());
  argv.push_back(nullptr);

  posix_spawnattr_t attributes;
  posix_spawnattr_init(&attributes);
  sigset_t none;
  sigemptyset(&none);
  posix_spawnattr_setsigmask(&attributes, &none);
  posix_spawnattr_setpgroup(&attributes, 0);
  posix_spawnattr_setflags(&attributes, POSIX_SPAWN_SETSIGMASK | POSIX_SPAWN_SETPGROUP);
  posix_spawn_file_actions_t files;
  posix_spawn_file_actions_init(&files);
  if (!options.output.empty()) {
    posix_spawn_file_actions_addopen(&files, STDIN_FILENO, "/dev/null", O_RDONLY, 0);
    posix_spawn_file_actions_addopen(&files, STDOUT_FILENO, options.output.c_str(), O_WRONLY | O_CREAT | O_APPEND, 0600);
    posix_spawn_file_actions_adddup2(&files, STDOUT_FILENO, STDERR_FILENO);
  }
  if (!options.folder.empty()) posix_spawn_file_actions_addchdir_np(&files, options.folder.c_str());
  pid_t pid = 0;
  const int error = posix_spawn(&pid, program.c_str(), &files, &attributes, argv.data(), environment_with(more).data());
  posix_spawn_file_actions_destroy(&files);
  posix_spawnattr_destroy(&attributes);
  if (error != 0)
    throw ClusterError(std::string("cannot start a process on this machine: ") + std::strerror(error));
  // The child may run already, but not for long enough to take much.
  if (options.memory != 0) limit(pid, RLIMIT_DATA, options.memory);
  if (options.file_size != 0) limit(pid, RLIMIT_FSIZE, options.file_size);
  if (options.nice != 0) setpriority(PRIO_PROCESS, static_cast<id_t>(pid), getpriority(PRIO_PROCESS, 0) + options.nice);
  return pid;
}

ChildProcesses::~ChildProcesses() {
  for (const pid_t pid : pids_) kill(pid, SIGKILL);
  for (const pid_t pid : pids_) waitpid(pid, nullptr, 0);
}

void ChildProcesses::start(const std::vector<std::string>& arguments) { pids_.push_back(spawn_self(arguments)); }

std::size_t ChildProcesses::alive() {
  std::erase_if(pids_, [](pid_t pid) { return waitpid(pid, nullptr, WNOHANG) == pid; });
  return pids_.size();
}

void ChildProcesses::wait(std::chrono::milliseconds patience) {
  constexpr auto kLook = std::chrono::milliseconds(5);
  const auto deadline = std::chrono::steady_clock::now() + patience;
  while (alive() > 0 && std::chrono::steady_clock::now() < deadline)
    std::this_thread::sleep_for(kLook);
  for (const pid_t pid : pids_) kill(pid, SIGKILL);
  for (const pid_t pid : pids_) waitpid(pid, nullptr, 0);
  pids_.clear();
}

void die_with_parent(pid_t parent) {
  prctl(PR_SET_PDEATHSIG, SIGKILL);
  if (getppid() != parent) _exit(1);
}

}  // namespace cloudrenderer
