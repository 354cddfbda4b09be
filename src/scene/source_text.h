#pragma once
#include <memory>
#include <string>
#include <string_view>

#include "base/error.h"

namespace cloudrenderer {

// The text of a file, mapped into memory. A gzipped file is inflated through a temporary file, so
// that neither needs anonymous memory in proportion to its size. Immutable.
class SourceText {
 public:
  // Fails with the reason when the file cannot be read, is no regular file or is damaged gzip data.
  static Result<std::shared_ptr<const SourceText>> open(const std::string& path);
  // Text that is already in memory (tests, generated scenes).
  static std::shared_ptr<const SourceText> from_string(std::string name, std::string text);

  std::string_view view() const { return view_; }
  const std::shared_ptr<const std::string>& name() const { return name_; }

 private:
  std::shared_ptr<const std::string> name_;
  std::shared_ptr<const void> owner_;
  std::string_view view_;
};

}  // namespace cloudrenderer
