#pragma once
// The command line of the service and its users.
#include <CLI/CLI.hpp>
#include <memory>
#include <optional>

#include "cli/options.h"

namespace cloudrenderer {

class ServiceCommands {
 public:
  explicit ServiceCommands(CLI::App& app);  // submit, status, fetch, cancel, change, remove, resume, logs
  ~ServiceCommands();
  ServiceCommands(const ServiceCommands&) = delete;
  ServiceCommands& operator=(const ServiceCommands&) = delete;

  void add_serve(CLI::App& manager);
  bool serves() const;
  // What `manager --serve` shares with a manager of one scene comes from there.
  Command read_serve(const Address& listen, const RenderOptions& manager, const std::string& min_hosts) const;
  std::optional<Command> read() const;  // none: it is another command

 private:
  struct Given;
  std::unique_ptr<Given> given_;
};

}  // namespace cloudrenderer
