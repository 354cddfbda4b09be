#pragma once
#include <cstdint>
#include <functional>
#include <optional>
#include <string>

namespace cloudrenderer {

struct PortRange {
  std::uint16_t first = 0, last = 0;
  std::uint32_t size() const { return last - first + 1u; }
  std::string to_string() const { return std::to_string(first) + "-" + std::to_string(last); }
};

// The first one on which one can listen at this host and that is not `taken` by us. None: there is no such one.
std::optional<std::uint16_t> free_port(const PortRange& range, const std::string& host, const std::function<bool(std::uint16_t)>& taken);

}  // namespace cloudrenderer
