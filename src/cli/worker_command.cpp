#include <unistd.h>

#include <climits>

#include "cli/commands.h"
#include "cluster/processes.h"
#include "net/handshake.h"

namespace cloudrenderer {

int run_worker_command(const WorkerOptionsGiven& options, Interrupts& interrupts) {
  if (options.parent > 0) die_with_parent(options.parent);
  WorkerConfig config = options.config;
  config.token = read_token(options.token_file);
  if (config.name.empty()) {
    char name[HOST_NAME_MAX + 1] = {};
    gethostname(name, HOST_NAME_MAX);
    config.name = name;
  }
  run_worker(config,
             [&](std::function<void()> leave) { interrupts.set_handler(std::move(leave)); });
  return kDone;
}

}  // namespace cloudrenderer
