#include <malloc.h>
#include <spdlog/fmt/fmt.h>

#include <new>

#include "cli/commands.h"

namespace cloudrenderer {
namespace {

template <class... F>
struct Overloaded : F... {
  using F::operator()...;
};

int run(int argc, const char* const* argv) {
  Command command = parse_command_line(argc, argv);
  return std::visit(Overloaded{[&](RenderOptions& o) {
                                 o.command_line.assign(argv, argv + argc);
                                 set_up_log(o.log);
                                 Interrupts interrupts;
                                 return run_render(o, interrupts);
                               },
                               [](const WorkerOptionsGiven& o) {
                                 set_up_log(o.log);
                                 Interrupts interrupts;
                                 return run_worker_command(o, interrupts);
                               },
                               [](const SplitCommand& o) { return run_split(o); },
                               [](const CompareOptions& o) { return run_compare(o); },
                               [](const InfoOptions& o) { return run_info(o); },
                               [](const SimulateOptions& o) { return run_simulate(o); },
                               [](const ServeOptions& o) {
                                 set_up_log(o.log);
                                 Interrupts interrupts;
                                 return run_serve(o, interrupts);
                               },
                               [](const SubmitOptions& o) { return run_submit(o); },
                               [](const StatusOptions& o) { return run_status(o); },
                               [](const FetchOptions& o) { return run_fetch(o); },
                               [](const CancelOptions& o) { return run_cancel(o); },
                               [](const ChangeOptions& o) { return run_change(o); },
                               [](const RemoveOptions& o) { return run_remove(o); },
                               [](const ResumeOptions& o) { return run_resume(o); },
                               [](const LogsOptions& o) { return run_logs(o); },
                               [](const HelpText& o) {
                                 fmt::print("{}", o.text);
                                 return kDone;
                               }},
                    command);
}

int fail(int code, const char* what) {
  // Scene errors say "file:line:column: error: ..." by themselves.
  const std::string text = what;
  const bool says_error = text.find("error: ") != std::string::npos;
  fmt::print(stderr, "{}{}\n", says_error ? "" : "cloudrenderer: ", text);
  return code;
}

}  // namespace
}  // namespace cloudrenderer

int main(int argc, char** argv) {
  using namespace cloudrenderer;
#ifdef __GLIBC__
  // What every batch takes and gives back stays with the process: fetching it anew from the system took 3 % of a render.
  mallopt(M_MMAP_THRESHOLD, 8 << 20);
  mallopt(M_TRIM_THRESHOLD, 32 << 20);
#endif
  try {
    return run(argc, argv);
  } catch (const UsageError& e) {
    return fail(kWrongUsage, e.what());
  } catch (const SceneError& e) {
    return fail(kBadScene, e.what());
  } catch (const ClusterError& e) {
    return fail(kNoCluster, e.what());
  } catch (const std::bad_alloc&) {
    return fail(kNoCluster, "out of memory");
  } catch (const std::exception& e) {
    return fail(kNoCluster, e.what());
  }
}
