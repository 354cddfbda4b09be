#pragma once
#include <sys/types.h>

#include <chrono>
#include <cstdint>
#include <string>
#include <vector>

namespace cloudrenderer {

struct SpawnOptions {
  std::string folder;  // to run in; "": ours
  std::string output;  // file that standard output and error are appended to; "": ours. Standard input is empty then
  std::vector<std::string> environment;  // "NAME=value", beside ours or in place of it
  std::uint64_t memory = 0;     // bytes of private memory at most; 0: no limit
  std::uint64_t file_size = 0;  // of a file that it writes; 0: no limit
  int nice = 0;  // beside ours
};
// Runs this very program with the arguments, in a process group of its own so that Ctrl-C reaches only us. Throws
// ClusterError.
pid_t spawn_self(const std::vector<std::string>& arguments, const SpawnOptions& options = {});

// Child processes of this program, by their ids. What still runs is killed when this goes. Start
// them from a thread that outlives them: the system ends a child with the thread that made it (see
// die_with_parent).
class ChildProcesses {
 public:
  ChildProcesses() = default;
  ~ChildProcesses();
  ChildProcesses(const ChildProcesses&) = delete;
  ChildProcesses& operator=(const ChildProcesses&) = delete;

  void start(const std::vector<std::string>& arguments);  // as spawn_self
  std::size_t alive();                                    // collects those that have ended
  void wait(std::chrono::milliseconds patience);          // then kills
  const std::vector<pid_t>& running() const { return pids_; }

 private:
  std::vector<pid_t> pids_;
};

// Asks the system to kill this process when its parent ends; ends at once when `parent` has ended
// already.
void die_with_parent(pid_t parent);

}  // namespace cloudrenderer
