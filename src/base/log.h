#pragma once
// Thin names over spdlog, so that the rest of the code has one place to change.
#include <spdlog/spdlog.h>

#include <string>
#include <vector>

#include "base/error.h"

namespace cloudrenderer {

// Warnings about the scene, in the order they arose; the caller prints them ("file:line:column: warning: ...") or
// keeps them for `info`. Not thread-safe: one per reader.
class Warnings {
 public:
  void add(const FileLocation& location, const std::string& message) {
    list_.push_back((location.file ? location.to_string() + ": " : std::string()) + "warning: " + message);
  }
  const std::vector<std::string>& list() const { return list_; }

 private:
  std::vector<std::string> list_;
};

}  // namespace cloudrenderer
