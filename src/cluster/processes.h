#pragma once
#include <sys/types.h>

#include <chrono>
#include <string>
#include <vector>

namespace cloudrenderer {

// Child processes of this program, by their ids. What still runs is killed when this goes. Start
// them from a thread that outlives them: the system ends a child with the thread that made it (see
// die_with_parent).
class ChildProcesses {
 public:
  ChildProcesses() = default;
  ~ChildProcesses();
  ChildProcesses(const ChildProcesses&) = delete;
  ChildProcesses& operator=(const ChildProcesses&) = delete;

  // Runs this very program with the arguments, in a process group of its own so that Ctrl-C reaches
  // only us.
  void start(const std::vector<std::string>& arguments);  // throws ClusterError
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
