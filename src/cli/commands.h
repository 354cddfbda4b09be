#pragma once
// One function a command; each returns the exit code. Errors are thrown.
#include "cli/options.h"

namespace cloudrenderer {

inline constexpr int kDone = 0, kBoundNotMet = 1, kWrongUsage = 2, kBadScene = 3, kNoCluster = 4,
                     kInterrupted = 5;

int run_render(const RenderOptions& options, Interrupts& interrupts);
int run_split(const SplitCommand& options);
int run_worker_command(const WorkerOptionsGiven& options, Interrupts& interrupts);
int run_compare(const CompareOptions& options);
int run_info(const InfoOptions& options);
int run_simulate(const SimulateOptions& options);
int run_serve(const ServeOptions& options, Interrupts& interrupts);
int run_submit(const SubmitOptions& options);
int run_status(const StatusOptions& options);
int run_fetch(const FetchOptions& options);
int run_cancel(const CancelOptions& options);
int run_change(const ChangeOptions& options);
int run_remove(const RemoveOptions& options);
int run_resume(const ResumeOptions& options);
int run_logs(const LogsOptions& options);

// "file:line:column: warning: ..." on standard error: the first twenty, then how many more.
void print_warnings(const std::vector<std::string>& warnings);
void set_up_log(const LogOptions& options);

}  // namespace cloudrenderer
