#pragma once
#include <functional>

#include "cluster/worker.h"

namespace cloudrenderer {

// A host of a pool: stays connected to it, and works for every job that it orders, each as a worker
// of its own with a thread, a connection to that job's manager and a number there; processors and
// loaded parts are shared (cluster/job_seat.h). Until it is asked to leave, or the pool is away for
// `patience` and no job is left. `incarnation`: as the pool knows it already. Throws ClusterError.
void run_pool_member(const WorkerConfig& config, std::uint64_t incarnation,
                     const std::function<void(std::function<void()>)>& on_leave);

}  // namespace cloudrenderer
