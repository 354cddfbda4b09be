#include <google/protobuf/stubs/logging.h>
#include <spdlog/sinks/basic_file_sink.h>
#include <spdlog/sinks/stdout_color_sinks.h>
#include <spdlog/spdlog.h>
#include <unistd.h>

#include "cli/commands.h"

namespace cloudrenderer {

void set_up_log(const LogOptions& options) {
  // It would print a line for every text of a stranger that is no UTF-8; decoding says so, too.
  google::protobuf::SetLogHandler(nullptr);
  try {
    const auto logger = options.file.empty()
                            ? spdlog::stderr_color_mt("cloudrenderer")
                            : spdlog::basic_logger_mt("cloudrenderer", options.file);
    logger->set_pattern("%Y-%m-%d %H:%M:%S.%e [%P] %^%l%$: %v");
    logger->set_level(spdlog::level::from_str(options.level));
    logger->flush_on(spdlog::level::info);
    spdlog::set_default_logger(logger);
  } catch (const spdlog::spdlog_ex& e) {
    throw UsageError("cannot write the log: " + std::string(e.what()));
  }
}

void print_warnings(const std::vector<std::string>& warnings) {
  constexpr std::size_t kShown = 20;
  for (std::size_t i = 0; i < std::min(kShown, warnings.size()); ++i)
    fmt::print(stderr, "{}\n", warnings[i]);
  if (warnings.size() > kShown)
    fmt::print(stderr, "... and {} more warnings\n", warnings.size() - kShown);
}

}  // namespace cloudrenderer
